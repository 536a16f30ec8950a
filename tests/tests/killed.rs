//! SIGKILL of a simulation, or of its node, in the middle of a step: the other one goes on, and no memory stays behind. A rank that is gone
//! leaves a hole.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, RunOptions};
use lamina_model::{FullPolicy, Grid, VoxelType};
use lamina_tests::languages::compile;
use lamina_tests::processes::{Daemon, free_port, wait_for};
use lamina_viz_node::store::StepRow;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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

/// Ranks of 16 x 16 x 8 points each; the middle one falls silent after a few steps, and never says so.
#[test]
fn the_steps_of_a_run_that_lost_a_rank_are_shown_with_a_hole() {
    const RANKS: u32 = 3;
    let folder = tempfile::tempdir().unwrap();
    let (store, config) = (folder.path().join("runs"), folder.path().join("viz-node.toml"));
    std::fs::write(&config, format!("store = \"{}\"\n", store.display())).unwrap();
    let node = Daemon::start("generator-node", free_port(), &["--backend", "cpu"]);
    let viz = ["--backend", "cpu", "--config", config.to_str().unwrap(), "--generator", &node.url()];
    let _viz = Daemon::start("viz-node", free_port(), &viz);
    let done = Arc::new(AtomicBool::new(false));
    let rank = |rank: u32| {
        let grid = Grid::new([16, 16, 24], DVec3::ONE, DVec3::ZERO).unwrap();
        let options = RunOptions::new(&node.url(), "holed", "density", grid, VoxelType::U8);
        let options = RunOptions { rank, ranks: RANKS, full_policy: FullPolicy::Block, ..options };
        let done = done.clone();
        move || {
            let mut client = Client::connect(options).unwrap();
            let voxels: Vec<u8> = (0..16 * 16 * 8).map(|n| (n % 16 * 15) as u8).collect();
            let mut longest = Duration::ZERO;
            for step in 0.. {
                if rank == 1 && step == 3 {
                    // As a process that is gone: it does not close.
                    std::mem::forget(client);
                    return Duration::ZERO;
                }
                let begun = Instant::now();
                client
                    .push(step, step as f64, &Brick::new([0, 0, 8 * rank as usize], [16, 16, 8], &voxels[..]))
                    .unwrap();
                longest = longest.max(begun.elapsed());
                if done.load(Ordering::Relaxed) {
                    break;
                }
                std::thread::sleep(Duration::from_millis(100));
            }
            client.close();
            longest
        }
    };
    let ranks: Vec<_> = (0..RANKS).map(|r| std::thread::spawn(rank(r))).collect();
    let rows = || -> Vec<StepRow> {
        let runs = std::fs::read_dir(&store).into_iter().flatten().flatten();
        let csv = runs.filter_map(|run| std::fs::read_to_string(run.path().join("steps.csv")).ok());
        csv.flat_map(|csv| csv.lines().skip(1).filter_map(StepRow::from_csv).collect::<Vec<_>>()).collect()
    };
    let holed = || rows().iter().filter(|row| row.lost_ranks == [1]).count();
    let shown = wait_for(Duration::from_secs(30), || holed() > 10);
    done.store(true, Ordering::Relaxed);
    ranks.into_iter().for_each(|rank| assert!(rank.join().unwrap() < Duration::from_secs(9), "a rank waited"));
    assert!(shown, "{:?}", rows());
    for row in rows() {
        let hole = if row.lost_ranks.is_empty() { 0 } else { 16 * 16 * 8 };
        assert_eq!((row.empty_voxels, row.step < 3), (hole, hole == 0), "step {}", row.step);
    }
}
