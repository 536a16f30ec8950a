//! The viz-node: takes VDIs in, renders them from any camera, and reports their PSNR against reference samples.
//!
//! Subscribe -> intake -> store -> painter -> web, and trials measured for the tuner. It sees no voxels but those of
//! reduced volumes.

pub mod config;
mod intake;
mod negotiation;
pub mod painter;
mod quality_service;
mod steering;
pub mod store;
mod subscribe;
mod trials;
mod web;

pub use config::Config;
pub use store::Store;
pub use web::assets::{EMBED, ENGINE};

use lamina_codec::DecodeLimits;
use lamina_compute::CpuShare;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{
    Access, AllowRoles, Refusals, Running, Shutdown, collect_traces, diagnosis, metrics_route, nowhere, serve,
};
use lamina_rpc::v1::quality_server::QualityServer;
use lamina_vdi_render::Backend;
use std::io::Write as _;
use std::sync::{Arc, atomic::AtomicBool};
use tokio::net::TcpListener;
use tokio::sync::watch;
use web::guard::{Guard, Rights};

/// Opens the store a configuration names.
///
/// # Errors
/// If its folder cannot be used.
pub fn open_store(config: &Config) -> Result<Arc<Store>, store::StoreError> {
    Ok(Arc::new(Store::open(config.store.as_deref(), config.memory_bytes, limits(config))?))
}

/// Takes up what the configuration says while the node runs.
async fn adopt(mut settings: watch::Receiver<Config>, share: CpuShare, guard: Arc<Guard>) {
    while settings.changed().await.is_ok() {
        let config = settings.borrow_and_update().clone();
        share.set_limit(config.cpu_share);
        guard.set_hosts(&config.hosts);
    }
}

fn limits(config: &Config) -> DecodeLimits {
    DecodeLimits { max_decoded_bytes: config.max_decoded_bytes }
}

/// Runs the node on `listener` until `shutdown` completes, within `share` of the processor. The page, the metrics and gRPC share
/// the port. Of `settings` it takes up while it runs what is in [`Config::LIVE`].
///
/// # Errors
/// If the listener fails, or the credentials cannot be used.
pub fn run(
    settings: watch::Receiver<Config>,
    store: Arc<Store>,
    backend: Backend,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
) -> Running {
    Box::pin(async move {
        let _traces = collect_traces(Role::Viewer);
        let config = settings.borrow().clone();
        let address = listener.local_addr().unwrap_or(config.listen);
        let (access, credentials) = Access::of(address, config.credentials.as_deref(), config.insecure)?;
        let negotiation = Arc::new(negotiation::Negotiation::new(store.clone()));
        let intake = Arc::new(intake::Intake::new(store.clone(), backend.clone(), share.clone(), limits(&config)));
        let connected = Arc::new(AtomicBool::new(false));
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_serving::<QualityServer<quality_service::QualityService>>().await;
        let grpc = tonic::service::Routes::new(health_service)
            .add_service(QualityServer::with_interceptor(
                quality_service::QualityService { intake: intake.clone(), negotiation: negotiation.clone() },
                AllowRoles(&[Role::Tuner]),
            ))
            .add_service(diagnosis())
            .into_axum_router();
        let steering = steering::SteeringDesk::new(config.clone(), credentials.clone(), store.clone());
        let steering = Arc::new(steering);
        let painter = Arc::new(painter::Painter::new(store.clone(), backend));
        let web = web::Web {
            store,
            painter,
            intake: intake.clone(),
            negotiation,
            steering: steering.clone(),
            connected: connected.clone(),
        };
        tracing::info!(%address, "viz-node listens");
        // An address that means "any" is completed by the generator-node.
        let own = format!("http{}://{address}", if access.is_secure() { "s" } else { "" });
        let page = access.reached_at(address).to_string();
        let guard = Arc::new(Guard::new(page, &config.hosts)?);
        if access.is_secure() {
            // Browsers have no certificate.
            let (watch, steer) = (guard.entrance(Rights::Watch), guard.entrance(Rights::Steer));
            // Whoever started the node may have closed its output.
            let _ = writeln!(std::io::stdout(), "watch it at {watch}\nsteer it at {steer}");
        }
        let config = Config { quality_address: Some(config.quality_address.unwrap_or(own)), ..config };
        let generator = config.generator.clone();
        let tasks = [
            tokio::spawn(adopt(settings, share, guard.clone())),
            tokio::spawn(subscribe::live(config.clone(), credentials.clone(), intake.clone(), connected)),
            tokio::spawn(subscribe::report(config.clone(), credentials.clone(), intake.clone())),
            tokio::spawn(subscribe::trials(config, credentials, intake.clone())),
            tokio::spawn(intake.follow_newest()),
            tokio::spawn(async move { subscribe::forever(&generator, || steering.follow()).await }),
        ];
        let refusals = Arc::new(Refusals::default());
        let of_web = web.clone();
        let metrics = Arc::new(move |text: &mut _| web::metrics::write(&of_web, text));
        let metrics = metrics_route(metrics, access.clone(), refusals.clone());
        // Calls of gRPC are checked by their services.
        let guarded = web.router().merge(metrics).layer(axum::middleware::from_fn_with_state(guard, web::guard::guard));
        let routes = guarded.merge(grpc).fallback(nowhere);
        let served = serve(routes, listener, access, refusals, shutdown).await;
        tasks.iter().for_each(tokio::task::JoinHandle::abort);
        served
    })
}
