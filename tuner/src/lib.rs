//! The tuner: finds, and keeps finding, the generation parameters that give the best picture under the user's limit.
//!
//! Algorithm 1 and a search over [`evaluator::Evaluator`], so that they run without sockets too. The tuner sees numbers, never voxels or pixels.

pub mod characteristic_steps;
pub mod config;
pub mod contract;
mod control_loop;
pub mod evaluator;
pub mod interval;
mod key_frame;
mod live;
pub mod pareto;
mod provisional;
pub mod push;
pub mod remote;
mod run_state;
pub mod search;
mod ssim_limit;
mod status;
mod transfer;
pub mod tune;
pub mod units;
pub mod utility;

pub use config::Config;
pub use contract::Contract;
pub use utility::Utility;

use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Access, AllowRoles, MOST_STREAMS, NodeError, Shutdown, serve};
use lamina_rpc::v1::tuning_server::TuningServer;
use std::sync::Arc;
use tokio::net::TcpListener;

/// Runs the tuner, its status served on `listener`, until `shutdown` completes.
///
/// # Errors
/// If the configuration cannot be used or the transport fails.
pub async fn run(config: Config, listener: TcpListener, shutdown: Shutdown) -> Result<(), NodeError> {
    let bad = |e: lamina_model::Invalid| NodeError::Config { path: "tuner".to_owned(), reason: e.to_string() };
    let base = config.base().map_err(bad)?;
    let address = listener.local_addr().unwrap_or(config.listen);
    let (access, credentials) = Access::of(address, config.credentials.as_deref(), config.insecure)?;
    let status = Arc::new(status::Status::default());
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<TuningServer<status::StatusService>>().await;
    let router = tonic::transport::Server::builder()
        .max_concurrent_streams(MOST_STREAMS)
        .add_service(health_service)
        .add_service(TuningServer::with_interceptor(
            status::StatusService(status.clone()),
            AllowRoles(&[Role::Viewer]),
        ));
    tracing::info!(%address, "tuner listens");
    let tuning = tokio::spawn(control_loop::run(config, credentials, base, status));
    // At once: a study would take the other nodes' going for a fault.
    let stopping = async move {
        shutdown.await;
        tuning.abort();
    };
    serve(router, listener, access, Box::pin(stopping)).await
}
