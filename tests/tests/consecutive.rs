//! Steps coded after the one before them, through the real nodes: recorded, given away, read again, and gone on with by readers that come late
//! or come back.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, FullPolicy, RunOptions};
use lamina_codec::{DecodeLimits, decode_any, volume};
use lamina_model::{
    ControlPoint, Grid, Intermediate, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction, Volume, VoxelType,
    Voxels, suggest::suggest,
};
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use lamina_viz_node::store::StepRow;
use lamina_volume_io::read_recorded;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const SIDE: usize = 40;
const GAMMA: f64 = 0.002;

/// Waves and fronts that move by one point a step along x; fronts come back at the other side.
fn value(n: usize, step: u64) -> f32 {
    let p = DVec3::new((n % SIDE) as f64, (n / SIDE % SIDE) as f64, (n / SIDE / SIDE) as f64);
    let p = p - DVec3::X * step as f64;
    let waves = (0.5 * p.x + 0.3 * p.y).sin() * (0.4 * p.z).cos() + (0.7 * p.y - 0.3 * p.z).sin() * (0.6 * p.x).sin();
    let p = DVec3::new(p.x.rem_euclid(SIDE as f64), p.y, p.z);
    let front = |center: DVec3, radius: f64| (2.0 * (radius - (p - center).length())).tanh();
    let fronts = front(DVec3::splat(18.0), 9.0) + front(DVec3::new(30.0, 10.0, 12.0), 6.0);
    (0.5 + 0.05 * waves + 0.15 * fronts) as f32
}

fn values(step: u64) -> Vec<f32> {
    (0..SIDE.pow(3)).map(|n| value(n, step)).collect()
}

fn grid() -> Grid {
    Grid::new([SIDE; 3], DVec3::ONE, DVec3::ZERO).unwrap()
}

/// One that shows all values: none may be anything.
fn scene() -> Scene {
    let scene = suggest(&[&Volume::new(grid(), Voxels::F32(values(0))).unwrap()]).unwrap();
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [at, 0.5, 0.1], opacity };
    Scene {
        transfer: TransferFunction::new(range, Some(1.0), vec![point(0.0, 0.02), point(1.0, 0.2)]).unwrap(),
        ..scene
    }
}

fn viewer(folder: &Path, node: &Daemon) -> Daemon {
    std::fs::create_dir_all(folder).unwrap();
    let config = folder.join("viz-node.toml");
    std::fs::write(&config, format!("store = \"{}\"\n", folder.join("runs").display())).unwrap();
    let arguments = ["--backend", "cpu", "--config", config.to_str().unwrap(), "--generator", &node.url()];
    Daemon::start("viz-node", free_port(), &arguments)
}

/// The folder of the run that a viewer recorded, and its rows.
fn recorded(folder: &Path) -> Option<(PathBuf, Vec<StepRow>)> {
    let runs = std::fs::read_dir(folder.join("runs")).ok()?;
    let run = runs.flatten().map(|entry| entry.path()).find(|run| run.join("steps.csv").exists())?;
    let csv = std::fs::read_to_string(run.join("steps.csv")).ok()?;
    let mut rows: Vec<StepRow> = csv.lines().skip(1).filter_map(StepRow::from_csv).collect();
    rows.sort_by_key(|row| row.step);
    Some((run, rows))
}

fn has(folder: &Path, step: u64) -> bool {
    recorded(folder).is_some_and(|(_, rows)| rows.last().is_some_and(|row| row.step >= step))
}

fn volume_of(intermediate: Intermediate) -> ReducedVolume {
    match intermediate {
        Intermediate::Volume(volume) => *volume,
        Intermediate::Vdi(_) => unreachable!("the node was told to reduce"),
    }
}

/// Every step that was recorded in `folder` is read, and is what was pushed.
fn check(folder: &Path) -> Vec<StepRow> {
    let (run, rows) = recorded(folder).unwrap();
    for row in &rows {
        let file = run.join(format!("step_{:06}.vdi", row.step));
        let bytes = std::fs::read(&file).unwrap();
        assert_eq!(row.after_step.is_some(), volume::coded_after(&bytes).is_some(), "step {}", row.step);
        let read = volume_of(read_recorded(&file).unwrap());
        let off = |(n, unit): (usize, &f32)| f64::from(value(n, row.step) - unit).powi(2);
        let error = (read.units().iter().enumerate().map(off).sum::<f64>() / read.units().len() as f64).sqrt();
        assert!(error <= GAMMA, "step {}: {error}", row.step);
    }
    rows
}

