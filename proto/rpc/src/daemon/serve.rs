//! Listening, serving gRPC and HTTP on one port until a signal, and stopping cleanly.

use super::connections::Connections;
use super::diagnosis::diagnosis;
use super::metrics::{self, Metrics};
use super::rate_limit::{Allowance, REQUEST, is_grpc, limit};
use super::refusals::Refusals;
use super::{Access, NodeError};
use axum::extract::Request;
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use axum::{Extension, Router};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;
use std::{future::Future, net::SocketAddr, pin::Pin, time::Duration};
use tokio::net::TcpListener;
use tonic::service::Routes;
use tower::Layer as _;

/// Listens on `address`; port 0 takes a free one.
///
/// # Errors
/// If the address is in use or not this machine's.
pub async fn listen(address: SocketAddr) -> Result<TcpListener, NodeError> {
    TcpListener::bind(address).await.map_err(|reason| NodeError::Listen { address, reason })
}

/// Most streams of a connection at a time; a peer that asks for more waits.
const MOST_STREAMS: u32 = 256;

/// How often a connection of HTTP/2 is asked whether it is alive, and how long it may take to answer: a peer that vanished without a
/// word gives back what was reserved for it.
const ALIVE: Duration = Duration::from_secs(10);

/// How long connections may finish what they are doing after a stop was asked for. Event streams never end by themselves.
const GRACE: Duration = Duration::from_secs(1);

/// What a node stops on. A boxed future, so that a node's machinery is compiled once, in its own crate.
pub type Shutdown = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A node at work, boxed for the same reason; it ends after its [`Shutdown`].
pub type Running = Pin<Box<dyn Future<Output = Result<(), NodeError>> + Send>>;

/// Serves the gRPC services `routes` on `listener`, and to viewers what `metrics` says at `/metrics`, to whom `access` lets in until
/// `shutdown` completes, then for at most a second more.
pub fn serve_grpc(
    routes: Routes,
    metrics: Metrics,
    listener: TcpListener,
    access: Access,
    shutdown: Shutdown,
) -> Running {
    let refusals = Arc::new(Refusals::default());
    let metrics = metrics::route(metrics, access.clone(), refusals.clone());
    let metrics = metrics.layer(axum::middleware::from_fn(metrics::for_viewers));
    let routes = routes.add_service(diagnosis()).into_axum_router().merge(metrics).fallback(nowhere);
    serve(routes, listener, access, refusals, shutdown)
}

/// Answers what no route does, in the caller's way.
pub async fn nowhere(request: Request) -> Response {
    if is_grpc(&request) {
        return tonic::Status::unimplemented("no such service").into_http::<axum::body::Body>();
    }
    (StatusCode::NOT_FOUND, "nothing here\n").into_response()
}

/// Serves `routes` on `listener` to whom `access` lets in until `shutdown` completes, then for at most a second more. Each request has
/// the [`Peer`](super::Peer) it comes from as an extension.
pub fn serve(
    routes: Router,
    listener: TcpListener,
    access: Access,
    refusals: Arc<Refusals>,
    shutdown: Shutdown,
) -> Running {
    Box::pin(serve_until(routes, listener, access, refusals, shutdown))
}

async fn serve_until(
    routes: Router,
    listener: TcpListener,
    access: Access,
    refusals: Arc<Refusals>,
    mut shutdown: Shutdown,
) -> Result<(), NodeError> {
    let mut connections = Connections::accept(listener, access, refusals.clone());
    let routes = routes.layer(axum::middleware::from_fn_with_state(refusals.clone(), limit));
    let mut builder = Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(REQUEST);
    let mut http2 = builder.http2();
    http2.timer(TokioTimer::new()).max_concurrent_streams(MOST_STREAMS);
    http2.keep_alive_interval(ALIVE).keep_alive_timeout(ALIVE);
    let graceful = GracefulShutdown::new();
    loop {
        let connection = tokio::select! {
            connection = connections.next() => connection,
            () = &mut shutdown => break,
        };
        let allowance = Arc::new(Allowance::new(Instant::now()));
        let (peer, share, refusals) = (connection.peer(), connection.share(), refusals.clone());
        let own = Extension(peer).layer(Extension(allowance).layer(Extension(share).layer(routes.clone())));
        let served = builder.serve_connection(TokioIo::new(connection), TowerToHyperService::new(own)).into_owned();
        let served = graceful.watch(served);
        tokio::spawn(async move {
            if let Err(error) = served.await {
                refusals.broken.fetch_add(1, Ordering::Relaxed);
                tracing::debug!(peer = %peer.address, %error, "a connection ended");
            }
        });
    }
    // Streams that never end by themselves are cut after that.
    let _ = tokio::time::timeout(GRACE, graceful.shutdown()).await;
    Ok(())
}

/// Completes on SIGTERM or Ctrl-C.
pub async fn stop_signal() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        match signal(SignalKind::terminate()) {
            Ok(mut terminate) => tokio::select! { _ = interrupt => {}, _ = terminate.recv() => {} },
            Err(_) => drop(interrupt.await),
        }
    }
    #[cfg(not(unix))]
    drop(interrupt.await);
}
