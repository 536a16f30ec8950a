//! Fields that people at the page choose: computed beside the simulation, each a run of its own, as NumPy computes them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, RunOptions};
use lamina_codec::DecodeLimits;
use lamina_model::{FullPolicy, Grid, VoxelType};
use lamina_tests::http::curl;
use lamina_tests::languages::{library, python_with, source};
use lamina_tests::processes::{Daemon, free_port, wait_for};
use lamina_vdi_render::Drawable;
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

/// Asks at the page for another way to show the run; the answer's status and words.
fn show(viz: &Daemon, request: &str) -> (String, String) {
    curl(&format!("{}/api/show", viz.url()), &["--header", "content-type: application/json", "--data", request])
}

#[test]
fn the_generation_camera_and_the_colors_are_those_asked_for() {
    let store = tempfile::tempdir().unwrap();
    let node = Daemon::start("generator-node", free_port(), &["--backend", "cpu"]);
    let config = store.path().join("viz.toml");
    std::fs::write(&config, format!("store = \"{}\"\n", store.path().join("runs").display())).unwrap();
    let (config, url) = (config.display().to_string(), node.url());
    let viz = Daemon::start("viz-node", free_port(), &["--backend", "cpu", "--config", &config, "--generator", &url]);
    let grid = Grid::new([12, 10, 8], DVec3::ONE, DVec3::ZERO).unwrap();
    let options = RunOptions::new(&url, "turned", "density", grid, VoxelType::F32);
    let mut client = Client::connect(RunOptions { full_policy: FullPolicy::Block, ..options }).unwrap();
    let voxels: Vec<f32> = (0..960).map(|n| (n % 12) as f32 + 0.1 * (n / 120) as f32).collect();
    let mut push = |step| client.push(step, step as f64, &Brick::new([0; 3], [12, 10, 8], &voxels)).unwrap();
    // What is recorded of a step, in the folder of whatever run it is in.
    let recorded = |step: u64| -> Option<(String, Drawable)> {
        let runs = std::fs::read_dir(store.path().join("runs")).into_iter().flatten().flatten();
        let mut found = runs.filter_map(|run| {
            let bytes = std::fs::read(run.path().join(format!("step_{step:06}.vdi"))).ok()?;
            let name = run.file_name().to_string_lossy().into_owned();
            Some((name, Drawable::new(lamina_codec::decode_any(&bytes, &DecodeLimits::default()).unwrap())))
        });
        found.next()
    };
    let of = |step| {
        assert!(wait_for(Duration::from_secs(30), || recorded(step).is_some()), "step {step}");
        recorded(step).unwrap()
    };
    push(0);
    let (run, first) = of(0);
    assert!(wait_for(Duration::from_secs(20), || show(&viz, r#"{"view":{"step":0,"azimuth":40,"elevation":20}}"#).0
        == "204"));
    push(1);
    let (turned_run, turned) = of(1);
    assert_eq!(turned_run, format!("{run}.2"));
    let (asked, expected) = (turned.camera(), first.camera().orbit(40.0, 20.0, 1.0).unwrap());
    assert!((asked.position() - expected.position()).length() < 1e-9, "{asked:?} {expected:?}");
    assert_eq!(turned.transfer(), first.transfer(), "the same colors");

    let points = r#"[{"at":0,"color":[1,0,0],"opacity":0.2},{"at":1,"color":[0,0,1],"opacity":0.5}]"#;
    assert_eq!(show(&viz, &format!("{{\"points\":{points}}}")).0, "204");
    push(2);
    let (_, recolored) = of(2);
    let transfer = recolored.transfer().expect("a volume has colors that can be changed");
    let first_transfer = first.transfer().unwrap();
    assert_eq!((transfer.range(), transfer.points().len()), (first_transfer.range(), 2));
    assert_eq!((transfer.points()[1].color, recolored.camera()), ([0.0, 0.0, 1.0], turned.camera()));
    // Another field has colors of its own, and is seen from where the last was.
    assert_eq!(show(&viz, r#"{"field":"density * 2"}"#).0, "204");
    push(3);
    let (_, doubled) = of(3);
    let range = *doubled.transfer().unwrap().range();
    assert!((range.hi() - 2.0 * first_transfer.range().hi()).abs() < 1e-6 && doubled.camera() == turned.camera());

    for (request, words) in [
        ("{}", "neither a field nor a camera"),
        (r#"{"view":{"step":77,"azimuth":0,"elevation":0}}"#, "77"),
        (r#"{"view":{"step":3,"azimuth":1e400,"elevation":0}}"#, ""),
        (r#"{"points":[]}"#, "transfer"),
        (r#"{"points":[{"at":0.5,"color":[1,0,0],"opacity":7}]}"#, ""),
        (r#"{"hue":"red"}"#, ""),
    ] {
        let (status, said) = show(&viz, request);
        assert!(status.starts_with('4') && said.contains(words), "{request}: {status} {said}");
    }
}
