//! One study's trials over real daemons: shared by several viz-nodes, and finished without those that fail.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use futures::{Stream, stream};
use lamina_model::{GenerationParams, Invalid};
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_rpc::v1::generation_params::{Kind, Vdi};
use lamina_rpc::v1::{self, control_client::ControlClient, frames_client::FramesClient, quality_server};
use lamina_tests::http::metric;
use lamina_tests::processes::{Daemon, free_port, recorded_series, wait_for};
use lamina_tuner::evaluator::{Batches, Evaluator, Measurement, TrialError};
use lamina_tuner::remote::Remote;
use lamina_volume_io::{Options, Series};
use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tonic::transport::Channel;
use tonic::{Code, Request, Response, Status};

mod misbehaving;

const BATCHES: u32 = 16;

/// A generator-node that holds one step, and viz-nodes that come and go.
struct Cluster {
    _folder: tempfile::TempDir,
    generator: Daemon,
}

impl Cluster {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("generator-node.toml");
        std::fs::write(
            &config,
            format!("[samples]\nimage_size = 128\ntile = 16\nbatches = {BATCHES}\nangles_deg = [10.0, 40.0]\n"),
        )
        .unwrap();
        let arguments = ["--backend", "cpu", "--config", config.to_str().unwrap()];
        let generator = Daemon::start("generator-node", free_port(), &arguments);
        let volume = Series::open(&recorded_series(), &Options::default()).unwrap().read(3).unwrap();
        let (grid, voxel_type) = (*volume.grid(), volume.voxels().voxel_type());
        let options = lamina_client::RunOptions::new(&generator.url(), "study", "density", grid, voxel_type);
        let mut client = lamina_client::Client::connect(options).unwrap();
        client.push(7, 0.0, &lamina_client::Brick::new([0; 3], grid.dims(), volume.voxels())).unwrap();
        client.close();
        Self { _folder: folder, generator }
    }

    fn viz(&self) -> Daemon {
        Daemon::start("viz-node", free_port(), &["--backend", "cpu", "--generator", &self.generator.url()])
    }

    async fn control(&self) -> ControlClient<Channel> {
        let control = ControlClient::new(connect(&self.generator.url(), Role::Generator, None).await.unwrap());
        // The step's report says that trials have something to hold.
        control.clone().watch(v1::WatchRequest {}).await.unwrap().into_inner().message().await.unwrap().unwrap();
        control
    }

    /// Trials, once `viewers` viz-nodes subscribe.
    async fn remote(&self, viewers: usize) -> Result<Remote, TrialError> {
        let control = self.control().await;
        self.viewers(&control, viewers).await;
        Remote::open(&control, &self.generator.url(), &None, false).await
    }

    async fn viewers(&self, control: &ControlClient<Channel>, n: usize) -> Vec<v1::Viewer> {
        let mut lists = control.clone().viewers(v1::ViewersRequest {}).await.unwrap().into_inner();
        loop {
            let list = lists.message().await.unwrap().unwrap();
            if list.viewers.len() == n {
                return list.viewers;
            }
        }
    }
}

fn run<T>(work: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(work)
}

fn candidates(n: u32) -> Vec<GenerationParams> {
    (0..n).map(|k| GenerationParams::vdi(24 + 8 * (k / 4), 0.01 + 0.03 * f64::from(k % 4)).unwrap()).collect()
}

/// Measurements a viz-node has answered with.
fn measured_by(viz: &str) -> u32 {
    metric(viz, "lamina_trials_total").unwrap_or(0.0) as u32
}

/// What does not depend on the clock.
fn figures(rows: &[Result<Measurement, Invalid>]) -> Vec<(u64, u64, Vec<f64>)> {
    let row = |m: &Measurement| (m.cost.size_bytes, m.cost.elements, m.quality.batch_mse());
    rows.iter().map(|r| row(r.as_ref().unwrap())).collect()
}

