//! The generator-node: stands beside a simulation, takes its time steps in and gives Volumetric Depth Images out.
//!
//! Ingest -> pipeline -> publish, and control takes parameters in. Nothing leaves it but VDIs, reduced
//! volumes and sampled reference colors.

mod arrival;
pub mod config;
mod control;
mod counters;
mod delivery;
mod group;
pub mod ingest;
mod key_frames;
mod metrics;
mod node_state;
mod overhead;
mod pipeline;
mod publish;
mod rate_control;
mod schedule;
mod spans;
mod steering;
mod step;
mod subscribers;
mod trials;
mod triggers;

pub use config::Config;

use arrival::Steps;
use ingest::{Ingest, IngestService};
use lamina_compute::CpuShare;
use lamina_mpi::{Inbox, Outbox};
use lamina_raycast::Backend;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Access, AllowRoles, NodeError, Running, Shutdown, collect_traces, serve_grpc};
use lamina_rpc::v1::group_message::Kind;
use lamina_rpc::{MAX_MESSAGE_BYTES, v1};
use lamina_shared_memory::{Receiver, Rings};
use overhead::Overhead;
use parking_lot::Mutex;
use std::{sync::Arc, time::Duration};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tonic::service::Routes;
use tonic::service::interceptor::InterceptedService;
use tonic_health::server::HealthReporter;
use triggers::{Triggers, Webhook};

/// Runs the node on `listener` until `shutdown` completes, its rays cast by `backend` within `share` of the processor. Of `settings` it
/// takes up while it runs what is in [`Config::LIVE`].
///
/// # Errors
/// If the transport fails.
pub fn run(
    settings: watch::Receiver<Config>,
    backend: Backend,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
) -> Running {
    Box::pin(async move {
        let config = settings.borrow().clone();
        let access = access(&config, &listener)?;
        let overhead = Overhead::new(share.clone());
        let ingest = Arc::new(ingest(&config, overhead.clone()));
        let steps = Steps::Own(ingest.clone());
        run_pipeline(settings, backend, (share, overhead), (ingest, steps), (listener, access), shutdown).await
    })
}

/// The same as a member of a group of nodes, which `mesh` connects: its root, member 0, does what [`run`] does, of the steps that all
/// members hold together; the others take bricks in and work for it.
///
/// # Errors
/// If the transport fails.
pub fn run_member(
    settings: watch::Receiver<Config>,
    backend: Backend,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
    (outbox, inbox): (Outbox, Inbox),
) -> Running {
    Box::pin(async move {
        let config = settings.borrow().clone();
        let access = access(&config, &listener)?;
        let (rank, members) = (outbox.rank(), outbox.size());
        let overhead = Overhead::new(share.clone());
        let door = Arc::new(group::Door::new(outbox.clone()));
        let own_door = (rank == 0).then(|| door.clone() as Arc<dyn ingest::AssignMember>);
        let ingest = Arc::new(ingest(&config, overhead.clone()).of_group(members, own_door));
        let (channels, held) = (group::receive(inbox), group::HeldSteps::default());
        let member = group::Member::new(outbox.clone(), channels.member, held.clone(), backend.clone());
        std::thread::Builder::new().name("member".to_owned()).spawn(|| member.run()).map_err(NodeError::Thread)?;
        let listens = tokio::spawn(door.clone().listen((ingest.clone(), held.clone()), channels.events));
        let announces = tokio::spawn(group::announce(ingest.clone(), held, outbox.clone()));
        group::send(&outbox, 0, 0, Kind::Ready(group::ready(&config, &listener, &access)));
        let served = if rank == 0 {
            let root = Arc::new(group::Root::new(outbox, channels.replies));
            let steps = Steps::Group(root, door);
            run_pipeline(settings, backend, (share, overhead), (ingest, steps), (listener, access), shutdown).await
        } else {
            tokio::spawn(adopt(settings, share, ingest.clone(), None));
            let (routes, _) = routes(ingest.clone()).await;
            let metrics = Arc::new(move |text: &mut _| metrics::write_ingest(&ingest, text));
            serve_grpc(routes, metrics, listener, access, shutdown).await
        };
        listens.abort();
        announces.abort();
        served
    })
}

fn access(config: &Config, listener: &TcpListener) -> Result<Access, NodeError> {
    let address = listener.local_addr().unwrap_or(config.listen);
    Ok(Access::of(address, config.credentials.as_deref(), config.insecure)?.0)
}

fn ingest(config: &Config, overhead: Arc<Overhead>) -> Ingest {
    Ingest::new(
        config.memory_bytes,
        config.waiting_steps as usize,
        Duration::from_secs_f64(config.idle_secs),
        config.scene.clone(),
        overhead,
        share_memory(config),
    )
}

