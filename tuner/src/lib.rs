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
use lamina_rpc::daemon::{Access, AllowRoles, Running, Shutdown, collect_traces, serve_grpc};
use lamina_rpc::v1::tuning_server::TuningServer;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tonic::service::Routes;

/// Runs the tuner, its status served on `listener`, until `shutdown` completes. Of `settings` it takes up while it runs what is in
/// [`Config::LIVE`].
///
/// # Errors
/// If the configuration cannot be used or the transport fails.
pub fn run(settings: watch::Receiver<Config>, listener: TcpListener, shutdown: Shutdown) -> Running {
    Box::pin(async move {
        let _traces = collect_traces(Role::Tuner);
        let config = settings.borrow().clone();
        let base = config.base()?;
        let address = listener.local_addr().unwrap_or(config.listen);
        let (access, credentials) = Access::of(address, config.credentials.as_deref(), config.insecure)?;
        let status = Arc::new(status::Status::default());
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_serving::<TuningServer<status::StatusService>>().await;
        let service =
            TuningServer::with_interceptor(status::StatusService(status.clone()), AllowRoles(&[Role::Viewer]));
        let routes = Routes::new(health_service).add_service(service);
        let of_status = status.clone();
        let metrics = Arc::new(move |text: &mut _| of_status.write_metrics(text));
        tracing::info!(%address, "tuner listens");
        let tuning = tokio::spawn(control_loop::run(settings, credentials, base, status));
        // At once: a study would take the other nodes' going for a fault.
        let stopping = async move {
            shutdown.await;
            tuning.abort();
        };
        serve_grpc(routes, metrics, listener, access, Box::pin(stopping)).await
    })
}
