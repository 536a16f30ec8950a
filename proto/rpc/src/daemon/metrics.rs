//! `/metrics` in Prometheus' text format 0.0.4, under its naming conventions: <https://prometheus.io/docs/practices/naming/>.

use super::refusals::Refusals;
use super::{Access, Histogram, Peer};
use crate::credentials::Role;
use axum::extract::Request;
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use axum::{Extension, Router, routing::get};
use std::fmt::{Display, Write};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::UNIX_EPOCH;

/// Metrics of one node, as text. Each name is prefixed by `lamina_`.
#[derive(Debug, Default)]
pub struct Exposition(String);

/// Writes a node's own metrics.
pub type Metrics = Arc<dyn Fn(&mut Exposition) + Send + Sync>;

impl Exposition {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a String cannot fail, here and below.
        let _ = writeln!(self.0, "# HELP lamina_{name} {help}\n# TYPE lamina_{name} {kind}");
    }

    fn sample(&mut self, name: &str, value: f64) {
        let _ = writeln!(self.0, "lamina_{name} {}", SampleValue(value));
    }

    /// What rises and falls.
    pub fn gauge(&mut self, name: &str, help: &str, value: f64) {
        self.family(name, "gauge", help);
        self.sample(name, value);
    }

    /// What only rises; `name` ends in `_total`.
    pub fn counter(&mut self, name: &str, help: &str, value: f64) {
        self.family(name, "counter", help);
        self.sample(name, value);
    }

    /// What only rises, for each value of `label`; `name` ends in `_total`.
    pub fn counters(&mut self, name: &str, help: &str, label: &str, values: &[(&str, f64)]) {
        self.labeled((name, "counter", help), label, values);
    }

    /// What rises and falls, for each value of `label`.
    pub fn gauges(&mut self, name: &str, help: &str, label: &str, values: &[(&str, f64)]) {
        self.labeled((name, "gauge", help), label, values);
    }

    fn labeled(&mut self, (name, kind, help): (&str, &str, &str), label: &str, values: &[(&str, f64)]) {
        self.family(name, kind, help);
        for (value, number) in values {
            self.sample(&format!("{name}{{{label}=\"{value}\"}}"), *number);
        }
    }

    /// A distribution.
    pub fn histogram(&mut self, name: &str, help: &str, histogram: &Histogram) {
        self.family(name, "histogram", help);
        let (buckets, sum) = histogram.cumulative();
        let count = buckets.last().map_or(0.0, |(_, count)| *count as f64);
        for (bound, count) in buckets {
            self.sample(&format!("{name}_bucket{{le=\"{}\"}}", SampleValue(bound)), count as f64);
        }
        self.sample(&format!("{name}_sum"), sum);
        self.sample(&format!("{name}_count"), count);
    }

    /// What every node has to say of its server.
    fn server(&mut self, access: &Access, refusals: &Refusals) {
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed) as f64;
        let help = "Requests refused because their connection sent too many.";
        self.counter("rate_limited_total", help, count(&refusals.rate));
        self.counter("slow_requests_total", "Requests whose body did not come in time.", count(&refusals.slow));
        let help = "Messages that waited for memory until others of their address had come.";
        self.counter("message_waits_total", help, count(&refusals.waited));
        let help = "Connections refused because their address had as many as one may have.";
        self.counter("refused_connections_total", help, count(&refusals.crowded));
        self.counter("broken_connections_total", "Connections that ended with an error.", count(&refusals.broken));
        if let Some(end) = access.certificate_end().and_then(|end| end.duration_since(UNIX_EPOCH).ok()) {
            let help = "When the node's certificate expires.";
            self.gauge("certificate_expiry_timestamp_seconds", help, end.as_secs_f64());
        }
    }
}

/// A number as the format has it.
struct SampleValue(f64);

impl Display for SampleValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            f64::INFINITY => f.write_str("+Inf"),
            f64::NEG_INFINITY => f.write_str("-Inf"),
            number => number.fmt(f),
        }
    }
}

/// The route `/metrics`: what `metrics` writes, and what there is to say of the server.
pub fn route(metrics: Metrics, access: Access, refusals: Arc<Refusals>) -> Router {
    let answer = move || {
        let mut text = Exposition::default();
        metrics(&mut text);
        text.server(&access, &refusals);
        std::future::ready(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text.0))
    };
    Router::new().route("/metrics", get(answer))
}

/// Lets viewers and admins read, but no script of a site that has its name resolved to this host (DNS rebinding).
pub(super) async fn for_viewers(Extension(peer): Extension<Peer>, request: Request, next: Next) -> Response {
    if let Err(reason) = peer.check(&[Role::Viewer]) {
        return (StatusCode::FORBIDDEN, reason + "\n").into_response();
    }
    // Browsers send it, and say `none` of what their user typed.
    if request.headers().get("sec-fetch-site").is_some_and(|site| site != "none") {
        return (StatusCode::FORBIDDEN, "asked for by a page\n").into_response();
    }
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_written_as_the_format_has_them() {
        let histogram = Histogram::new(&[0.1, 1.0]);
        [0.05, 0.1, 0.5, 7.0, f64::INFINITY].into_iter().for_each(|value| histogram.observe(value));
        let mut text = Exposition::default();
        text.gauge("psnr_db", "Quality.", f64::INFINITY);
        text.counters("cpu_seconds_total", "Time.", "activity", &[("draw", 1.5), ("encode", 0.0)]);
        text.histogram("x_seconds", "What it is.", &histogram);
        let expected = "# HELP lamina_psnr_db Quality.\n# TYPE lamina_psnr_db gauge\nlamina_psnr_db +Inf\n\
            # HELP lamina_cpu_seconds_total Time.\n# TYPE lamina_cpu_seconds_total counter\n\
            lamina_cpu_seconds_total{activity=\"draw\"} 1.5\nlamina_cpu_seconds_total{activity=\"encode\"} 0\n\
            # HELP lamina_x_seconds What it is.\n# TYPE lamina_x_seconds histogram\n\
            lamina_x_seconds_bucket{le=\"0.1\"} 2\nlamina_x_seconds_bucket{le=\"1\"} 3\n\
            lamina_x_seconds_bucket{le=\"+Inf\"} 5\nlamina_x_seconds_sum 7.65\nlamina_x_seconds_count 5\n";
        assert_eq!(text.0, expected);
    }
}
