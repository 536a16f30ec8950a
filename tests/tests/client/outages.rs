//! The node is dead, stuck, restarted.

use crate::{LONG, Node, admitted, any_port, options, push_until, push_whole, refusal};
use lamina_client::{Client, ClientError, FullPolicy, RunOptions, Summary};
use std::net::TcpListener;
use std::time::{Duration, Instant};

/// A push that waits for nothing takes microseconds.
const IMMEDIATE: Duration = Duration::from_millis(50);

/// A socket that holds its address and does not listen: connections are refused, and no other test gets the address.
fn dead_socket() -> tokio::net::TcpSocket {
    let socket = tokio::net::TcpSocket::new_v4().unwrap();
    socket.bind(any_port()).unwrap();
    socket
}

#[test]
fn a_dead_node_costs_the_simulation_nothing_and_is_found_when_it_appears() {
    let dead = dead_socket();
    let address = dead.local_addr().unwrap();
    let start = Instant::now();
    let mut client = Client::connect(options(&format!("http://{address}"))).unwrap();
    assert!(client.run_id().is_none() && start.elapsed() < LONG / 2);
    let mut slow = 0;
    for step in 0..200 {
        let start = Instant::now();
        match push_whole(&mut client, step) {
            Err(ClientError::Unreachable { address: said, .. }) => assert!(said.contains(&address.to_string())),
            other => panic!("{other:?}"),
        }
        slow += usize::from(start.elapsed() > IMMEDIATE);
    }
    // Not none: a loaded machine may take this thread's core away.
    assert!(slow <= 10, "{slow} of 200 pushes were slow");
    assert_eq!(client.summary(), Summary { lost: 200, ..Summary::default() });
    drop(dead);
    let _node = Node::generator_at(address, 2);
    assert_eq!(push_until(200, |step| push_whole(&mut client, step), Result::is_ok).0.unwrap(), admitted(true));
    assert!(client.run_id().is_some_and(|id| id.starts_with("blast-")));
    assert_eq!(client.close().pushed, 1);
}

#[test]
fn a_step_that_nobody_would_take_is_counted_when_it_is_asked_about_and_one_that_is_wanted_when_it_is_pushed() {
    let dead = dead_socket();
    let address = dead.local_addr().unwrap();
    let mut client = Client::connect(options(&format!("http://{address}"))).unwrap();
    for step in 0..5 {
        match client.wants(step) {
            Err(ClientError::Unreachable { address: said, .. }) => assert!(said.contains(&address.to_string())),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(client.summary(), Summary { lost: 5, ..Summary::default() });
    drop(dead);
    let _node = Node::generator_at(address, 2);
    let until = Instant::now() + LONG;
    let wanted = |step: &u64| {
        std::thread::sleep(Duration::from_millis(10));
        assert!(Instant::now() < until);
        client.wants(*step).unwrap_or(false)
    };
    let step = (5..).find(wanted).unwrap();
    assert_eq!(client.summary().pushed, 0);
    assert_eq!(push_whole(&mut client, step).unwrap(), admitted(true));
    // Neither asked about nor pushed, asked about and not pushed, pushed and not asked about: a simulation may do as it likes.
    assert!(client.wants(step + 2).unwrap() && client.wants(step + 3).unwrap());
    assert_eq!(push_whole(&mut client, step + 3).unwrap(), admitted(true));
    assert_eq!(push_whole(&mut client, step + 4).unwrap(), admitted(true));
    let summary = client.close();
    assert_eq!((summary.pushed, summary.dropped), (3, 0));
}

#[test]
fn a_node_that_accepts_and_never_answers_is_waited_for_once_unless_the_run_is_to_block() {
    let stuck = TcpListener::bind(any_port()).unwrap();
    let deadline = Duration::from_millis(300);
    let url = format!("http://{}", stuck.local_addr().unwrap());
    for (full_policy, waits_again) in [(FullPolicy::DropOldest, false), (FullPolicy::Block, true)] {
        let start = Instant::now();
        let mut client = Client::connect(RunOptions { deadline, full_policy, ..options(&url) }).unwrap();
        assert!(start.elapsed() >= deadline && start.elapsed() < 10 * deadline, "{:?}", start.elapsed());
        // Two seconds, in which it is tried some times.
        let waits = |step| {
            std::thread::sleep(Duration::from_millis(20));
            let start = Instant::now();
            assert!(push_whole(&mut client, step).is_err());
            start.elapsed() >= deadline / 2
        };
        let waits = (0..100).map(waits).filter(|waited| *waited).count();
        // A loaded machine may take this thread's core away.
        assert!(if waits_again { (1..=5).contains(&waits) } else { waits <= 1 }, "{waits} of 100 pushes waited");
    }
}

#[test]
fn a_simulation_that_computes_long_between_steps_keeps_its_connection() {
    let node = Node::generator(4);
    let mut client = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    // Longer than the node waits for the answer to a ping: 10 s, and 10 s more.
    std::thread::sleep(Duration::from_secs(24));
    assert_eq!(push_whole(&mut client, 1).unwrap(), admitted(true));
}

#[test]
fn a_client_resumes_its_run_on_a_restarted_node() {
    let node = Node::generator(2);
    let mut client = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    let run_id = client.run_id().unwrap().to_owned();
    let address = node.kill();
    let dead = push_whole(&mut client, 1);
    assert!(matches!(dead, Err(ClientError::Unreachable { .. })), "{dead:?}");
    let _restarted = Node::generator_at(address, 2);
    assert_eq!(push_until(2, |step| push_whole(&mut client, step), Result::is_ok).0.unwrap(), admitted(true));
    assert_eq!(client.run_id(), Some(run_id.as_str()));
}

#[test]
fn a_restarted_simulation_gets_a_fresh_run_and_the_old_one_does_not_take_it_back() {
    let node = Node::generator(2);
    let mut old = Client::connect(options(&node.url())).unwrap();
    assert_eq!(push_whole(&mut old, 5).unwrap(), admitted(true));
    let mut new = Client::connect(options(&node.url())).unwrap();
    assert_ne!(old.run_id(), new.run_id());
    assert_eq!(push_whole(&mut new, 0).unwrap(), admitted(true));
    let message = refusal(push_whole(&mut old, 6));
    assert!(message.contains("newer start") && message.contains(new.run_id().unwrap()), "{message}");
    assert_eq!(push_whole(&mut new, 1).unwrap(), admitted(true));
}
