//! SIGKILL of a simulation, or of its node, in the middle of a step: the other one goes on, and no memory stays behind.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::languages::compile;
use lamina_tests::processes::{Daemon, free_port, wait_for};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const KILLS: u64 = 25;

/// Slots of shared memory that process `pid` maps.
fn slots(pid: u32) -> usize {
    let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).unwrap_or_default();
    maps.lines().filter(|line| line.contains("memfd:lamina")).count()
}

/// What has a name in the system's folder of shared memory.
fn named_memory() -> Vec<String> {
    let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    entries.map(|e| e.file_name().to_string_lossy().into_owned()).filter(|name| name.contains("lamina")).collect()
}

fn start(program: &Path, url: &str) -> Child {
    Command::new(program).arg(url).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap()
}

/// A moment from 0 to 40 ms, another for each `n`.
fn moment(n: u64) -> Duration {
    Duration::from_micros(n.wrapping_mul(6_364_136_223_846_793_005) >> 33).mul_f64(1e-5 * 1.86)
}

#[test]
fn a_simulation_that_is_killed_leaves_its_node_whole() {
    let folder = tempfile::tempdir().unwrap();
    let program = compile(&["cc", "-std=c11"], &["tests/languages/endless.c"], folder.path());
    let node = Daemon::start("generator-node", free_port(), &[]);
    for n in 0..KILLS {
        let mut simulation = start(&program, &node.url());
        assert!(wait_for(Duration::from_secs(20), || slots(simulation.id()) > 0), "kill {n}: it shares no memory");
        std::thread::sleep(moment(n));
        simulation.kill().unwrap();
        simulation.wait().unwrap();
    }
    // What waited is worked off.
    assert!(wait_for(Duration::from_secs(60), || slots(node.pid()) == 0), "{} slots stay", slots(node.pid()));
    assert_eq!(named_memory(), Vec::<String>::new());
    let mut simulation = start(&program, &node.url());
    let line = BufReader::new(simulation.stdout.take().unwrap()).lines().next().unwrap().unwrap();
    simulation.kill().unwrap();
    simulation.wait().unwrap();
    let numbers: Vec<u64> = line.split(' ').map(|n| n.parse().unwrap()).collect();
    assert!(numbers[0] > 10 && numbers[1] == 0, "steps, lost, longest: {line}");
}

#[test]
fn a_node_that_is_killed_costs_its_simulation_steps_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let program = compile(&["cc", "-std=c11"], &["tests/languages/endless.c"], folder.path());
    let port = free_port();
    let mut node = Daemon::start("generator-node", port, &[]);
    let mut simulation = start(&program, &node.url());
    for n in 0..KILLS {
        assert!(wait_for(Duration::from_secs(20), || slots(node.pid()) > 0), "kill {n}: it shares no memory");
        std::thread::sleep(moment(n));
        node.kill();
        node = Daemon::start("generator-node", port, &[]);
    }
    assert!(wait_for(Duration::from_secs(20), || slots(node.pid()) > 0));
    // One ring: those of dead nodes are gone.
    assert!(slots(simulation.id()) <= 6, "{} slots", slots(simulation.id()));
    simulation.kill().unwrap();
    let lines = BufReader::new(simulation.stdout.take().unwrap()).lines().map(Result::unwrap);
    let longest = lines.map(|line| line.rsplit_once(' ').unwrap().1.parse::<u64>().unwrap()).max().unwrap();
    simulation.wait().unwrap();
    // Its deadline is 5 s.
    assert!(longest < 5500, "a step took {longest} ms");
}
