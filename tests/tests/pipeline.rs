//! The three daemons as processes, a recorded series through the real client: every figure is traced to its source.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_model::{GenerationParams, Intermediate, Representation, SamplePlan, Scene, Segmentation, suggest::suggest};
use lamina_raycast::{Backend, Field};
use lamina_rpc::v1::{TunerStatusRequest, tuning_client::TuningClient};
use lamina_tests::processes::{Daemon, free_port, recorded_series, run, wait_for};
use lamina_vdi_render::{self as viz, Detail, Drawable};
use lamina_viz_node::store::{QualityStatus, StepRow};
use lamina_volume_io::{Options, Series, read_recorded};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tonic_health::pb::{HealthCheckRequest, health_check_response::ServingStatus, health_client::HealthClient};

const LIMIT_BYTES: u64 = 40_000;

/// The daemons around one store, on ports they keep over restarts.
struct Cluster {
    folder: tempfile::TempDir,
    ports: [u16; 3],
    generator: Option<Daemon>,
    viz: Option<Daemon>,
    tuner: Option<Daemon>,
}

impl Cluster {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        write(
            "generator-node.toml",
            "[samples]\nimage_size = 256\ntile = 4\nbatches = 1\nangles_deg = [10.0, 30.0, 60.0]\n".into(),
        );
        write("viz-node.toml", format!("store = \"{}\"\n", folder.path().join("store").display()));
        let grid = "resolution = { from = 32, to = 128, step = 32 }\ngamma = { from = 0.01, to = 0.11, step = 0.05 }";
        write("tuner.toml", format!("contract = \"size <= {LIMIT_BYTES}B\"\nbudget = 1.0\n[grid]\n{grid}\n"));
        let mut cluster =
            Self { folder, ports: [(); 3].map(|()| free_port()), generator: None, viz: None, tuner: None };
        cluster.start_generator();
        cluster.start_viz();
        cluster.start_tuner();
        cluster
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }
    fn url(&self, node: usize) -> String {
        format!("http://127.0.0.1:{}", self.ports[node])
    }
    fn start_generator(&mut self) {
        let config = self.path("generator-node.toml");
        self.generator = Some(Daemon::start("generator-node", self.ports[0], &["--config", &config]));
    }
    fn start_viz(&mut self) {
        let (config, generator) = (self.path("viz-node.toml"), self.url(0));
        self.viz = Some(Daemon::start("viz-node", self.ports[1], &["--config", &config, "--generator", &generator]));
    }
    fn start_tuner(&mut self) {
        let (config, generator) = (self.path("tuner.toml"), self.url(0));
        let arguments = ["--config", &config, "--generator", &generator];
        self.tuner = Some(Daemon::start("tuner", self.ports[2], &arguments));
    }

    /// The newest run's folder in the store: ids end with the time of opening.
    fn run_folder(&self) -> Option<PathBuf> {
        let store = self.folder.path().join("store");
        std::fs::read_dir(store).ok()?.flatten().map(|e| e.path()).filter(|p| p.join("run.json").exists()).max()
    }

    /// True once the tuner has dealt with as many steps and rests.
    fn tuner_rests_after(&self, steps: u64) -> bool {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let status = runtime.block_on(async {
            let mut tuner = TuningClient::connect(self.url(2)).await.unwrap();
            tuner.status(TunerStatusRequest { with_trials: false }).await.unwrap().into_inner()
        });
        assert_eq!(status.last_error, "");
        !status.busy && status.steps_seen >= steps
    }

    /// Replays the recorded series from another process, and waits until all of it is recorded.
    fn replay(&self, steps: usize) {
        let before = self.run_folder();
        let path = recorded_series().display().to_string();
        let pushed = run("lamina", &["replay", &path, "--generator", &self.url(0)]);
        assert!(pushed.status.success(), "{}", String::from_utf8_lossy(&pushed.stderr));
        let expected = format!("pushed {steps}  dropped 0  lost 0\n");
        assert!(String::from_utf8_lossy(&pushed.stdout).ends_with(&expected));
        let whole = || self.run_folder() != before && self.rows().len() == steps;
        assert!(wait_for(Duration::from_secs(120), whole), "{:?}", self.rows());
    }

    fn rows(&self) -> Vec<StepRow> {
        let Some(folder) = self.run_folder() else { return Vec::new() };
        read_rows(&folder.join("steps.csv"))
    }
}

