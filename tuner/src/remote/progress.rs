//! Progress of a study, shared with viz-nodes.

use crate::evaluator::Measurement;
use lamina_rpc::v1;
use parking_lot::{Mutex, MutexGuard};
use std::sync::Arc;

/// How far a study is, as viz-nodes are told with every question. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct Progress(Arc<Mutex<v1::StudyProgress>>);

impl Progress {
    /// Of a run's first study, or of a later one.
    pub fn new(first: bool) -> Self {
        Self(Arc::new(Mutex::new(v1::StudyProgress { first, ..Default::default() })))
    }

    pub(super) fn state(&self) -> MutexGuard<'_, v1::StudyProgress> {
        self.0.lock()
    }

    pub(super) fn get(&self) -> v1::StudyProgress {
        *self.state()
    }

    pub(super) fn begin_trial(&self) {
        self.state().trials += 1;
    }

    /// Another trial is the best so far.
    pub fn best(&self, measured: &Measurement) {
        let mut state = self.state();
        state.best_psnr_db = Some(measured.quality.psnr_db());
        state.best_size_bytes = measured.cost.size_bytes;
    }
}
