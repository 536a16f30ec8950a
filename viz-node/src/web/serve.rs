//! Serving the page and gRPC on one port: what a connection may take of time and requests.

use axum::Extension;
use axum::Router;
use axum::extract::{Request, State};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use lamina_rpc::daemon::{Connections, MOST_STREAMS};
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tower::Layer as _;

/// How long the head of a request may take, from when the connection is free for it, and the body of one.
const REQUEST: Duration = Duration::from_secs(10);
/// How often a connection of HTTP/2 is asked whether it is alive, and how long it may take to answer.
const ALIVE: Duration = Duration::from_secs(10);
/// Requests a second of a connection, and how many may come at once. A page that is drawn here asks for some thirty a second.
const RATE: f64 = 200.0;
const BURST: f64 = 400.0;
/// How long connections may finish what they are doing after a stop was asked for. Event streams never end by themselves.
const GRACE: Duration = Duration::from_secs(1);

/// What was refused, for the metrics.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    /// Requests of connections that sent too many.
    pub rate: AtomicU64,
    /// Requests whose body did not come in time.
    pub slow: AtomicU64,
    /// Connections that ended with an error, those whose requests did not come in time among them.
    pub broken: AtomicU64,
}

/// Requests that a connection may still send: [`BURST`], filled up by [`RATE`] a second.
#[derive(Debug)]
pub(crate) struct Allowance(Mutex<(f64, Instant)>);

impl Allowance {
    fn new(now: Instant) -> Self {
        Self(Mutex::new((BURST, now)))
    }

    /// Takes one request, if there is one.
    fn take(&self, now: Instant) -> bool {
        let mut state = self.0.lock();
        let (left, since) = *state;
        let left = (left + RATE * now.duration_since(since).as_secs_f64()).min(BURST);
        let granted = left >= 1.0;
        *state = (if granted { left - 1.0 } else { left }, now);
        granted
    }
}

/// Answers requests for the page within the connection's allowance and time.
pub(crate) async fn limit(
    State(refusals): State<Arc<Refusals>>,
    Extension(allowance): Extension<Arc<Allowance>>,
    request: Request,
    next: Next,
) -> Response {
    if !allowance.take(Instant::now()) {
        refusals.rate.fetch_add(1, Ordering::Relaxed);
        let words = format!("more than {RATE} requests a second on a connection; ask again later\n");
        return (StatusCode::TOO_MANY_REQUESTS, words).into_response();
    }
    if request.method() != Method::POST {
        return next.run(request).await;
    }
    tokio::time::timeout(REQUEST, next.run(request)).await.unwrap_or_else(|_| {
        refusals.slow.fetch_add(1, Ordering::Relaxed);
        (StatusCode::REQUEST_TIMEOUT, "the request did not come in time\n").into_response()
    })
}

/// Serves `routes` until `stopped`; each request has its [`Peer`](lamina_rpc::daemon::Peer) and [`Allowance`] as extensions.
pub(crate) async fn serve(
    mut connections: Connections,
    routes: Router,
    refusals: Arc<Refusals>,
    stopped: impl Future<Output = ()>,
) {
    let mut builder = Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(REQUEST);
    let mut http2 = builder.http2();
    http2.timer(TokioTimer::new()).max_concurrent_streams(MOST_STREAMS);
    http2.keep_alive_interval(ALIVE).keep_alive_timeout(ALIVE);
    let graceful = GracefulShutdown::new();
    tokio::pin!(stopped);
    loop {
        let connection = tokio::select! {
            connection = connections.next() => connection,
            () = &mut stopped => break,
        };
        let allowance = Arc::new(Allowance::new(Instant::now()));
        let (peer, refusals) = (connection.peer(), refusals.clone());
        let own = Extension(peer).layer(Extension(allowance).layer(routes.clone()));
        let served = builder.serve_connection(TokioIo::new(connection), TowerToHyperService::new(own)).into_owned();
        let served = graceful.watch(served);
        tokio::spawn(async move {
            if let Err(error) = served.await {
                refusals.broken.fetch_add(1, Ordering::Relaxed);
                tracing::debug!(peer = %peer.address, %error, "a connection ended");
            }
        });
    }
    let _ = tokio::time::timeout(GRACE, graceful.shutdown()).await;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_may_send_a_burst_and_then_as_many_as_time_passes() {
        let begun = Instant::now();
        let allowance = Allowance::new(begun);
        let granted = |at: f64| (0..1000).filter(|_| allowance.take(begun + Duration::from_secs_f64(at))).count();
        assert_eq!(granted(0.0), 400);
        assert_eq!(granted(0.5), 100);
        assert_eq!(granted(100.0), 400, "no more than a burst, however long it was silent");
    }
}