fn read_rows(csv: &Path) -> Vec<StepRow> {
    let text = std::fs::read_to_string(csv).unwrap_or_default();
    text.lines().skip(1).filter_map(StepRow::from_csv).collect()
}

/// The scene `lamina replay` chooses for the series: from its first, middle and last step.
fn chosen_scene(series: &Series) -> Scene {
    let volumes = [0, (series.len() - 1) / 2, series.len() - 1].map(|n| series.read(n).unwrap());
    suggest(&volumes.iter().collect::<Vec<_>>()).unwrap()
}

#[test]
fn every_figure_of_a_replayed_series_comes_from_where_it_says() {
    let cluster = Cluster::start();
    let series = Series::open(&recorded_series(), &Options::default()).unwrap();
    cluster.replay(series.len());
    assert!(cluster.rows().iter().all(|r| r.limit_kept), "the limit holds before anything is tuned");
    assert!(wait_for(Duration::from_secs(120), || cluster.tuner_rests_after(series.len() as u64)));
    // The second run of the same simulation is tuned from its first step on.
    cluster.replay(series.len());
    let (rows, folder, scene) = (cluster.rows(), cluster.run_folder().unwrap(), chosen_scene(&series));
    let last = Field::new(series.read(series.len() - 1).unwrap(), &scene);
    let params = GenerationParams::default();
    let (untuned, _) = Backend::cpu().represent(&last, &params, Segmentation::Fitted).unwrap();
    let bytes = lamina_codec::encode_any(&untuned, &lamina_codec::EncodeOptions::default()).unwrap().len() as u64;
    assert!(bytes > LIMIT_BYTES, "without a limit it would be broken: {bytes}");
    let plan = SamplePlan { image_size: 256, tile: 4, batches: 1, angles_deg: vec![10.0, 30.0, 60.0] };
    for (n, row) in rows.iter().enumerate() {
        let file = folder.join(format!("step_{n:06}.vdi"));
        let shown = read_recorded(&file).unwrap();
        assert_eq!((row.step, row.time), (n as u64, series.time(n)));
        assert_eq!(row.size_bytes, file.metadata().unwrap().len(), "sigma is the file's size");
        assert_eq!(row.supersegments, shown.elements());
        let echoed = (row.representation, row.resolution, row.gamma);
        let params = shown.params();
        assert_eq!(echoed, (params.representation(), params.resolution(), params.gamma()), "echoed parameters");
        match &shown {
            Intermediate::Vdi(vdi) => assert_eq!(vdi.header().transfer_id, scene.transfer.id()),
            Intermediate::Volume(volume) => assert_eq!(volume.scene().transfer.points(), scene.transfer.points()),
        }
        assert!(row.generation_ms > 0.0 && (row.representation == Representation::Volume || row.encode_ms > 0.0));
        assert_eq!((row.dropped_steps, row.empty_voxels), (0, 0));
        // q again, from the recorded volume and the recorded bytes alone.
        let field = Field::new(series.read(n).unwrap(), &scene);
        let reference = Backend::cpu().reference_samples(&field, &plan, row.step).unwrap();
        let q = viz::Backend::default().quality(&Drawable::new(shown), &reference, 0..1, Detail::Cubic).unwrap();
        match row.psnr_db {
            Some(psnr_db) => {
                assert!((f64::from(psnr_db) - q.psnr_db()).abs() < 0.01, "step {n}: {row:?} but {q:?}");
                assert_eq!((row.measured, row.views.len()), (QualityStatus::Yes, 3));
            }
            // On a busy machine a newer step may have come before there was processor time, never for the last one.
            None => assert!(row.measured == QualityStatus::Skipped && n + 1 < rows.len(), "{row:?}"),
        }
        assert_eq!(row.size_limit_bytes, Some(LIMIT_BYTES), "the tuner's limit reaches the frames");
        assert!(row.limit_kept && row.size_bytes <= LIMIT_BYTES, "{row:?}");
    }

    // The page's state and the metrics say the same as the file.
    let get = |path: &str| {
        ureq::get(format!("{}{path}", cluster.url(1))).call().unwrap().body_mut().read_to_string().unwrap()
    };
    let state: serde_json::Value = serde_json::from_str(&get("/api/state")).unwrap();
    assert_eq!(state["run"]["field"], "density");
    assert_eq!(state["steps"].as_array().unwrap().len(), rows.len());
    let last = rows.last().unwrap();
    assert_eq!(state["steps"][rows.len() - 1]["size_bytes"], last.size_bytes);
    let metrics = get("/metrics");
    assert!(metrics.contains(&format!("\nlamina_vdi_size_bytes {}\n", last.size_bytes)), "{metrics}");
    assert!(metrics.contains(&format!("\nlamina_frames_total {}\n", 2 * rows.len())), "{metrics}");
    for name in
        ["cpu_share_cores", "cpu_seconds_total{activity=\"decode\"}", "work_skipped_total{priority=\"quality\"}"]
    {
        assert!(metrics.contains(&format!("\nlamina_{name} ")), "{metrics}");
    }
    // What is not there is said not to be, to browsers and to callers.
    let nowhere = ureq::get(format!("{}/nowhere", cluster.url(1)));
    assert!(matches!(nowhere.call(), Err(ureq::Error::StatusCode(404))));
    let called = ureq::get(format!("{}/lamina.v9.No/Call", cluster.url(1))).header("content-type", "application/grpc");
    assert_eq!(called.call().unwrap().headers()["grpc-status"], "12");
}

