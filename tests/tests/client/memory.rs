//! Memory is full. Steps that wait for a rank that never comes hold it, so nothing here depends on speed.

use crate::{Node, admitted, connect, push_half, push_until, rank_of, timed_out};
use lamina_client::{Client, ClientError, FullPolicy, Receipt, RunOptions, Summary};
use std::time::Duration;

#[test]
fn drop_newest_is_told_to_the_client_and_counted() {
    let node = Node::generator(2);
    let mut client = connect(&node, 0, 2, FullPolicy::DropNewest);
    let receipts: Vec<_> = (0..4).map(|step| push_half(&mut client, step, 0).unwrap()).collect();
    assert_eq!(receipts, [admitted(false), admitted(false), Receipt::Dropped, Receipt::Dropped]);
    let all_four = Some(4);
    assert_eq!(client.close(), Summary { pushed: 2, dropped: 2, lost: 0, run_dropped_steps: all_four });
}

#[test]
fn drop_oldest_never_makes_the_simulation_wait_and_tells_the_other_rank() {
    let node = Node::generator(2);
    let [mut first, mut second] = [0, 1].map(|rank| connect(&node, rank, 2, FullPolicy::DropOldest));
    for step in 0..5 {
        assert_eq!(push_half(&mut first, step, 0).unwrap(), admitted(false));
    }
    let receipts: Vec<_> = (0..5).map(|step| push_half(&mut second, step, 1).unwrap()).collect();
    assert_eq!(receipts[..3], [Receipt::Dropped; 3]);
    assert_eq!(receipts[3..], [admitted(true); 2]);
    assert_eq!(first.close(), Summary { pushed: 5, dropped: 0, lost: 0, run_dropped_steps: Some(3) });
    assert_eq!(second.close(), Summary { pushed: 2, dropped: 3, lost: 0, run_dropped_steps: Some(3) });
}

#[test]
fn block_waits_no_longer_than_the_deadline() {
    let node = Node::generator(1);
    let deadline = Duration::from_millis(300);
    let options = RunOptions { deadline, ..rank_of(&node.url(), 0, 2, FullPolicy::Block) };
    let mut client = Client::connect(options).unwrap();
    // The first step to be taken fills the memory; which one that is, a loaded machine may decide.
    let (full, took) = push_until(0, |step| push_half(&mut client, step, 0), timed_out);
    assert!(matches!(full, Err(ClientError::Deadline(d)) if d == deadline), "{full:?}");
    assert!(took >= deadline && took < 10 * deadline, "{took:?}");
}

#[test]
fn block_goes_on_when_a_step_is_taken() {
    let node = Node::generator(1);
    let [mut first, mut second] = [0, 1].map(|rank| connect(&node, rank, 2, FullPolicy::Block));
    assert_eq!(push_half(&mut first, 0, 0).unwrap(), admitted(false));
    let waiting = std::thread::spawn(move || (push_half(&mut first, 1, 0).unwrap(), first));
    assert_eq!(push_half(&mut second, 0, 1).unwrap(), admitted(true));
    let (receipt, first) = waiting.join().unwrap();
    assert_eq!(receipt, admitted(false));
    assert_eq!(push_half(&mut second, 1, 1).unwrap(), admitted(true));
    assert_eq!((first.close().run_dropped_steps, second.close().run_dropped_steps), (Some(0), Some(0)));
}
