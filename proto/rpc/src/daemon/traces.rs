//! Traces for OpenTelemetry: spans of steps and trials, sent by OTLP over gRPC to the collector that `OTEL_EXPORTER_OTLP_ENDPOINT` names;
//! without it nothing is collected.
//!
//! Nodes tell each other nothing of traces. The ids of a trace and of its first span are hashes of what it follows, so that the spans of
//! all nodes meet in one trace, whichever of them are collected.

use crate::credentials::Role;
use opentelemetry::trace::{SpanContext, SpanId, SpanKind, Status, TraceFlags, TraceId, TraceState};
use opentelemetry::{InstrumentationScope, KeyValue, Value};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{
    BatchSpanProcessor, IdGenerator, RandomIdGenerator, SpanData, SpanEvents, SpanLinks, SpanProcessor,
};
use parking_lot::RwLock;
use std::ops::Range;
use std::time::{Duration, SystemTime};

/// The nodes of this process whose spans are collected.
static NODES: RwLock<Vec<(Role, BatchSpanProcessor)>> = RwLock::new(Vec::new());

/// How long the last spans may take on their way when a node ends.
const FLUSH: Duration = Duration::from_secs(2);

/// A node's spans are collected as long as this lives.
#[must_use]
#[derive(Debug)]
pub struct Traces(Role);

/// Collects the spans of `node` if a collector is named. To be called in an asynchronous runtime.
pub fn collect_traces(node: Role) -> Traces {
    let is_wanted = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];
    if !is_wanted.iter().any(|name| std::env::var_os(name).is_some_and(|address| !address.is_empty())) {
        return Traces(node);
    }
    match opentelemetry_otlp::SpanExporter::builder().with_tonic().build() {
        Ok(exporter) => {
            let mut processor = BatchSpanProcessor::builder(exporter).build();
            processor.set_resource(&Resource::builder().with_service_name(service(node)).build());
            NODES.write().push((node, processor));
        }
        Err(error) => tracing::warn!(%error, "no traces are collected; mend OTEL_EXPORTER_OTLP_ENDPOINT"),
    }
    Traces(node)
}

/// The node's name as a service.
fn service(node: Role) -> &'static str {
    match node {
        Role::Generator => "generator-node",
        Role::Viewer => "viz-node",
        other => other.name(),
    }
}

impl Drop for Traces {
    fn drop(&mut self) {
        let mut nodes = NODES.write();
        if let Some(at) = nodes.iter().position(|(node, _)| *node == self.0) {
            let (_, processor) = nodes.swap_remove(at);
            drop(nodes);
            if let Err(error) = processor.shutdown_with_timeout(FLUSH) {
                tracing::warn!(%error, "the last spans did not reach the collector");
            }
        }
    }
}

/// The trace of one step or trial, as a node sees it.
#[derive(Debug, Clone, Copy)]
pub struct Trace {
    node: Role,
    id: TraceId,
    first: SpanId,
}

impl Trace {
    /// That of a step of a run; `None` if the spans of `node` are not collected.
    pub fn of_step(node: Role, run_id: &str, step: u64) -> Option<Self> {
        Self::of(node, &[b"step", run_id.as_bytes(), &step.to_le_bytes()])
    }

    /// That of a trial.
    pub fn of_trial(node: Role, trial_id: u64) -> Option<Self> {
        Self::of(node, &[b"trial", &trial_id.to_le_bytes()])
    }

    fn of(node: Role, parts: &[&[u8]]) -> Option<Self> {
        NODES.read().iter().any(|(known, _)| *known == node).then(|| {
            let [high, low, first] = [1, 2, 3].map(|seed| hash(seed, parts));
            let id = TraceId::from((u128::from(high) << 64) | u128::from(low));
            Self { node, id, first: SpanId::from(first) }
        })
    }

    fn send(&self, (id, parent): (SpanId, SpanId), span: Span) {
        let nodes = NODES.read();
        let Some((_, processor)) = nodes.iter().find(|(node, _)| *node == self.node) else { return };
        let Span { name, times, attributes } = span;
        processor.on_end(SpanData {
            span_context: SpanContext::new(self.id, id, TraceFlags::SAMPLED, false, TraceState::NONE),
            parent_span_id: parent,
            parent_span_is_remote: parent != SpanId::INVALID,
            span_kind: SpanKind::Internal,
            name: name.into(),
            start_time: times.start,
            end_time: times.end,
            attributes,
            dropped_attributes_count: 0,
            events: SpanEvents::default(),
            links: SpanLinks::default(),
            status: Status::Unset,
            instrumentation_scope: InstrumentationScope::builder("lamina").build(),
        });
    }
}

/// What took some time.
#[derive(Debug)]
struct Span {
    name: &'static str,
    times: Range<SystemTime>,
    attributes: Vec<KeyValue>,
}

impl Span {
    fn until_now<const N: usize>(name: &'static str, begun: SystemTime, attributes: Attributes<N>) -> Self {
        let attributes = attributes.into_iter().map(|(key, value)| KeyValue::new(key, value)).collect();
        Self { name, times: begun..SystemTime::now().max(begun), attributes }
    }
}

/// Names and values that a span says.
pub type Attributes<const N: usize> = [(&'static str, Value); N];

/// What a node does with a step or a trial, one thing after the other.
#[derive(Debug)]
pub struct Timeline {
    begun: SystemTime,
    last: SystemTime,
    done: Vec<Span>,
}

impl Timeline {
    /// From now on.
    pub fn begin() -> Self {
        Self::since(SystemTime::now())
    }

    /// From `begun` on.
    pub fn since(begun: SystemTime) -> Self {
        Self { begun, last: begun, done: Vec::new() }
    }

    /// What was done since the last lap.
    pub fn lap<const N: usize>(&mut self, name: &'static str, attributes: Attributes<N>) {
        let span = Span::until_now(name, self.last, attributes);
        self.last = span.times.end;
        self.done.push(span);
    }

    /// Sends a span for each lap to the collector, if there is one.
    pub fn send(self, trace: Option<Trace>) {
        let Some(trace) = trace else { return };
        for span in self.done {
            trace.send((RandomIdGenerator::default().new_span_id(), trace.first), span);
        }
    }

    /// The same, and the trace's first span before them, over the whole time, which those of all nodes are in.
    pub fn send_first<const N: usize>(self, trace: Option<Trace>, name: &'static str, attributes: Attributes<N>) {
        let Some(trace) = trace else { return };
        trace.send((trace.first, SpanId::INVALID), Span::until_now(name, self.begun, attributes));
        self.send(Some(trace));
    }
}

/// 64-bit FNV-1a of `seed` and the parts, each with its length before it; never 0, which is no id.
fn hash(seed: u8, parts: &[&[u8]]) -> u64 {
    let bytes = parts.iter().flat_map(|part| [part.len() as u8].into_iter().chain(part.iter().copied()));
    let fold = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    [seed].into_iter().chain(bytes).fold(0xcbf2_9ce4_8422_2325, fold).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_hashes_of_what_is_followed() {
        // FNV-1a of one byte 0x61 is 0xaf63dc4c8601ec8c, by the authors' test vectors.
        assert_eq!(hash(0x61, &[]), 0xaf63_dc4c_8601_ec8c);
        let ids = [[&b"ab"[..], b"c"], [b"a", b"bc"], [b"abc", b""]].map(|parts| hash(1, &parts));
        assert!(ids[0] != ids[1] && ids[1] != ids[2] && ids[0] != ids[2]);
        assert!(Trace::of_step(Role::Admin, "run", 1).is_none());
    }
}
