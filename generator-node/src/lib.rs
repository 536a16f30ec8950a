//! The generator-node: stands beside a simulation, takes its time steps in and gives Volumetric Depth Images out.
//!
//! Ingest -> pipeline -> publish, and control takes parameters in. Nothing leaves it but VDIs, reduced
//! volumes and sampled reference colors.

pub mod config;
mod control;
mod delivery;
pub mod ingest;
mod node_state;
mod overhead;
mod pipeline;
mod publish;
mod rate_control;
mod schedule;
mod step;
mod subscribers;
mod trials;

pub use config::Config;

use lamina_compute::CpuShare;
use lamina_raycast::Backend;
use lamina_rpc::daemon::{NodeError, Shutdown, serve};
use lamina_rpc::{MAX_MESSAGE_BYTES, v1};
use lamina_shared_memory::{Receiver, Rings};
use std::{sync::Arc, time::Duration};
use tokio::net::TcpListener;

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
    let overhead = overhead::Overhead::new(share.clone());
    let ingest = Arc::new(ingest::Ingest::new(
        config.memory_bytes,
        config.waiting_steps as usize,
        Duration::from_secs_f64(config.idle_secs),
        config.scene.clone(),
        overhead.clone(),
        share_memory(&config),
    ));
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
    let pipeline =
        tokio::spawn(pipeline::run(ingest.clone(), node.clone(), config.reference_every, config.live_batches));

    type Ingest = v1::ingest_server::IngestServer<ingest::IngestService>;
    type Frames = v1::frames_server::FramesServer<publish::FramesService>;
    type Control = v1::control_server::ControlServer<control::ControlService>;
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<Ingest>().await;
    health.set_serving::<Frames>().await;
    health.set_serving::<Control>().await;
    let router = tonic::transport::Server::builder()
        // A peer that vanished without a word gives its reservations back.
        .http2_keepalive_interval(Some(Duration::from_secs(10)))
        .http2_keepalive_timeout(Some(Duration::from_secs(10)))
        .add_service(health_service)
        .add_service(Ingest::new(ingest::IngestService(ingest)).max_decoding_message_size(MAX_MESSAGE_BYTES))
        .add_service(Frames::new(publish::FramesService(publisher)))
        .add_service(Control::new(control::ControlService(node)));
    tracing::info!(address = %listener.local_addr().map_or_else(|_| config.listen.to_string(), |a| a.to_string()), "generator-node listens");
    let served = serve(router, listener, shutdown).await;
    pipeline.abort();
    served
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