/// One push a call, like a simulation that takes its time.
fn pushes(cluster: &Cluster, name: &str) -> impl FnMut(u64) -> bool + use<> {
    let volume = Series::open(&recorded_series(), &Options::default()).unwrap().read(3).unwrap();
    let (grid, voxel_type) = (*volume.grid(), volume.voxels().voxel_type());
    let options = lamina_client::RunOptions::new(&cluster.url(0), name, "density", grid, voxel_type);
    let mut client = lamina_client::Client::connect(options).unwrap();
    move |step| {
        let brick = lamina_client::Brick::new([0; 3], volume.grid().dims(), volume.voxels());
        let pushed = client.push(step, step as f64, &brick).is_ok();
        std::thread::sleep(Duration::from_millis(50));
        pushed
    }
}

#[test]
fn killing_each_daemon_in_turn_stops_nobody_and_loses_nothing_recorded() {
    let mut cluster = Cluster::start();
    let mut push = pushes(&cluster, "survivor");
    let mut step = 0;
    let mut go_on = |until: &mut dyn FnMut() -> bool| {
        wait_for(Duration::from_secs(120), || {
            push(step);
            step += 1;
            until()
        })
    };
    let newest = |cluster: &Cluster| cluster.rows().last().map_or(0, |r| r.step);
    assert!(go_on(&mut || cluster.rows().len() >= 3), "the run is recorded");

    let before = cluster.rows();
    cluster.generator.take().unwrap().kill();
    let mut tries = 0;
    assert!(
        go_on(&mut || {
            tries += 1;
            tries == 10
        }),
        "the simulation goes on without its generator-node"
    );
    cluster.start_generator();
    let seen = newest(&cluster);
    assert!(go_on(&mut || newest(&cluster) > seen + 2), "a restarted generator-node is found again by all");
    let limited = |r: &StepRow| r.step > seen && r.size_limit_bytes == Some(LIMIT_BYTES);
    assert!(go_on(&mut || cluster.rows().iter().any(limited)), "and told again what the tuner found");
    assert_eq!(cluster.rows()[..before.len()], before, "rows recorded before stay as they were");

    let before = cluster.rows();
    cluster.viz.take().unwrap().kill();
    let mut tries = 0;
    assert!(go_on(&mut || {
        tries += 1;
        tries == 5
    }));
    cluster.start_viz();
    let seen = newest(&cluster);
    assert!(go_on(&mut || newest(&cluster) > seen + 2), "a restarted viz-node goes on with its store");
    assert_eq!(cluster.rows()[..before.len()], before);
    let at = |k: usize| cluster.rows()[k].step;
    let steps: Vec<u64> = (before.len() - 1..cluster.rows().len()).map(at).collect();
    assert!(steps.windows(2).all(|w| w[0] < w[1]));

    cluster.tuner.take().unwrap().kill();
    let seen = newest(&cluster);
    assert!(go_on(&mut || newest(&cluster) > seen + 2), "steps go on without the tuner");
    cluster.start_tuner();
    let seen = newest(&cluster);
    assert!(go_on(&mut || newest(&cluster) > seen + 2));

    // Every recorded step is whole.
    let folder = cluster.run_folder().unwrap();
    for row in cluster.rows() {
        let file = folder.join(format!("step_{:06}.vdi", row.step));
        assert_eq!(file.metadata().unwrap().len(), row.size_bytes);
        read_recorded(&file).unwrap();
    }
}

