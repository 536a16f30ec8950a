//! What a connection may take of a node: requests a second, time for the body of one, and of its address's memory.

use super::address_share::AddressShare;
use super::message_memory::within_share;
use super::refusals::Refusals;
use axum::Extension;
use axum::extract::{Request, State};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// How long the head of a request may take, from when the connection is free for it, and the body of one that is not gRPC's.
pub(super) const REQUEST: Duration = Duration::from_secs(10);
/// Requests a second of a connection, and how many may come at once. A page that is drawn by its browser asks for some thirty a second;
/// a call of gRPC counts as one, however long it streams. Bricks are not counted: a simulation may make steps faster than that, and a
/// generator-node admits or drops each by its own rules.
const RATE: f64 = 200.0;
const BURST: f64 = 400.0;

/// Where bricks come in: `lamina.v1.Ingest`.
const BRICKS: &str = "/lamina.v1.Ingest/";

/// Requests that a connection may still send: [`BURST`], filled up by [`RATE`] a second.
#[derive(Debug)]
pub(super) struct Allowance(Mutex<(f64, Instant)>);

impl Allowance {
    pub(super) fn new(now: Instant) -> Self {
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

/// True if the request is a call of gRPC, `/PACKAGE.Service/Method`. What it says of itself in its head is not relied on.
pub(super) fn is_grpc(request: &Request) -> bool {
    let mut segments = request.uri().path().split('/').skip(1);
    segments.next().is_some_and(|service| service.contains('.')) && segments.next().is_some()
}

/// Answers requests within the connection's allowance and time.
pub(super) async fn limit(
    State(refusals): State<Arc<Refusals>>,
    Extension(allowance): Extension<Arc<Allowance>>,
    Extension(share): Extension<Arc<AddressShare>>,
    mut request: Request,
    next: Next,
) -> Response {
    let is_grpc = is_grpc(&request);
    if is_grpc {
        request = request.map(|body| within_share(body, share, refusals.clone()));
    }
    if is_grpc && request.uri().path().starts_with(BRICKS) {
        return next.run(request).await;
    }
    if !allowance.take(Instant::now()) {
        refusals.rate.fetch_add(1, Ordering::Relaxed);
        let words = format!("more than {RATE} requests a second on a connection; ask again later");
        if is_grpc {
            return tonic::Status::resource_exhausted(words).into_http::<axum::body::Body>();
        }
        return (StatusCode::TOO_MANY_REQUESTS, words + "\n").into_response();
    }
    if is_grpc || request.method() != Method::POST {
        return next.run(request).await;
    }
    tokio::time::timeout(REQUEST, next.run(request)).await.unwrap_or_else(|_| {
        refusals.slow.fetch_add(1, Ordering::Relaxed);
        (StatusCode::REQUEST_TIMEOUT, "the request did not come in time\n").into_response()
    })
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
