//! All three nodes in this process, on loopback, as the binaries run them.

use anyhow::{Context, bail};
use lamina_compute::CpuShare;
use lamina_compute::gpu::Choice;
use lamina_model::{GenerationParams, Representation, SamplePlan, Scene};
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Shutdown, listen};
use lamina_rpc::v1::{self, control_client::ControlClient, tuning_client::TuningClient};
use lamina_tuner::Contract;
use lamina_tuner::push::{limits_alone, push};
use lamina_tuner::remote::connect;
use lamina_tuner::search::SearchGrid;
use lamina_vdi_render::Kernels;
use lamina_viz_node::Store;
use lamina_viz_node::store::{QualityStatus, StepRow};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::sync::watch;
use tonic::transport::Channel;

/// How the nodes are set up.
#[derive(Debug)]
pub struct Setup {
    /// Where simulations connect.
    pub listen: SocketAddr,
    /// Where the page is.
    pub viewer: SocketAddr,
    /// Everybody who reaches the addresses may use them.
    pub insecure: bool,
    /// Folder for VDIs; memory without one.
    pub store: Option<PathBuf>,
    /// Bytes for time steps in the generator-node.
    pub memory_bytes: u64,
    /// Where quality is measured.
    pub samples: SamplePlan,
    /// What casts the rays.
    pub backend: Choice,
    /// How to show runs that do not say; `None`: chosen from the first step.
    pub scene: Option<Scene>,
    /// Parameters before tuning, or for ever; `None`: the generator-node's own.
    pub params: Option<GenerationParams>,
    /// Sampling step of every candidate, voxels.
    pub step_voxels: f64,
    /// Processor time of all nodes together.
    pub share: CpuShare,
    /// Every live step is compared at all sampled pixels, not at a slice of them.
    pub measure_all: bool,
    /// What the tuner is to reach; `None`: no tuner.
    pub tuning: Option<Tuning>,
}

/// What the tuner is to do.
#[derive(Debug)]
pub struct Tuning {
    /// The user's limit.
    pub contract: Contract,
    /// What steps may be turned into.
    pub representations: Vec<Representation>,
    /// Parameters of VDIs it tries.
    pub grid: SearchGrid,
    /// Tune again every n-th step.
    pub retune_every: u64,
    /// The most share of the time that studies after the first may take.
    pub budget: f64,
}

/// The running nodes.
#[derive(Debug)]
pub struct Nodes {
    runtime: Runtime,
    stop: watch::Sender<bool>,
    tuner: Option<TuningClient<Channel>>,
    /// What the viz-node has recorded.
    pub store: Arc<Store>,
    /// The generator-node's address.
    pub generator: String,
    /// The page's address.
    pub viewer: SocketAddr,
}

/// How long nothing may happen before a headless run gives up.
const PATIENCE: Duration = Duration::from_secs(300);

