//! The viz-node: takes VDIs in, renders them from any camera, and reports their PSNR against reference samples.
//!
//! Subscribe -> intake -> store -> painter -> web, and trials measured for the tuner. It sees no voxels but those of
//! reduced volumes.

pub mod config;
mod intake;
pub mod painter;
mod quality_service;
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
use lamina_rpc::daemon::{Access, AllowRoles, Connections, Shutdown};
use lamina_rpc::v1::quality_server::QualityServer;
use lamina_vdi_render::Backend;
use std::sync::{Arc, atomic::AtomicBool};
use std::time::Duration;
use tokio::net::TcpListener;

/// How long connections may finish what they are doing after a stop was asked for.
const GRACE: Duration = Duration::from_secs(1);

/// Opens the store a configuration names.
///
/// # Errors
/// If its folder cannot be used.
pub fn open_store(config: &Config) -> Result<Arc<Store>, store::StoreError> {
    Ok(Arc::new(Store::open(config.store.as_deref(), config.memory_bytes, limits(config))?))
}

fn limits(config: &Config) -> DecodeLimits {
    DecodeLimits { max_decoded_bytes: config.max_decoded_bytes }
}

/// Runs the node on `listener` until `shutdown` completes, within `share` of the processor. The page, the metrics and gRPC share
/// the port.
///
/// # Errors
/// If the listener fails, or the configuration asks for a GPU and there is none.
pub async fn run(
    config: Config,
    store: Arc<Store>,
    share: CpuShare,
    listener: TcpListener,
    shutdown: Shutdown,
) -> std::io::Result<()> {
    let address = listener.local_addr()?;
    let access = Access::of(address, config.credentials.as_deref(), config.insecure);
    let (access, credentials) = access.map_err(std::io::Error::other)?;
    let choice = config.backend;
    // A driver may take a second to wake.
    let opened = tokio::task::spawn_blocking(move || Backend::open(choice)).await?;
    let backend = opened.map_err(std::io::Error::other)?;
    let intake = Arc::new(intake::Intake::new(store.clone(), backend.clone(), share, limits(&config)));
    let connected = Arc::new(AtomicBool::new(false));
    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<QualityServer<quality_service::QualityService>>().await;
    let grpc = tonic::service::Routes::new(health_service)
        .add_service(QualityServer::with_interceptor(
            quality_service::QualityService(intake.clone()),
            AllowRoles(&[Role::Tuner]),
        ))
        .into_axum_router();
    let web = web::Web::new(store, backend, intake.clone(), connected.clone()).router();
    tracing::info!(%address, "viz-node listens");
    // An address that means "any" is completed by the generator-node.
    let own = format!("http{}://{address}", if access.is_secure() { "s" } else { "" });
    let page = access.reached_at(address).to_string();
    let guard = Arc::new(web::guard::Guard::new(page, &config.hosts).map_err(std::io::Error::other)?);
    if access.is_secure() {
        // Browsers have no certificate.
        println!("watch it at {}", guard.entrance());
    }
    let config = Config { quality_address: Some(config.quality_address.unwrap_or(own)), ..config };
    let tasks = [
        tokio::spawn(subscribe::live(config.clone(), credentials.clone(), intake.clone(), connected)),
        tokio::spawn(subscribe::trials(config, credentials, intake.clone())),
        tokio::spawn(intake.follow_newest()),
    ];
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let routes = web.merge(grpc).fallback(web::nowhere);
    let routes = routes.layer(axum::middleware::from_fn_with_state(guard, web::guard::guard));
    let service = routes.into_make_service_with_connect_info::<web::guard::PagePeer>();
    let listener = web::guard::PageListener(Connections::accept(listener, access)?);
    let serve = axum::serve(listener, service).with_graceful_shutdown(async {
        let _ = stopped.await;
    });
    let mut server = tokio::spawn(serve.into_future());
    let ended = tokio::select! {
        ended = &mut server => Some(ended),
        () = shutdown => None,
    };
    drop(stop);
    tasks.iter().for_each(tokio::task::JoinHandle::abort);
    let ended = match ended {
        Some(ended) => Ok(ended),
        // Event streams never end by themselves; after the grace they are cut.
        None => tokio::time::timeout(GRACE, server).await,
    };
    match ended {
        Ok(Ok(result)) => result,
        Ok(Err(panic)) => Err(std::io::Error::other(panic)),
        Err(_) => Ok(()),
    }
}
