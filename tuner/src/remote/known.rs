//! What has been measured of one set of parameters.

use crate::evaluator::Measurement;
use lamina_model::{Cost, GenerationParams, Invalid, Quality};
use lamina_rpc::daemon::Timeline;

/// What is known of one set of parameters.
#[derive(Debug)]
pub(super) struct Known {
    pub(super) params: GenerationParams,
    pub(super) cost: Option<Cost>,
    pub(super) quality: Quality,
    /// It cannot be measured.
    pub(super) refusal: Option<Invalid>,
    /// Which viewer has its VDI, as which trial.
    pub(super) held: Option<(String, u64)>,
    /// The trial that it was asked for as, until a viewer has answered.
    pub(super) timeline: Option<Timeline>,
    /// How often in a row a viewer did not have what it was to have.
    pub(super) missed: u32,
}

impl Known {
    pub(super) fn new(params: GenerationParams) -> Self {
        Self { params, cost: None, quality: Quality::default(), refusal: None, held: None, timeline: None, missed: 0 }
    }

    /// True while there is something to find out.
    pub(super) fn lacks(&self, batches: u32) -> bool {
        self.refusal.is_none() && (self.cost.is_none() || self.quality.batches() < batches as usize)
    }

    /// The answer, if nothing is lacking.
    pub(super) fn answer(&self, batches: u32) -> Result<Measurement, Invalid> {
        if let Some(refusal) = &self.refusal {
            return Err(refusal.clone());
        }
        Ok(Measurement { cost: self.cost.unwrap_or_default(), quality: self.quality.first(batches as usize) })
    }
}