/// Lines logged by this thread while it lives.
struct Log(Arc<Mutex<Vec<u8>>>, #[allow(dead_code, reason = "kept open as long as the log")] Box<dyn std::any::Any>);

struct Sink(Arc<Mutex<Vec<u8>>>);

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Log {
    fn start() -> Self {
        use tracing_subscriber::util::SubscriberInitExt;
        let text = Arc::new(Mutex::new(Vec::new()));
        let sink = text.clone();
        let log = tracing_subscriber::fmt().with_ansi(false).with_writer(move || Sink(sink.clone()));
        Self(text, Box::new(log.set_default()))
    }

    /// Warnings that name `what`.
    fn warnings(&self, what: &str) -> Vec<String> {
        let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
        text.lines().filter(|l| l.contains("WARN") && l.contains(what)).map(str::to_owned).collect()
    }
}

#[test]
fn two_viewers_share_a_study_and_find_what_one_finds() {
    let cluster = Cluster::start();
    let one = cluster.viz();
    let candidates = candidates(12);
    run(async {
        let mut remote = cluster.remote(1).await.unwrap();
        assert_eq!((remote.step(), remote.batches()), (7, BATCHES));
        let alone = figures(&remote.evaluate(&candidates, Batches::All).await.unwrap());
        assert!(alone.iter().all(|(bytes, segments, mse)| *bytes > 0 && *segments > 0 && mse.len() == 16));
        assert_eq!(measured_by(&one.url()), 12);

        // What is known is not asked again, and answers keep the order of the question.
        let again = remote.evaluate(&[candidates[3], candidates[0], candidates[3]], Batches::first(4)).await.unwrap();
        let first = |n: usize| (alone[n].0, alone[n].1, alone[n].2[..4].to_vec());
        assert_eq!(figures(&again), [first(3), first(0), first(3)]);
        assert_eq!(measured_by(&one.url()), 12);

        // One march says for many gammas what one VDI after the other costs.
        let gammas: Vec<f64> = candidates[..4].iter().map(GenerationParams::gamma).collect();
        let sizes = remote.sizes(&candidates[0], &gammas).await.unwrap();
        for (cost, (bytes, segments, _)) in sizes.iter().zip(&alone) {
            assert_eq!((cost.size_bytes, cost.elements), (*bytes, *segments));
            assert_eq!(cost.generation, sizes[0].generation);
        }

        assert!(remote.time(&candidates[0]).await.unwrap().unwrap() > Duration::ZERO);
        assert_eq!(measured_by(&one.url()), 12);

        let two = cluster.viz();
        let shared = cluster.remote(2).await.unwrap().evaluate(&candidates, Batches::All).await.unwrap();
        assert_eq!(figures(&shared), alone);
        let counts = [measured_by(&one.url()) - 12, measured_by(&two.url())];
        assert!(counts.iter().sum::<u32>() == 12 && counts.iter().all(|&n| n > 1), "{counts:?}");
    });
}

#[test]
fn batches_asked_for_in_parts_are_those_asked_for_at_once() {
    let cluster = Cluster::start();
    let _viz = cluster.viz();
    // More than a viz-node keeps: some must be sent again.
    let candidates = candidates(12);
    run(async {
        let at_once = cluster.remote(1).await.unwrap().evaluate(&candidates, Batches::All).await.unwrap();
        let mut remote = cluster.remote(1).await.unwrap();
        let costs = remote.evaluate(&candidates, Batches::None).await.unwrap();
        assert!(costs.iter().all(|c| c.as_ref().unwrap().quality.batches() == 0));
        let some = remote.evaluate(&candidates, Batches::first(4)).await.unwrap();
        assert!(some.iter().all(|c| c.as_ref().unwrap().quality.batches() == 4));
        let all = remote.evaluate(&candidates, Batches::All).await.unwrap();
        assert_eq!(figures(&all), figures(&at_once));
        for (cost, all) in costs.iter().zip(&all) {
            assert_eq!(
                cost.as_ref().unwrap().cost,
                all.as_ref().unwrap().cost,
                "the cost stays the one first measured"
            );
        }
    });
}

/// Loses one of two viewers in the middle of a study by `lose`, which may leave its process there.
fn study_without_one(lose: fn(Daemon) -> Option<Daemon>) {
    let log = Log::start();
    let cluster = Cluster::start();
    let (lost, other) = (cluster.viz(), cluster.viz());
    let (url, address) = (lost.url(), lost.address.to_string());
    let candidates = candidates(80);
    run(async {
        let mut remote = cluster.remote(2).await.unwrap();
        let loser = std::thread::spawn(move || {
            assert!(wait_for(Duration::from_secs(20), || measured_by(&url) > 1));
            lose(lost)
        });
        let rows = remote.evaluate(&candidates, Batches::All).await.unwrap();
        loser.join().unwrap().into_iter().for_each(Daemon::kill);
        let expected = cluster.remote(1).await.unwrap().evaluate(&candidates, Batches::All).await.unwrap();
        assert_eq!(figures(&rows), figures(&expected));
        assert_eq!(rows.iter().filter(|r| r.is_ok()).count(), candidates.len());
    });
    assert!(!log.warnings(&address).is_empty(), "the log names the lost one");
    assert!(log.warnings(&other.address.to_string()).is_empty());
}

#[test]
fn a_viewer_killed_in_a_study_is_named_and_its_trials_are_measured_by_the_other() {
    study_without_one(|viewer| {
        viewer.kill();
        None
    });
}

#[test]
fn a_viewer_that_hangs_in_a_study_is_named_and_its_trials_are_measured_by_the_other() {
    study_without_one(|viewer| {
        viewer.signal("STOP");
        Some(viewer)
    });
}

async fn subscribe(cluster: &Cluster, quality_address: &str) -> Result<tonic::Streaming<v1::Delivery>, Status> {
    let request = v1::SubscribeTrialsRequest { quality_address: quality_address.to_owned() };
    let channel = connect(&cluster.generator.url(), Role::Generator, None).await.unwrap();
    Ok(FramesClient::new(channel).subscribe_trials(request).await?.into_inner())
}

#[test]
fn a_trial_is_answered_as_it_was_asked() {
    let cluster = Cluster::start();
    let viz = cluster.viz();
    run(async {
        let mut control = cluster.control().await;
        let viewers = cluster.viewers(&control, 1).await;
        assert_eq!(viewers[0].address, viz.url(), "without a quality_address it is where the viz-node listens");
        let params = |gamma| {
            let vdi = Vdi { resolution: 32, gamma, opacity_cutoff: 1.0, step_voxels: 0.5 };
            Some(v1::GenerationParams { kind: Some(Kind::Vdi(vdi)) })
        };
        let ask = |trial_id, viewer: &str, gammas: Vec<f64>| v1::TrialRequest {
            trial_id,
            params: params(0.02),
            viewer: viewer.into(),
            gammas,
            ..Default::default()
        };
        let viewer = viewers[0].viewer.as_str();
        let requests = vec![
            ask(1, "nobody", vec![]),
            ask(2, viewer, vec![]),
            ask(3, "", vec![0.1, f64::NAN]),
            ask(4, "", vec![0.1; 1025]),
            v1::TrialRequest { trial_id: 5, params: params(-1.0), ..Default::default() },
            ask(6, "", vec![0.3, 0.1]),
            v1::TrialRequest { time_alone: true, ..ask(7, viewer, vec![]) },
        ];
        let mut replies = control.trials(stream::iter(requests)).await.unwrap().into_inner();
        let mut got = Vec::new();
        while let Some(reply) = replies.message().await.unwrap() {
            got.push(reply);
        }
        assert_eq!(got.iter().map(|r| r.trial_id).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!((got[0].step, got[0].batches), (7, BATCHES), "the step held is said first");
        assert_eq!((got[1].viewer.as_str(), got[2].viewer.as_str()), ("", viewer));
        assert_eq!((got[1].cost, got[1].refusal.as_str()), (got[2].cost, ""), "not generated again to be sent");
        assert!(got[1].cost.unwrap().size_bytes > 0);
        for (reply, words) in [(&got[3], ["gamma", "NaN"]), (&got[4], ["1025", "1024"]), (&got[5], ["gamma", "-1"])] {
            assert!(words.iter().all(|w| reply.refusal.contains(w)), "{}", reply.refusal);
        }
        assert!(got[6].costs[0].size_bytes < got[6].costs[1].size_bytes && got[6].viewer.is_empty());
        let timed = got[7].cost.unwrap();
        assert!(timed.generation_ns > 0 && got[7].viewer.is_empty());
        assert_eq!((timed.size_bytes, timed.encode_ns), (0, 0), "neither encoded nor sent");

        let channel = connect(&viz.url(), Role::Viewer, None).await.unwrap();
        let mut quality = v1::quality_client::QualityClient::new(channel);
        let mut measure = async |trial_id, first_batch, batches| {
            let request = v1::QualityRequest { trial_id, first_batch, batches, study: None };
            let mut replies = quality.measure(request).await?.into_inner();
            loop {
                let reply = replies.message().await?.unwrap();
                if !reply.views.is_empty() {
                    return Ok::<_, Status>(reply.views.iter().map(|v| v.batch_mse.len()).collect::<Vec<_>>());
                }
            }
        };
        assert_eq!(measure(2, 3, 2).await.unwrap(), [2, 2]);
        assert_eq!(measure(2, 3, 0).await.unwrap(), [13, 13]);
        for (first, n) in [(0, 17), (16, 0), (16, 1), (u32::MAX, u32::MAX)] {
            let status = measure(2, first, n).await.unwrap_err();
            assert!(status.code() == Code::InvalidArgument && status.message().contains("0..16"), "{status}");
        }
    });
}

#[test]
fn without_viewers_or_with_an_address_that_is_none_the_remedy_is_named() {
    let cluster = Cluster::start();
    run(async {
        // One that shows, but measures nothing.
        let channel = connect(&cluster.generator.url(), Role::Generator, None).await.unwrap();
        let _silent = FramesClient::new(channel).subscribe(v1::SubscribeRequest::default()).await.unwrap();
        let error = cluster.remote(0).await.err().unwrap().to_string();
        assert!(
            [&cluster.generator.url(), "viz-node", "quality_address"].iter().all(|w| error.contains(*w)),
            "{error}"
        );
        let refused = subscribe(&cluster, "somewhere:7102").await.err().unwrap();
        assert!(refused.code() == Code::InvalidArgument && refused.message().contains("http://HOST:PORT"), "{refused}");
        let _any = subscribe(&cluster, "http://0.0.0.0:7102").await.unwrap();
        let listed = cluster.viewers(&cluster.control().await, 1).await;
        assert_eq!(listed[0].address, "http://127.0.0.1:7102", "0.0.0.0 is where the subscriber connects from");
    });
}
