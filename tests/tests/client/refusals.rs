//! Runs, bricks and addresses that are refused, and what is said of them.

use crate::{Node, admitted, connect, cube, options, push_half, push_planes, rank_of, refusal};
use lamina_client::{Client, ClientError, FullPolicy, RunOptions, Summary};

#[test]
fn the_node_says_why_it_refuses_a_run() {
    let node = Node::generator(1);
    let large = RunOptions { grid: cube(64), ..options(&node.url()) };
    let message = refusal(Client::connect(large).map(drop));
    assert!(message.contains("memory_bytes") && message.contains("[64, 64, 64]"), "{message}");
    let _serving = connect(&node, 0, 2, FullPolicy::Block);
    let other = RunOptions { name: "other".into(), ..options(&node.url()) };
    let message = refusal(Client::connect(other).map(drop));
    assert!(message.contains("\"blast\""), "{message}");
    let message = refusal(Client::connect(rank_of(&node.url(), 1, 2, FullPolicy::DropNewest)).map(drop));
    assert!(message.contains("rank 1") && message.contains("policy"), "{message}");
    let message = refusal(Client::connect(rank_of(&node.url(), 2, 2, FullPolicy::Block)).map(drop));
    assert!(message.contains("rank 2 of 2"), "{message}");
}

#[test]
fn a_refused_brick_names_ranks_and_the_run_goes_on() {
    let node = Node::generator(2);
    let [mut first, mut second] = [0, 1].map(|rank| connect(&node, rank, 2, FullPolicy::Block));
    push_half(&mut first, 0, 0).unwrap();
    let message = refusal(push_planes(&mut second, 0, 3, 5));
    assert!(message.contains("ranks 0 and 1 overlap"), "{message}");
    push_half(&mut first, 1, 0).unwrap();
    let message = refusal(push_planes(&mut second, 1, 6, 2));
    assert!(message.contains("cover 384 of 512 voxels"), "{message}");
    let message = refusal(push_planes(&mut second, 1, 6, 3));
    assert!(message.contains("brick"), "{message}");
    let message = refusal(push_half(&mut first, 1, 0));
    assert!(message.contains("rank 0") && message.contains("ascend"), "{message}");
    push_half(&mut first, 2, 0).unwrap();
    assert_eq!(push_half(&mut second, 2, 1).unwrap(), admitted(true));
    assert_eq!(second.close(), Summary { pushed: 1, dropped: 0, lost: 3, run_dropped_steps: Some(2) });
}

#[test]
fn addresses_that_cannot_be_are_refused_by_name() {
    for bad in ["", "127.0.0.1:7101", "ftp://127.0.0.1:7101", "http://127.0.0.1", "http://two words:1", "somewhere"] {
        match Client::connect(options(bad)).map(drop) {
            Err(ClientError::Invalid(e)) => {
                assert_eq!(e.thing, "generator", "{bad}");
                let named = e.reason.contains(&format!("\"{bad}\"")) && e.reason.contains("write http://HOST:PORT");
                assert!(named, "{}", e.reason);
            }
            other => panic!("\"{bad}\": {other:?}"),
        }
    }
}
