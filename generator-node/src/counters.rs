//! What a generator-node counts, for `/metrics`.

use lamina_model::Diagnostics;
use lamina_rpc::daemon::Histogram;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;

/// Counts of the pipeline and of trials.
#[derive(Debug)]
pub(crate) struct PipelineCounters {
    /// Steps from which nothing could be generated.
    pub failed_steps: AtomicU64,
    /// Trials generated.
    pub trials: AtomicU64,
    /// How often each trigger fired.
    pub fired: Mutex<BTreeMap<String, u64>>,
    /// What the simulation told of the newest step.
    pub diagnostics: Mutex<Diagnostics>,
    /// Encoded bytes of live steps.
    pub size_bytes: Histogram,
    /// Generation times of live steps, seconds.
    pub generation_secs: Histogram,
    /// Encoding times of live steps, seconds.
    pub encode_secs: Histogram,
}

impl Default for PipelineCounters {
    fn default() -> Self {
        Self {
            failed_steps: AtomicU64::new(0),
            trials: AtomicU64::new(0),
            fired: Mutex::default(),
            diagnostics: Mutex::default(),
            size_bytes: Histogram::new(Histogram::BYTES),
            generation_secs: Histogram::new(Histogram::SECONDS),
            encode_secs: Histogram::new(Histogram::SECONDS),
        }
    }
}
