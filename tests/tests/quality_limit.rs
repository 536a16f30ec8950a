//! A limit on quality is watched while a run goes on: steps as large as before that look worse call for a study by themselves.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, RunOptions};
use lamina_codec::{EncodeOptions, decode_any, encode_any};
use lamina_model::{GenerationParams, Intermediate, SamplePlan, Scene, Segmentation, VdiParams, Volume};
use lamina_raycast::{Backend, Field};
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_rpc::v1::{self, quality_client::QualityClient, tuning_client::TuningClient};
use lamina_tests::processes::{Daemon, free_port, wait_for};
use lamina_tests::{front_scene, sampled_cube, transfer};
use lamina_vdi_render::{self as viz, Detail, Drawable};
use lamina_viz_node::store::StepRow;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(120);
/// The candidates: 32 rays a side, few supersegments or more of them.
const RESOLUTION: u32 = 32;
const COARSE: f64 = 0.02;
const FINE: f64 = 0.005;

/// A ball in layers along the generation camera's view: which layers hardly matters to its size from there, but from elsewhere.
fn layered(frequency: f64) -> Volume {
    let value = |p: DVec3| (-3.0 * p.length_squared()).exp() * (1.0 + 0.3 * (frequency * p.z).sin());
    sampled_cube(32, |p| value(p).clamp(0.0, 1.0))
}

fn scene() -> Scene {
    front_scene(transfer(2.0 / 31.0, &[(0.0, [0.2, 0.4, 1.0], 0.0), (1.0, [1.0, 0.8, 0.3], 0.3)]))
}

fn plan() -> SamplePlan {
    SamplePlan { image_size: 256, tile: 8, batches: 4, angles_deg: vec![10.0, 30.0, 60.0] }
}

/// Bytes and decibels, without any node.
fn measured(volume: &Volume, gamma: f64) -> (f64, f64) {
    let (field, params) = (Field::new(volume.clone(), &scene()), VdiParams::new(RESOLUTION, gamma).unwrap());
    let (vdi, _) = Backend::cpu().generate(&field, &params, Segmentation::Fitted).unwrap();
    let bytes = encode_any(&Intermediate::Vdi(Box::new(vdi)), &EncodeOptions::default()).unwrap();
    let shown = Drawable::new(decode_any(&bytes, &Default::default()).unwrap());
    let reference = Backend::cpu().reference_samples(&field, &plan(), 0).unwrap();
    let quality = viz::Backend::default().quality(&shown, &reference, 0..plan().batches, Detail::Cubic).unwrap();
    (bytes.len() as f64, quality.psnr_db())
}

#[test]
fn a_step_that_falls_short_of_the_quality_asked_for_is_tuned_for() {
    falls_short(1);
}

#[test]
fn where_only_some_steps_are_measured_those_tell() {
    falls_short(2);
}

