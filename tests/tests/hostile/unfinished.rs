//! Messages that begin and do not end.

use axum::body::{Body, Bytes};
use futures::StreamExt as _;
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_tests::http::metric;
use lamina_tests::processes::{Daemon, free_port, wait_for};
use std::fs::read_to_string;
use std::time::Duration;
use tokio::runtime::Runtime;
use tonic::client::GrpcService as _;
use tonic::codegen::http::Request;
use tonic::transport::Channel;

/// Of each message, and how many are begun, each on its own connection.
const LENGTH: usize = 8 << 20;
const MESSAGES: usize = 100;

/// Resident memory of a process, in bytes.
fn resident(node: &Daemon) -> usize {
    let status = read_to_string(format!("/proc/{}/status", node.pid())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() << 10
}

/// Begins a message, sends all of it but the last byte, and then nothing.
async fn begin(mut node: Channel) {
    let prefix = [&[0][..], &(LENGTH as u32).to_be_bytes()].concat();
    let pieces = std::iter::repeat_n(Bytes::from(vec![0x0a; 1 << 16]), LENGTH >> 16).enumerate();
    let pieces = pieces.map(|(k, piece)| piece.slice(usize::from(k == 0)..));
    let all = futures::stream::iter(std::iter::once(Bytes::from(prefix)).chain(pieces)).map(Ok::<_, std::io::Error>);
    let body = tonic::body::Body::new(Body::from_stream(all.chain(futures::stream::pending())));
    let request = Request::post("/lamina.v1.Ingest/Push").header("content-type", "application/grpc").body(body);
    let _ = std::future::poll_fn(|cx| node.poll_ready(cx)).await;
    let _ = node.call(request.unwrap()).await;
}

#[test]
fn messages_of_which_a_part_comes_take_no_more_than_their_addresss_share() {
    let node = Daemon::start("generator-node", free_port(), &[]);
    let before = resident(&node);
    let runtime = Runtime::new().unwrap();
    for _ in 0..MESSAGES {
        let channel = runtime.block_on(connect(&node.url(), Role::Generator, None)).unwrap();
        drop(runtime.spawn(begin(channel)));
    }
    let waits = || metric(&node.url(), "lamina_message_waits_total").unwrap_or(0.0);
    // 64 MiB are 8 of these messages.
    let others = (MESSAGES - 8) as f64;
    assert!(wait_for(Duration::from_secs(20), || waits() == others), "{} wait", waits());
    // What each connection may send before it is read: 1 MiB.
    let bound = (64 << 20) + (MESSAGES << 20);
    for _ in 0..20 {
        std::thread::sleep(Duration::from_millis(50));
        let grown = resident(&node) - before;
        assert!(grown < bound * 5 / 4, "{} MiB of {}", grown >> 20, (MESSAGES * LENGTH) >> 20);
    }
    // Nothing comes of them for half a minute: the calls end, and others have their turn.
    let slow = || metric(&node.url(), "lamina_slow_requests_total").unwrap_or(0.0);
    assert!(wait_for(Duration::from_secs(60), || slow() >= 8.0), "{} ended", slow());
    drop(runtime);
    super::push(&node.url(), "afterwards", 3);
    assert!(wait_for(Duration::from_secs(60), || metric(&node.url(), "lamina_generator_step_size_bytes_count")
        == Some(3.0)));
}