#[test]
fn steps_coded_after_others_reach_every_reader_whole() {
    let folder = tempfile::tempdir().unwrap();
    let [early, late] = ["early", "late"].map(|name| folder.path().join(name));
    let config = folder.path().join("generator-node.toml");
    let params = format!(
        "representation = \"volume\"\nresolution = {SIDE}\ngamma = {GAMMA}\nopacity_cutoff = 1.0\nstep_voxels = 0.5\n"
    );
    // Room for a few steps: who comes late finds no key frame.
    std::fs::write(&config, format!("history_bytes = 60000\n[params]\n{params}")).unwrap();
    let node =
        Daemon::start("generator-node", free_port(), &["--backend", "cpu", "--config", config.to_str().unwrap()]);
    let first = viewer(&early, &node);
    let options = RunOptions::new(&node.url(), "waves", "density", grid(), VoxelType::F32);
    let (scene, full_policy, deadline) = (Some(scene()), FullPolicy::Block, Duration::from_secs(60));
    let mut client = Client::connect(RunOptions { scene, full_policy, deadline, ..options }).unwrap();
    let mut push = |steps: std::ops::Range<u64>, seen_by: &[&Path]| {
        for step in steps {
            client.push(step, step as f64, &Brick::new([0; 3], [SIDE; 3], &values(step))).unwrap();
            // No reader falls behind but by being away.
            let all = || seen_by.iter().all(|folder| has(folder, step));
            assert!(wait_for(Duration::from_secs(60), all), "step {step}");
        }
    };
    push(0..13, &[&early]);
    let second = viewer(&late, &node);
    let joined = || curl_ok(&second) && curl_ok(&first);
    assert!(wait_for(Duration::from_secs(30), joined));
    push(13..22, &[&early]);

    // Coded after the one before, but for a key frame every eight steps and what the late one asked for.
    let rows = check(&early);
    assert_eq!(rows.len(), 22);
    assert!(rows.iter().all(|row| row.after_step.is_none_or(|before| before + 1 == row.step)));
    let keys: Vec<u64> = rows.iter().filter(|row| row.after_step.is_none()).map(|row| row.step).collect();
    assert_eq!(keys[..2], [0, 8], "{keys:?}");
    assert!(keys.len() <= 4 && keys.windows(2).all(|w| w[1] - w[0] <= 8), "{keys:?}");
    let mean = |rows: Vec<&StepRow>| rows.iter().map(|row| row.size_bytes as f64).sum::<f64>() / rows.len() as f64;
    let [alone, after] = [true, false].map(|key| mean(rows.iter().filter(|r| r.after_step.is_none() == key).collect()));
    assert!(after < 0.8 * alone, "{after} of {alone} bytes");
    assert!(wait_for(Duration::from_secs(30), || has(&late, 21)));
    let seen = check(&late);
    assert!(seen[0].after_step.is_none() && seen[0].step > 0, "it begins with a key frame: {}", seen[0].step);

    // Given away in one piece, or alone to who has the one before.
    let (run, _) = recorded(&early).unwrap();
    let file = |step: u64| run.join(format!("step_{step:06}.vdi"));
    let fetched = |query: &str| {
        let out = folder.path().join("fetched");
        let url = format!("{}/api/step/{query}", first.url());
        let status = Command::new("curl").args(["--silent", "--fail", "--output"]).arg(&out).arg(url).status();
        assert!(status.unwrap().success());
        std::fs::read(out).unwrap()
    };
    let whole = decode_any(&fetched("7"), &DecodeLimits::default()).unwrap();
    assert!(volume_of(whole).units() == volume_of(read_recorded(&file(7)).unwrap()).units());
    assert_eq!(fetched("7?alone=true"), std::fs::read(file(7)).unwrap());
    let png = folder.path().join("7.png");
    let mut render = Command::new(binary("lamina"));
    render.args(["render", "--size", "64", "--out"]).arg(&png).arg(file(7));
    assert!(render.status().unwrap().success() && png.exists());

    // One that was away goes on with what it has, or with the next key frame.
    drop(first);
    push(22..24, &[&late]);
    let _first = viewer(&early, &node);
    push(24..40, &[&late, &early]);
    let rows = check(&early);
    assert!(rows.len() >= 22 + 16 && rows.last().unwrap().step == 39);
    assert_eq!(check(&late).last().unwrap().step, 39);
    client.close();
}

/// True if a viewer is connected to its node.
fn curl_ok(viewer: &Daemon) -> bool {
    let state = Command::new("curl").args(["--silent", "--fail"]).arg(format!("{}/api/state", viewer.url())).output();
    String::from_utf8_lossy(&state.unwrap().stdout).contains("\"connected\":true")
}