/// A run whose third step is worse than its tuner wants; every `every`-th step comes with reference samples.
fn falls_short(every: u64) {
    let (early, late) = (layered(20.0), layered(10.0));
    let ((early_bytes, early_db), (late_bytes, late_db)) = (measured(&early, COARSE), measured(&late, COARSE));
    assert!(
        (late_bytes / early_bytes - 1.0).abs() < 0.08,
        "{early_bytes} and {late_bytes} bytes tell the tuner nothing"
    );
    assert!(late_db < early_db - 0.7, "{early_db} and {late_db} dB");
    let limit_db = (early_db + late_db) / 2.0;
    assert!(measured(&late, FINE).1 > limit_db + 0.5, "{limit_db} dB can be had");

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let config = write(
        "generator-node.toml",
        format!(
            "reference_every = {every}\n[samples]\nimage_size = 256\ntile = 8\nbatches = 4\nangles_deg = [10.0, 30.0, 60.0]\n"
        ),
    );
    let generator = Daemon::start("generator-node", free_port(), &["--backend", "cpu", "--config", &config]);
    let store = folder.path().join("store");
    let config = write("viz-node.toml", format!("store = \"{}\"\n", store.display()));
    let arguments = ["--backend", "cpu", "--config", &config, "--generator", &generator.url()];
    let viz = Daemon::start("viz-node", free_port(), &arguments);
    let grid = format!(
        "resolution = {{ from = {RESOLUTION}, to = {RESOLUTION}, step = 32 }}\ngamma = {{ from = {FINE}, to = {COARSE}, step = 0.015 }}"
    );
    let config = write(
        "tuner.toml",
        format!("contract = \"psnr >= {limit_db}dB\"\nbudget = 1.0\nrepresentations = [\"vdi\"]\n[grid]\n{grid}\n"),
    );
    let tuner = Daemon::start("tuner", free_port(), &["--config", &config, "--generator", &generator.url()]);

    let options = RunOptions {
        scene: Some(scene()),
        ..RunOptions::new(&generator.url(), "layers", "value", *early.grid(), early.voxels().voxel_type())
    };
    let mut client = Client::connect(options).unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let mut steps = runtime.block_on(async {
        let channel = connect(&viz.url(), Role::Viewer, None).await.unwrap();
        QualityClient::new(channel).steps(v1::StepsRequest {}).await.unwrap().into_inner()
    });
    let rows = || -> Vec<StepRow> {
        let folder = std::fs::read_dir(&store).ok().and_then(|mut all| all.next()).map(|e| e.unwrap().path());
        let text = folder.and_then(|f| std::fs::read_to_string(f.join("steps.csv")).ok()).unwrap_or_default();
        text.lines().skip(1).filter_map(StepRow::from_csv).collect()
    };
    // The gamma that the tuner has chosen, once it rests after a step.
    let chosen = |step: u64| {
        runtime.block_on(async {
            let status = TuningClient::new(connect(&tuner.url(), Role::Tuner, None).await.unwrap());
            let status =
                status.clone().status(v1::TunerStatusRequest { with_trials: false }).await.unwrap().into_inner();
            (!status.busy && status.steps_seen > step)
                .then(|| status.chosen.map(|p| (1e6 * GenerationParams::try_from(p).unwrap().gamma()).round() / 1e6))?
        })
    };
    let mut push = |step: u64, volume: &Volume| {
        client.push(step, 0.1 * step as f64, &Brick::new([0; 3], volume.grid().dims(), volume.voxels())).unwrap();
        assert!(wait_for(PATIENCE, || rows().len() as u64 == step + 1), "{:?}", rows());
    };
    push(0, &early);
    assert!(wait_for(PATIENCE, || chosen(0) == Some(COARSE)), "{:?}", chosen(0));
    push(1, &early);
    push(2, &late);
    assert!(wait_for(PATIENCE, || chosen(2) == Some(FINE)), "{:?}: {:?}", chosen(2), rows());
    push(3, &late);
    // Both volumes are as large: what the first was tuned for does not come back.
    assert!(wait_for(PATIENCE, || chosen(3) == Some(FINE)), "{:?}", chosen(3));
    let trials = runtime.block_on(async {
        let mut tuner = TuningClient::new(connect(&tuner.url(), Role::Tuner, None).await.unwrap());
        tuner.status(v1::TunerStatusRequest { with_trials: true }).await.unwrap().into_inner().trials
    });
    let mut studied: Vec<u64> = trials.iter().map(|t| t.step).collect();
    studied.dedup();
    assert_eq!(studied, [0, 2], "nothing but quality called for the second study");

    let found = rows();
    let gammas: Vec<f64> = found.iter().skip(1).map(|r| (1e6 * r.gamma).round() / 1e6).collect();
    assert_eq!(gammas, [COARSE, COARSE, FINE]);
    let kept: Vec<bool> = found.iter().skip(1).map(|r| r.limit_kept).collect();
    assert_eq!(kept, [true, false, true], "{found:?}");
    // What the tuner hears is what is recorded.
    let measured = |r: &&StepRow| r.step.is_multiple_of(every);
    assert!(found.iter().all(|r| r.psnr_db.is_some() == measured(&r)), "{found:?}");
    for row in found.iter().filter(measured) {
        let next = runtime.block_on(async { tokio::time::timeout(PATIENCE, steps.message()).await });
        let heard = next.unwrap().unwrap().unwrap();
        assert_eq!(heard.step, row.step);
        let (heard, recorded) = (heard.psnr_db, f64::from(row.psnr_db.unwrap()));
        assert!(heard == recorded || (heard - recorded).abs() < 1e-3, "{heard} and {recorded}");
    }
}