impl Nodes {
    /// Starts them.
    pub fn start(setup: Setup) -> anyhow::Result<Self> {
        let nodes = [(setup.listen, "generator-node"), (setup.viewer, "viz-node")];
        if let Some((address, node)) = nodes.iter().find(|(a, _)| !setup.insecure && !a.ip().is_loopback()) {
            bail!(
                "{address} can be reached from other hosts: give --insecure to let everybody in, or start {node} with --credentials"
            );
        }
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        let (stop, _) = watch::channel(false);
        let stopped = || -> Shutdown {
            let mut stopped = stop.subscribe();
            Box::pin(async move { drop(stopped.wait_for(|s| *s).await) })
        };
        let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));

        let config = lamina_generator_node::Config {
            listen: setup.listen,
            insecure: setup.insecure,
            memory_bytes: setup.memory_bytes,
            params: setup.params,
            scene: setup.scene,
            samples: setup.samples,
            live_batches: if setup.measure_all { 0 } else { lamina_generator_node::Config::default().live_batches },
            ..Default::default()
        };
        let listener = runtime.block_on(listen(setup.listen))?;
        let generator = format!("http://{}", reached_at(listener.local_addr()?));
        let kernels = Kernels::open(setup.backend)?;
        runtime.spawn(lamina_generator_node::run(
            watch::Sender::new(config.check()?).subscribe(),
            kernels.cast,
            setup.share.clone(),
            listener,
            stopped(),
        ));

        let config = lamina_viz_node::Config {
            generator: generator.clone(),
            insecure: setup.insecure,
            store: setup.store,
            ..Default::default()
        };
        let listener = runtime.block_on(listen(setup.viewer))?;
        let viewer = listener.local_addr()?;
        let store = lamina_viz_node::open_store(&config)?;
        runtime.spawn(lamina_viz_node::run(
            watch::Sender::new(config).subscribe(),
            store.clone(),
            kernels.draw,
            setup.share,
            listener,
            stopped(),
        ));

        let mut tuner = None;
        if let Some(tuning) = setup.tuning {
            // The first step keeps the limits too, so they have to be there before it.
            runtime.block_on(announce(&generator, &tuning))?;
            let config = lamina_tuner::Config {
                generator: generator.clone(),
                contract: tuning.contract,
                representations: tuning.representations,
                grid: tuning.grid,
                retune_every: tuning.retune_every,
                budget: tuning.budget,
                step_voxels: setup.step_voxels,
                ..Default::default()
            };
            config.base()?;
            let listener = runtime.block_on(listen(any_port))?;
            let address = format!("http://{}", listener.local_addr()?);
            runtime.spawn(lamina_tuner::run(watch::Sender::new(config).subscribe(), listener, stopped()));
            let channel = runtime.block_on(connect(&address, Role::Tuner, None))?;
            tuner = Some(TuningClient::new(channel));
        }
        Ok(Self { runtime, stop, tuner, store, generator, viewer })
    }

    /// A flag that Ctrl-C and SIGTERM set.
    pub fn stopped(&self) -> impl Fn() -> bool + use<> {
        let stop = Arc::new(AtomicBool::new(false));
        let set = stop.clone();
        self.on_stop_signal(move || set.store(true, Ordering::Relaxed));
        move || stop.load(Ordering::Relaxed)
    }

    /// Completes on Ctrl-C or SIGTERM: `on_stop` is called from another thread.
    fn on_stop_signal(&self, on_stop: impl FnOnce() + Send + 'static) {
        self.runtime.spawn(async {
            lamina_rpc::daemon::stop_signal().await;
            on_stop();
        });
    }

    /// The tuner's status; `None` if there is no tuner.
    pub fn tuner_status(&self, with_trials: bool) -> anyhow::Result<Option<v1::TunerStatus>> {
        let Some(mut tuner) = self.tuner.clone() else { return Ok(None) };
        let status = self.runtime.block_on(tuner.status(v1::TunerStatusRequest { with_trials }));
        Ok(Some(status.context("asking the tuner")?.into_inner()))
    }

    /// All trials of the tuner so far.
    pub fn trials(&self) -> anyhow::Result<Vec<v1::TrialRecord>> {
        Ok(self.tuner_status(true)?.map(|status| status.trials).unwrap_or_default())
    }

    /// How many studies the tuner has made.
    pub fn studies(&self) -> anyhow::Result<u64> {
        Ok(self.tuner_status(false)?.map_or(0, |status| status.studies))
    }

    /// Waits until `step` is recorded and the tuner has dealt with it.
    pub fn settle(&self, step: u64, stop: &impl Fn() -> bool) -> anyhow::Result<Option<StepRow>> {
        let mut since = Instant::now();
        while !stop() {
            let row = self.store.row(step).filter(|row| row.measured != QualityStatus::Pending);
            let status = self.tuner_status(false)?;
            let tuned = status.as_ref().is_none_or(|s| s.steps_seen > step && !s.busy);
            if row.is_some() && tuned {
                return Ok(row);
            }
            if status.is_some_and(|s| s.busy) {
                since = Instant::now();
            }
            if since.elapsed() > PATIENCE {
                bail!(
                    "step {step} was not recorded and tuned within {PATIENCE:?}; RUST_LOG=info shows what the nodes do"
                );
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(None)
    }

    /// Stops all nodes.
    pub fn stop(self) {
        self.stop.send_replace(true);
        self.runtime.shutdown_timeout(Duration::from_secs(2));
    }
}

/// Where a node that listens on `address` is reached from this host.
fn reached_at(address: SocketAddr) -> SocketAddr {
    let ip = if address.ip().is_unspecified() { Ipv4Addr::LOCALHOST.into() } else { address.ip() };
    SocketAddr::new(ip, address.port())
}

/// Tells the generator-node the limits.
async fn announce(generator: &str, tuning: &Tuning) -> anyhow::Result<()> {
    let control = ControlClient::new(connect(generator, Role::Generator, None).await?);
    push(&control, &limits_alone(&tuning.contract, &tuning.representations)).await?;
    Ok(())
}
