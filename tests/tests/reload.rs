//! SIGHUP: nodes that run take up another configuration.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_rpc::v1::{self, tuning_client::TuningClient};
use lamina_tests::http::{curl, metric};
use lamina_tests::processes::{Daemon, free_port, wait_for};
use std::path::Path;
use std::time::Duration;
use tokio::runtime::Runtime;

/// A node configured by a file that says `text`.
fn node(name: &str, folder: &Path, text: &str) -> Daemon {
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, text).unwrap();
    Daemon::start(name, free_port(), &["--config", &file.display().to_string()])
}

/// Has `daemon` read `text` as its configuration.
fn configure(daemon: &Daemon, name: &str, folder: &Path, text: &str) {
    std::fs::write(folder.join(format!("{name}.toml")), text).unwrap();
    daemon.signal("HUP");
}

fn contract(tuner: &Daemon) -> String {
    Runtime::new().unwrap().block_on(async {
        let channel = connect(&tuner.url(), Role::Tuner, None).await.unwrap();
        let status = TuningClient::new(channel).status(v1::TunerStatusRequest { with_trials: false }).await;
        status.unwrap().into_inner().contract
    })
}

const PATIENCE: Duration = Duration::from_secs(20);

#[test]
fn limits_and_contract_change_while_nodes_run_and_what_cannot_be_used_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let generator = node("generator-node", folder, "memory_bytes = 100000000\ncpu_share = 1.0\n");
    let at = format!("generator = \"{}\"\n", generator.url());
    let viz = node("viz-node", folder, &at);
    let tuner = node("tuner", folder, &format!("{at}contract = \"size <= 40kB\"\n"));
    let limit = || metric(&generator.url(), "lamina_generator_memory_limit_bytes");
    let cores = || metric(&generator.url(), "lamina_cpu_share_cores");
    assert_eq!((limit(), cores()), (Some(1e8), Some(1.0)));

    // Another address is a matter of the next start.
    let other = format!("listen = \"127.0.0.1:{}\"\n", free_port());
    configure(&generator, "generator-node", folder, &format!("{other}memory_bytes = 50000000\ncpu_share = 0.5\n"));
    assert!(wait_for(PATIENCE, || limit() == Some(5e7)), "{:?}", limit());
    assert!(wait_for(PATIENCE, || cores() == Some(0.5)), "{:?}", cores());
    // It cannot be used; the one after it can.
    configure(&generator, "generator-node", folder, "memory_bytes = 1\n");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((limit(), cores()), (Some(5e7), Some(0.5)));
    configure(&generator, "generator-node", folder, "memory_bytes = 60000000\ncpu_share = \"100%\"\n");
    assert!(wait_for(PATIENCE, || limit() == Some(6e7)), "{:?}", limit());
    assert!(wait_for(PATIENCE, || cores() == Some(1.0)), "as many as it has threads: {:?}", cores());

    assert_eq!(contract(&tuner), "size <= 40kB");
    configure(&tuner, "tuner", folder, &format!("{at}contract = \"size <= 90kB\"\nlog = \"debug\"\n"));
    assert!(wait_for(PATIENCE, || contract(&tuner) == "size <= 90kB"), "{}", contract(&tuner));

    let as_other = || curl(&viz.url(), &["--header", "Host: viz.example"]).0;
    assert_eq!(as_other(), "421");
    configure(&viz, "viz-node", folder, &format!("{at}hosts = [\"viz.example\"]\n"));
    assert!(wait_for(PATIENCE, || as_other() == "200"), "{}", as_other());
    for daemon in [generator, viz, tuner] {
        assert_eq!(daemon.terminate(), Some(0));
    }
}
