//! One announcement of a run with its payload, as subscribers receive it.

use lamina_model::{Frame, ReferenceSamples, RunInfo};
use lamina_rpc::Bytes;
use lamina_rpc::reference;
use lamina_rpc::v1::delivery::Part;
use std::sync::Arc;

/// Something to deliver: an announcement and its payload, of one run.
#[derive(Clone)]
pub(crate) struct Delivery {
    pub(crate) run: Arc<RunInfo>,
    pub(crate) announcement: Part,
    pub(crate) payload: Bytes,
}

impl Delivery {
    /// An encoded step of `run`.
    pub(crate) fn frame(run: &Arc<RunInfo>, frame: Frame, payload: impl Into<Bytes>) -> Self {
        Self { run: run.clone(), announcement: Part::Frame(frame.into()), payload: payload.into() }
    }

    /// What a step of `run` is compared with.
    pub(crate) fn reference(run: &Arc<RunInfo>, samples: &ReferenceSamples) -> Self {
        let (announcement, payload) = reference::encode(&run.id, samples);
        Self { run: run.clone(), announcement: Part::Reference(announcement), payload: payload.into() }
    }

    /// Bytes of the payload.
    pub(crate) fn bytes(&self) -> u64 {
        self.payload.len() as u64
    }

    /// True for a frame, false for what it is compared with.
    pub(crate) fn is_frame(&self) -> bool {
        matches!(self.announcement, Part::Frame(_))
    }

    /// True for live steps and their references up to `step` of run `run_id`.
    pub(crate) fn is_recorded(&self, run_id: &str, step: u64) -> bool {
        self.run.id == run_id
            && match &self.announcement {
                Part::Frame(f) => f.step <= step,
                Part::Reference(r) => r.step <= step,
                Part::Run(_) | Part::Chunk(_) => false,
            }
    }
}