/// Takes up what the configuration says while the node runs; the pipeline sees the rest of it itself.
async fn adopt(
    mut settings: watch::Receiver<Config>,
    share: CpuShare,
    ingest: Arc<Ingest>,
    publisher: Option<Arc<publish::Publisher>>,
) {
    while settings.changed().await.is_ok() {
        let Config { memory_bytes, waiting_steps, history_bytes, idle_secs, cpu_share, .. } =
            *settings.borrow_and_update();
        share.set_limit(cpu_share);
        ingest.set_limits(memory_bytes, waiting_steps as usize, Duration::from_secs_f64(idle_secs));
        if let Some(publisher) = &publisher {
            publisher.set_history_bytes(history_bytes);
        }
    }
}

/// How long a node that is to stop works on steps that it has admitted.
const DRAIN: Duration = Duration::from_secs(10);

/// The service that takes bricks in, and its health.
async fn routes(ingest: Arc<Ingest>) -> (Routes, HealthReporter) {
    type Service = v1::ingest_server::IngestServer<IngestService>;
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<Service>().await;
    let routes = Routes::new(health_service).add_service(InterceptedService::new(
        Service::new(IngestService(ingest)).max_decoding_message_size(MAX_MESSAGE_BYTES),
        AllowRoles(&[Role::Simulation]),
    ));
    (routes, health)
}

/// Turns `steps` into frames, and answers who watches and who tunes.
async fn run_pipeline(
    settings: watch::Receiver<Config>,
    backend: Backend,
    (share, overhead): (CpuShare, Arc<Overhead>),
    (ingest, steps): (Arc<Ingest>, Steps),
    (listener, access): (TcpListener, Access),
    shutdown: Shutdown,
) -> Result<(), NodeError> {
    let _traces = collect_traces(Role::Generator);
    let config = settings.borrow().clone();
    let publisher = Arc::new(publish::Publisher::new(config.history_bytes));
    tokio::spawn(adopt(settings.clone(), share.clone(), ingest.clone(), Some(publisher.clone())));
    let node = Arc::new(node_state::NodeState::new(node_state::Parts {
        params: config.params,
        options: config.encode_options(),
        backend,
        segmentation: config.segmentation,
        plan: config.samples.clone(),
        share,
        overhead,
        publisher: publisher.clone(),
    }));
    let (stop, stopped) = watch::channel(false);
    let triggers = Triggers::new(&config.trigger, config.means(matches!(steps, Steps::Group(..))))?;
    ingest.steering().set_triggers(triggers.specs());
    let triggers = Arc::new(Mutex::new(triggers));
    let settings = pipeline::Settings {
        config: settings,
        triggers: triggers.clone(),
        trigger_folder: config.trigger_folder.clone(),
        webhook: config.webhook.clone().map(Webhook::start),
        steering: ingest.steering().clone(),
    };
    let pipeline = pipeline::run(steps, node.clone(), settings, stopped);
    let pipeline = tokio::spawn(pipeline);
    let drained = {
        let (ingest, node) = (ingest.clone(), node.clone());
        async move {
            shutdown.await;
            // What was admitted is shown, as fast as it can be; nothing new is.
            ingest.stop();
            node.overhead.limit(None);
            stop.send_replace(true);
            let aborted = pipeline.abort_handle();
            if tokio::time::timeout(DRAIN, pipeline).await.is_err() {
                tracing::warn!("steps were left that took longer than {DRAIN:?}");
                aborted.abort();
            }
        }
    };

    type Frames = v1::frames_server::FramesServer<publish::FramesService>;
    type Control = v1::control_server::ControlServer<control::ControlService>;
    let (routes, health) = routes(ingest.clone()).await;
    health.set_serving::<Frames>().await;
    health.set_serving::<Control>().await;
    let (of_ingest, of_node) = (ingest.clone(), node.clone());
    let metrics = Arc::new(move |text: &mut _| {
        metrics::write_ingest(&of_ingest, text);
        metrics::write_pipeline(&of_node, text);
    });
    let routes = routes
        .add_service(Frames::with_interceptor(
            publish::FramesService { publisher, ingest, triggers },
            AllowRoles(&[Role::Viewer]),
        ))
        .add_service(Control::with_interceptor(control::ControlService(node), AllowRoles(&[Role::Tuner])));
    tracing::info!(address = %listener.local_addr().map_or_else(|_| config.listen.to_string(), |a| a.to_string()), "generator-node listens");
    serve_grpc(routes, metrics, listener, access, Box::pin(drained)).await
}

/// Lets simulations on this host share memory with the node, if the configuration and the system allow it.
fn share_memory(config: &Config) -> Option<ingest::SharedMemory> {
    if !config.shared_memory {
        return None;
    }
    match Receiver::bind(config.memory_bytes) {
        Ok(receiver) => {
            let (name, rings) = (receiver.name().to_owned(), Arc::new(Rings::default()));
            tokio::spawn(receiver.serve(rings.clone()));
            Some(ingest::SharedMemory { name, rings })
        }
        Err(reason) => {
            tracing::info!(%reason, "no shared memory; all bricks come through connections");
            None
        }
    }
}
