//! One announcement of a run with its payload, as subscribers receive it.

use lamina_rpc::v1::{self, delivery::Part};
use std::sync::Arc;
use tonic::codegen::Bytes;

/// Something to deliver: an announcement and its payload, of one run.
#[derive(Clone)]
pub(crate) struct Delivery {
    pub(crate) run: Arc<v1::Run>,
    pub(crate) announcement: Part,
    pub(crate) payload: Bytes,
}

impl Delivery {
    /// Reference samples or a frame of `run`.
    pub(crate) fn new(run: &Arc<v1::Run>, announcement: Part, payload: impl Into<Bytes>) -> Self {
        Self { run: run.clone(), announcement, payload: payload.into() }
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
        self.run.run_id == run_id
            && match &self.announcement {
                Part::Frame(f) => f.step <= step,
                Part::Reference(r) => r.step <= step,
                Part::Run(_) | Part::Chunk(_) => false,
            }
    }
}
