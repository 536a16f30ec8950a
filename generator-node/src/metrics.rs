//! What a generator-node says at `/metrics`.

use crate::ingest::Ingest;
use crate::node_state::NodeState;
use lamina_rpc::daemon::Exposition;
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes what has come in and waits.
pub(crate) fn write_ingest(ingest: &Ingest, text: &mut Exposition) {
    let figures = ingest.figures();
    text.counter("generator_received_bytes_total", "Bytes of bricks received.", figures.received_bytes as f64);
    text.counter("generator_dropped_steps_total", "Steps dropped.", figures.dropped_steps as f64);
    let (used, limit) = figures.memory_bytes;
    text.gauge("generator_memory_bytes", "Bytes of time steps that arrive or wait.", used as f64);
    text.gauge("generator_memory_limit_bytes", "How many there may be, with those worked on.", limit as f64);
    text.gauge("generator_waiting_steps", "Whole steps that wait for their turn.", figures.waiting_steps as f64);
    let help = "Ranks that fell silent while the others went on.";
    text.gauge("generator_lost_ranks", help, figures.lost_ranks as f64);
}

/// Writes what was made of it.
pub(crate) fn write_pipeline(node: &NodeState, text: &mut Exposition) {
    let (c, count) = (&node.counters, |c: &AtomicU64| c.load(Ordering::Relaxed) as f64);
    let help = "Steps from which nothing could be generated.";
    text.counter("generator_failed_steps_total", help, count(&c.failed_steps));
    text.counter("generator_trials_total", "Trials generated for the tuner.", count(&c.trials));
    let fired = c.fired.lock().clone();
    if !fired.is_empty() {
        let values: Vec<(&str, f64)> = fired.iter().map(|(name, count)| (name.as_str(), *count as f64)).collect();
        text.counters("generator_triggers_fired_total", "How often triggers fired.", "trigger", &values);
    }
    let diagnostics = c.diagnostics.lock().clone();
    if !diagnostics.is_empty() {
        let values: Vec<(&str, f64)> = diagnostics.iter().collect();
        text.gauges("generator_diagnostic", "What the simulation told of the newest step.", "name", &values);
    }
    text.histogram("generator_step_size_bytes", "Encoded bytes of live steps.", &c.size_bytes);
    text.histogram("generator_step_generation_seconds", "Generation times of live steps.", &c.generation_secs);
    text.histogram("generator_step_encode_seconds", "Encoding times of live steps.", &c.encode_secs);
    text.gauge("generator_viewers", "Viz-nodes that measure trials.", node.publisher.viewer_count() as f64);
    if let Some(overhead) = node.coupling().overhead {
        let help = "By which share longer the simulation's steps take beside the node.";
        text.gauge("generator_overhead_ratio", help, overhead);
    }
    node.share.gauges().into_iter().for_each(|(name, help, value)| text.gauge(name, help, value));
    node.share.usage().counters().iter().for_each(|c| text.counters(c.name, c.help, c.label, &c.values));
}
