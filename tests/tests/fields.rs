//! Fields that people at the page choose: computed beside the simulation, each a run of its own, as NumPy computes them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::languages::{library, python_with, source};
use lamina_tests::processes::{Daemon, free_port, wait_for};
use lamina_viz_node::store::StepRow;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

#[test]
fn what_a_node_computes_of_a_runs_fields_is_what_numpy_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Fires at the first step of each run.
    let trigger = "[[trigger]]\nname = \"keep\"\nwhen = \"max >= min\"\ndo = [\"raw\"]\n";
    std::fs::write(path("node.toml"), format!("trigger_folder = \"{}\"\n{trigger}", path("raw").display())).unwrap();
    let node = ["--backend", "cpu", "--config", path("node.toml").to_str().unwrap()].map(str::to_owned);
    let node = Daemon::start("generator-node", free_port(), &node.each_ref().map(String::as_str));
    std::fs::write(path("viz.toml"), format!("store = \"{}\"\n", path("runs").display())).unwrap();
    let (config, url) = (path("viz.toml").display().to_string(), node.url());
    let viz = Daemon::start("viz-node", free_port(), &["--backend", "cpu", "--config", &config, "--generator", &url]);

    let computed = Command::new(python_with("numpy"))
        .arg(source("tests/languages/derived.py"))
        .args([&url, &viz.url()])
        .arg(path("raw"))
        .env("PYTHONPATH", source("deploy/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("LAMINA_LIBRARY", library())
        .output()
        .unwrap();
    let [said, complained] = [&computed.stdout, &computed.stderr].map(|s| String::from_utf8_lossy(s).into_owned());
    assert!(computed.status.success(), "{said}{complained}");

    // The simulation's run, and one for each change, with what was shown and what computing it took.
    let runs = || {
        let folders = std::fs::read_dir(path("runs")).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut runs: Vec<PathBuf> = folders.filter(|run| run.join("steps.csv").exists()).collect();
        runs.sort_by_key(|run| run.extension().map_or(1, |n| n.to_str().unwrap().parse::<u32>().unwrap()));
        runs
    };
    let rows = |run: &PathBuf| -> Vec<StepRow> {
        let csv = std::fs::read_to_string(run.join("steps.csv")).unwrap_or_default();
        csv.lines().skip(1).filter_map(StepRow::from_csv).collect()
    };
    let shown = said.lines().count();
    assert!(
        wait_for(Duration::from_secs(30), || runs().len() == shown + 1 && runs().iter().all(|r| rows(r).len() == 1))
    );
    for (n, run) in runs().iter().enumerate() {
        let description: serde_json::Value =
            serde_json::from_slice(&std::fs::read(run.join("run.json")).unwrap()).unwrap();
        let expected =
            n.checked_sub(1).map_or("density", |n| said.lines().nth(n).unwrap().rsplit_once(": ").unwrap().0);
        assert_eq!(description["field"], expected);
        let row = &rows(run)[0];
        assert_eq!((row.step, row.derivation_ms > 0.0), (n as u64, n > 0), "{expected}");
    }
    let requests = std::fs::read_to_string(runs()[0].join("requests.csv")).unwrap();
    assert!(requests.contains("show magnitude(v)"), "{requests}");
}
