//! The generator-node: stands beside a simulation, takes its time steps in and gives Volumetric Depth Images out.
//!
//! Ingest -> pipeline -> publish, and control takes parameters in. Nothing leaves it but VDIs, reduced
//! volumes and sampled reference colors.

pub mod config;
mod control;
mod delivery;
mod group;
pub mod ingest;
mod key_frames;
mod node_state;
mod overhead;
mod pipeline;
mod publish;
mod rate_control;
mod schedule;
mod steering;
mod step;
mod subscribers;
mod trials;
mod triggers;

pub use config::Config;
pub use triggers::{Action, TriggerSpec};

use ingest::{Ingest, IngestService};
use lamina_compute::CpuShare;
use lamina_mpi::{Inbox, Outbox};
use lamina_raycast::Backend;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Access, AllowRoles, MOST_STREAMS, NodeError, Shutdown, serve};
use lamina_rpc::v1::group_message::Kind;
use lamina_rpc::{MAX_MESSAGE_BYTES, v1};
use lamina_shared_memory::{Receiver, Rings};
use overhead::Overhead;
use pipeline::Steps;
use std::{sync::Arc, time::Duration};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::server::Router;
use tonic_health::server::HealthReporter;
use triggers::Triggers;

/// Runs the node on `listener` until `shutdown` completes, its rays cast by `backend` within `share` of the processor.
///
/// # Errors
/// If the transport fails.
pub async fn run(
    config: Config,
    backend: Backend,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
) -> Result<(), NodeError> {
    let access = access(&config, &listener)?;
    let overhead = Overhead::new(share.clone());
    let ingest = Arc::new(ingest(&config, overhead.clone()));
    let steps = Steps::Own(ingest.clone());
    run_pipeline(config, backend, (share, overhead), (ingest, steps), (listener, access), shutdown).await
}

/// The same as a member of a group of nodes, which `mesh` connects: its root, member 0, does what [`run`] does, of the steps that all
/// members hold together; the others take bricks in and work for it.
///
/// # Errors
/// If the transport fails.
pub async fn run_member(
    config: Config,
    backend: Backend,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
    (outbox, inbox): (Outbox, Inbox),
) -> Result<(), NodeError> {
    let access = access(&config, &listener)?;
    let (rank, members) = (outbox.rank(), outbox.size());
    let overhead = Overhead::new(share.clone());
    let door = Arc::new(group::Door::new(outbox.clone()));
    let own_door = (rank == 0).then(|| door.clone() as Arc<dyn ingest::AssignMember>);
    let ingest = Arc::new(ingest(&config, overhead.clone()).of_group(members, own_door));
    let (channels, held) = (group::receive(inbox), group::HeldSteps::default());
    let member = group::Member::new(outbox.clone(), channels.member, held.clone(), backend.clone());
    std::thread::Builder::new().name("member".to_owned()).spawn(|| member.run()).map_err(NodeError::Thread)?;
    let listens = tokio::spawn(door.clone().listen(ingest.clone(), channels.events));
    let announces = tokio::spawn(group::announce(ingest.clone(), held, outbox.clone()));
    group::send(&outbox, 0, 0, Kind::Ready(group::ready(&config, &listener, &access)));
    let served = if rank == 0 {
        let root = Arc::new(group::Root::new(outbox, channels.replies));
        let steps = Steps::Group(root, door);
        run_pipeline(config, backend, (share, overhead), (ingest, steps), (listener, access), shutdown).await
    } else {
        let (router, _) = router(ingest).await;
        serve(router, listener, access, shutdown).await
    };
    listens.abort();
    announces.abort();
    served
}

fn bad_config(error: &lamina_model::Invalid) -> NodeError {
    NodeError::Config { path: "configuration".to_owned(), reason: error.to_string() }
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

/// How long a node that is to stop works on steps that it has admitted.
const DRAIN: Duration = Duration::from_secs(10);

/// A server that takes bricks in, and its health.
async fn router(ingest: Arc<Ingest>) -> (Router, HealthReporter) {
    type Service = v1::ingest_server::IngestServer<IngestService>;
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<Service>().await;
    let router = tonic::transport::Server::builder()
        // A peer that vanished without a word gives its reservations back.
        .http2_keepalive_interval(Some(Duration::from_secs(10)))
        .http2_keepalive_timeout(Some(Duration::from_secs(10)))
        .max_concurrent_streams(MOST_STREAMS)
        .add_service(health_service)
        .add_service(InterceptedService::new(
            Service::new(IngestService(ingest)).max_decoding_message_size(MAX_MESSAGE_BYTES),
            AllowRoles(&[Role::Simulation]),
        ));
    (router, health)
}

/// Turns `steps` into frames, and answers who watches and who tunes.
async fn run_pipeline(
    config: Config,
    backend: Backend,
    (share, overhead): (CpuShare, Arc<Overhead>),
    (ingest, steps): (Arc<Ingest>, Steps),
    (listener, access): (TcpListener, Access),
    shutdown: Shutdown,
) -> Result<(), NodeError> {
    let publisher = Arc::new(publish::Publisher::new(config.history_bytes));
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
    let settings = pipeline::Settings {
        reference_every: config.reference_every,
        live_batches: config.live_batches,
        triggers: Triggers::new(&config.trigger).map_err(|e| bad_config(&e))?,
        trigger_folder: config.trigger_folder.clone(),
        steering: ingest.steering().clone(),
    };
    let pipeline = pipeline::run(steps, node.clone(), settings, stopped);
    let pipeline = tokio::spawn(pipeline);
    let drained = {
        let ingest = ingest.clone();
        async move {
            shutdown.await;
            // What was admitted is shown; nothing new is.
            ingest.stop();
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
    let (router, health) = router(ingest.clone()).await;
    health.set_serving::<Frames>().await;
    health.set_serving::<Control>().await;
    let router = router
        .add_service(Frames::with_interceptor(
            publish::FramesService { publisher, ingest },
            AllowRoles(&[Role::Viewer]),
        ))
        .add_service(Control::with_interceptor(control::ControlService(node), AllowRoles(&[Role::Tuner])));
    tracing::info!(address = %listener.local_addr().map_or_else(|_| config.listen.to_string(), |a| a.to_string()), "generator-node listens");
    serve(router, listener, access, Box::pin(drained)).await
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
