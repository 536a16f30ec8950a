//! Nodes that end, and nodes of another version: nothing admitted is lost, and nobody is misunderstood.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_client::{Brick, Client, RunOptions};
use lamina_model::{FullPolicy, VoxelType};
use lamina_rpc::v1::{self, control_client::ControlClient};
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use lamina_tests::{clumps, sampled_cube};
use std::process::Command;
use std::time::Duration;
use tonic::Code;
use tonic::transport::Endpoint;

const STEPS: u64 = 8;

#[test]
fn steps_that_were_admitted_before_a_sigterm_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    // Slow enough that most of the steps wait when the signal comes.
    let config = folder.path().join("generator.toml");
    let params = "cpu_share = 1\n[params]\nrepresentation = \"vdi\"\nresolution = 160\ngamma = 0.001\n";
    std::fs::write(&config, params).unwrap();
    let generator = Daemon::start("generator-node", free_port(), &["--config", config.to_str().unwrap()]);
    let (store, viewer) = (folder.path().join("store"), folder.path().join("viz.toml"));
    std::fs::write(&viewer, format!("generator = \"{}\"\nstore = \"{}\"\n", generator.url(), store.display())).unwrap();
    let _viz = Daemon::start("viz-node", free_port(), &["--config", viewer.to_str().unwrap()]);

    let volume = sampled_cube(64, clumps);
    let options = RunOptions::new(&generator.url(), "drain", "density", *volume.grid(), VoxelType::F64);
    let mut client = Client::connect(RunOptions { full_policy: FullPolicy::Block, ..options }).unwrap();
    for step in 0..STEPS {
        client.push(step, step as f64, &Brick::new([0; 3], [64; 3], volume.voxels())).unwrap();
    }
    let recorded = || {
        let runs = std::fs::read_dir(&store).into_iter().flatten().flatten();
        let files = runs.flat_map(|run| std::fs::read_dir(run.path()).into_iter().flatten().flatten());
        files.filter(|file| file.path().extension().is_some_and(|e| e == "vdi")).count() as u64
    };
    assert!(recorded() < STEPS, "all steps were shown before the signal");
    assert_eq!(generator.terminate(), Some(0));
    assert!(wait_for(Duration::from_secs(10), || recorded() == STEPS), "{} of {STEPS} steps are shown", recorded());
}

#[test]
fn another_version_of_the_contracts_is_refused_by_name() {
    let generator = Daemon::start("generator-node", free_port(), &[]);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let refusal = runtime.block_on(async {
        let later = Endpoint::from_shared(generator.url()).unwrap().user_agent("lamina/9.0.0 protocol/90").unwrap();
        let mut control = ControlClient::new(later.connect().await.unwrap());
        control.watch(v1::WatchRequest::default()).await.unwrap_err()
    });
    assert_eq!(refusal.code(), Code::FailedPrecondition, "{refusal}");
    assert!(refusal.message().contains("protocol 90 (lamina 9.0.0)"), "{refusal}");
}

#[test]
fn a_reader_that_leaves_ends_nothing() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = Command::new(binary("lamina")).arg("doctor").stdout(writer).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !error.contains("panicked"), "{error}");
}