/// The answer of the standard gRPC health service.
fn health(url: &str) -> ServingStatus {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let channel = tonic::transport::Endpoint::from_shared(url.to_owned()).unwrap().connect().await.unwrap();
        let answer = HealthClient::new(channel).check(HealthCheckRequest::default()).await.unwrap();
        answer.into_inner().status()
    })
}

#[test]
fn daemons_stop_cleanly_and_refuse_bad_configurations_by_name() {
    let mut cluster = Cluster::start();
    let in_use = cluster.ports[0];
    let refused = |name: &str, arguments: &[&str], words: &[&str]| {
        let output = run(name, arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{name} {arguments:?}");
        assert!(words.iter().all(|w| text.contains(w)), "{name} {arguments:?} said: {text}");
    };
    let taken = format!("127.0.0.1:{in_use}");
    for name in ["generator-node", "viz-node", "tuner"] {
        refused(name, &["--listen", &taken], &[&taken, "in use", "--listen"]);
        refused(name, &["--config", "/nowhere/x.toml"], &["/nowhere/x.toml"]);
        assert!(run(name, &["--help"]).status.success());
    }
    let file = |name: &str, text: &str| {
        let path = cluster.path(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    refused("generator-node", &["--config", &file("a.toml", "memry_bytes = 3")], &["memry_bytes", "memory_bytes"]);
    refused("generator-node", &["--config", &file("b.toml", "[params]\nresolution = 0\ngamma = 0.1")], &["resolution"]);
    refused("generator-node", &["--config", &file("c.toml", "memory_bytes = 5")], &["memory_bytes"]);
    let size = "contract = \"size <= 300 parsecs\"";
    refused("tuner", &["--config", &file("d.toml", size)], &["300 parsecs", "size <= 300kB"]);
    refused("tuner", &["--config", &file("g.toml", "contract = \"cone <= 30deg\"")], &["samples.angles_deg"]);
    refused("tuner", &["--config", &file("h.toml", "budget = 5")], &["budget", "0..=1"]);
    refused("tuner", &["--config", &file("e.toml", "[grid]\ngamma = { from = 1, to = 0, step = 1 }")], &["grid.gamma"]);
    refused(
        "viz-node",
        &["--config", &file("f.toml", "store = \"/proc/nowhere\"\nlisten = \"127.0.0.1:0\"")],
        &["/proc/nowhere"],
    );
    for node in 0..3 {
        assert_eq!(health(&cluster.url(node)), ServingStatus::Serving);
    }
    for daemon in [cluster.generator.take(), cluster.viz.take(), cluster.tuner.take()] {
        assert_eq!(daemon.unwrap().terminate(), Some(0));
    }
}
