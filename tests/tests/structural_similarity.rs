//! Structural similarity: against its definition in NumPy, as a limit that a tuner keeps, and where only some pixels are compared.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_client::{Brick, Client, RunOptions};
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_rpc::v1::{TunerStatusRequest, tuning_client::TuningClient};
use lamina_tests::languages::python_with;
use lamina_tests::processes::{Daemon, figure, free_port, recorded_series, stdout_of, wait_for};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube};
use lamina_viz_node::store::StepRow;
use std::path::Path;
use std::time::Duration;

/// The picture that `lamina` makes of a step of the recorded series, and of a VDI or volume of it: their paths.
fn pictures(folder: &Path, size: &str, generate: &[&str]) -> [String; 2] {
    let path = |name: &str| folder.join(name).display().to_string();
    let series = recorded_series().display().to_string();
    let (vdi, truth, shown) = (path("step"), path("truth.pfm"), path("shown.pfm"));
    let view = ["--view", "30", "--size", size];
    stdout_of("lamina", &[&["generate", &series, "--time-step", "1", "--out", &vdi], generate].concat());
    stdout_of("lamina", &[&["raycast", &series, "--time-step", "1", "--out", &truth], &view[..]].concat());
    stdout_of("lamina", &[&["render", &vdi, "--out", &shown], &view[..]].concat());
    [truth, shown]
}

#[test]
fn both_kinds_are_what_their_definitions_say() {
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("ssim.py").display().to_string();
    for (resolution, gamma) in [("24", "0.2"), ("96", "0.02")] {
        // An odd side: a row is left out when scales are halved.
        let pictures = pictures(folder.path(), "197", &["--resolution", resolution, "--gamma", gamma]);
        let found = stdout_of("lamina", &["compare", &pictures[0], &pictures[1]]);
        let output = std::process::Command::new(python_with("numpy")).arg(&script).args(&pictures).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let expected = String::from_utf8(output.stdout).unwrap();
        for name in ["ssim", "ms_ssim"] {
            let (found, expected) = (figure(&found, name), figure(&expected, name));
            assert!((found - expected).abs() < 2e-6 && (0.1..0.9999).contains(&found), "{name}: {found} {expected}");
        }
        assert!(found.lines().last().unwrap().starts_with("psnr_db "), "{found}");
    }
}

#[test]
fn the_smallest_step_that_keeps_the_limit_is_found() {
    let series = recorded_series().display().to_string();
    let found = stdout_of("lamina", &["tune", &series, "--time-step", "1", "--contract", "ssim >= 0.97"]);
    let best = found.lines().find(|line| line.starts_with("best")).unwrap();
    let word = |name: &str| -> String {
        best.split_whitespace().skip_while(|w| *w != name).nth(1).unwrap().trim_matches(',').to_owned()
    };
    let ssim: f64 = word("ssim").parse().unwrap();
    assert!((0.97..0.985).contains(&ssim), "close to the limit: {best}");
    // Made again with these parameters, one of the six views is about as similar as all of them.
    let folder = tempfile::tempdir().unwrap();
    let (representation, resolution, gamma) = (word("best"), word("r"), word("gamma"));
    let mut generate = vec!["--representation", &representation, "--resolution", &resolution, "--gamma", &gamma];
    if representation == "volume" {
        generate.extend(["--error", "mean-square"]);
    }
    let pictures = pictures(folder.path(), "256", &generate);
    let again = figure(&stdout_of("lamina", &["compare", &pictures[0], &pictures[1]]), "ssim");
    assert!((again - ssim).abs() < 0.02, "{again} for {best}");
}

#[test]
fn a_live_run_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let live =
        ["live", "--headless", "--cells", "32", "--steps", "4", "--pace", "0", "--backend", "cpu", "--out", &out];
    stdout_of("lamina", &[&live[..], &["--contract", "ssim >= 0.95"]].concat());
    let table = std::fs::read_to_string(folder.path().join("steps.csv")).unwrap();
    let rows: Vec<StepRow> = table.lines().skip(1).filter_map(StepRow::from_csv).collect();
    assert_eq!(rows.len(), 4);
    // The first step goes before the study; then quality alone is limited, and bytes are saved.
    let bytes = |n: usize| rows[n].size_bytes;
    assert!((1..4).all(|n| 4 * bytes(n) < 3 * bytes(0)), "{:?}", (0..4).map(bytes).collect::<Vec<_>>());
    assert!(rows[1..].iter().all(|row| row.psnr_db.is_some_and(|db| f64::from(db) > 20.0)), "{rows:?}");
    // Measured of each step, which resembles the one studied.
    assert!(rows[1..].iter().all(|row| row.ssim.is_some_and(|ssim| ssim > 0.94 && ssim < 1.0)), "{rows:?}");
}

#[test]
fn where_some_of_the_pixels_are_compared_the_tuner_says_what_to_change() {
    let generator = Daemon::start("generator-node", free_port(), &["--backend", "cpu"]);
    let _viz = Daemon::start("viz-node", free_port(), &["--backend", "cpu", "--generator", &generator.url()]);
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("tuner.toml");
    std::fs::write(&config, "contract = \"ssim >= 0.95\"\n").unwrap();
    let arguments = ["--generator", &generator.url(), "--config", &config.display().to_string()];
    let tuner = Daemon::start("tuner", free_port(), &arguments);
    let volume = sampled_cube(24, clumps);
    let options = RunOptions {
        scene: Some(front_scene(clumps_transfer())),
        ..RunOptions::new(&generator.url(), "clumps", "value", *volume.grid(), volume.voxels().voxel_type())
    };
    let mut client = Client::connect(options).unwrap();
    client.push(0, 0.0, &Brick::new([0; 3], volume.grid().dims(), volume.voxels())).unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let error = || {
        runtime.block_on(async {
            let mut tuner = TuningClient::new(connect(&tuner.url(), Role::Tuner, None).await.unwrap());
            tuner.status(TunerStatusRequest { with_trials: false }).await.unwrap().into_inner().last_error
        })
    };
    assert!(wait_for(Duration::from_secs(60), || error().contains("tile = 1")), "{}", error());
}
