//! Calls and requests in arbitrary order with arbitrary values, against real nodes: none ends, none keeps what was reserved for them,
//! and a run afterwards is served.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod calls;
mod unfinished;
mod values;

use calls::Caller;
use lamina_client::{Brick, Client, FullPolicy, RunOptions};
use lamina_model::{VoxelType, Voxels};
use lamina_tests::http::{curl, metric};
use lamina_tests::processes::{Daemon, free_port, wait_for};
use lamina_tests::{clumps, sampled_cube};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;
use tokio::runtime::Runtime;
use values::Values;

/// Calls of gRPC, and requests of HTTP.
const CASES: usize = 1500;

/// A generator-node with little memory that gives up silent runs at once, and a viz-node and a tuner beside it.
fn nodes(folder: &std::path::Path) -> [Daemon; 3] {
    let config = folder.join("generator-node.toml");
    std::fs::write(&config, "memory_bytes = 16000000\nidle_secs = 0.5\nsamples = { image_size = 64, tile = 16 }\n")
        .unwrap();
    let generator = Daemon::start("generator-node", free_port(), &["--config", &config.display().to_string()]);
    let viz = Daemon::start("viz-node", free_port(), &["--generator", &generator.url()]);
    let tuner = Daemon::start("tuner", free_port(), &["--generator", &generator.url()]);
    [generator, viz, tuner]
}

fn push(generator: &str, name: &str, steps: u64) {
    let volume = sampled_cube(16, clumps);
    let mut options = RunOptions::new(generator, name, "density", *volume.grid(), VoxelType::F64);
    (options.deadline, options.full_policy) = (Duration::from_secs(30), FullPolicy::Block);
    let mut client = Client::connect(options).unwrap();
    let Voxels::F64(voxels) = volume.voxels() else { unreachable!("made of f64") };
    for step in 0..steps {
        client.push(step, step as f64, &Brick::new([0; 3], [16; 3], &voxels[..])).unwrap();
    }
    client.close();
}

/// The most memory that `daemon` ever had, bytes.
fn most_memory(daemon: &Daemon) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", daemon.pid())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
}

#[test]
fn arbitrary_calls_end_no_node_and_leave_nothing_reserved() {
    let folder = tempfile::tempdir().unwrap();
    let nodes = nodes(folder.path());
    let [generator, viz, tuner] = &nodes;
    push(&generator.url(), "before", 2);
    let urls = [generator.url(), viz.url(), tuner.url()];
    let answered = Runtime::new().unwrap().block_on(async {
        let mut caller = Caller::connect(&urls).await;
        let mut answered = 0;
        for seed in 0..CASES {
            answered += usize::from(caller.call(seed as u64).await);
        }
        caller.reset().await;
        answered
    });
    assert!(
        answered > CASES / 20,
        "{answered} of {CASES} calls were answered: the values are too wild to reach anything"
    );
    let left = || metric(&generator.url(), "lamina_generator_memory_bytes");
    // A run that was opened is given up once another comes.
    std::thread::sleep(Duration::from_secs(1));
    let recorded = || metric(&viz.url(), "lamina_frames_total").unwrap();
    let before = recorded();
    push(&generator.url(), "after", 3);
    assert!(wait_for(Duration::from_secs(60), || recorded() >= before + 3.0), "{} after {before}", recorded());
    assert!(wait_for(Duration::from_secs(20), || left() == Some(0.0)), "{:?} bytes stay reserved", left());
    for node in &nodes {
        assert!(most_memory(node) < 700 << 20, "{} MB", most_memory(node) >> 20);
    }
    for node in nodes {
        assert_eq!(node.terminate(), Some(0));
    }
}

/// What a server answers to `request`: the status, or nothing where it hangs up.
fn status(viz: &Daemon, request: &[u8], is_short: bool) -> Option<u16> {
    let mut connection = TcpStream::connect(viz.address).unwrap();
    connection.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    // It may have answered and hung up before all of it was sent.
    let _ = connection.write_all(request);
    if is_short {
        let _ = connection.shutdown(std::net::Shutdown::Write);
    }
    let mut head = [0; 12];
    connection.read_exact(&mut head).ok()?;
    std::str::from_utf8(&head).ok()?.strip_prefix("HTTP/1.1 ")?.parse().ok()
}

#[test]
fn arbitrary_requests_are_answered_without_a_fault_of_the_node() {
    let folder = tempfile::tempdir().unwrap();
    let nodes = nodes(folder.path());
    let [generator, viz, _] = &nodes;
    push(&generator.url(), "shown", 3);
    assert!(wait_for(Duration::from_secs(60), || metric(&viz.url(), "lamina_frames_total") == Some(3.0)));
    let mut good = 0;
    for seed in 0..CASES {
        let (request, is_short) = Values::new(seed as u64).http_request();
        let Some(status) = status(viz, &request, is_short) else { continue };
        let shown = String::from_utf8_lossy(&request);
        assert!(status < 500 || status == 503, "case {seed}: {status} to {shown}");
        good += usize::from(status == 200);
    }
    assert!(good > CASES / 20, "{good} of {CASES} requests were granted: the values are too wild to reach anything");
    assert_eq!(curl(&format!("{}/api/image?step=newest&size=64", viz.url()), &[]).0, "200");
    assert!(most_memory(viz) < 700 << 20, "{} MB", most_memory(viz) >> 20);
    for node in nodes {
        assert_eq!(node.terminate(), Some(0));
    }
}
