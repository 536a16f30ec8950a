//! One measurement of one set of parameters, whoever takes it.

use lamina_model::{Cost, GenerationParams, Indicators, Invalid, Quality};
use std::future::Future;
use std::num::NonZeroU32;
use std::time::Duration;

/// What a trial measured.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Measurement {
    /// sigma and tau.
    pub cost: Cost,
    /// q, with as many batches as were measured; none if only the cost was asked for.
    pub quality: Quality,
}

impl Measurement {
    /// sigma, q and tau; q is NaN where it was not measured.
    pub fn indicators(&self) -> Indicators {
        Indicators {
            size_bytes: self.cost.size_bytes,
            psnr_db: self.quality.psnr_db(),
            generation_time: self.cost.generation,
        }
    }
}

/// Why a trial gave no measurement.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// These parameters cannot be measured; others may be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A node does not answer; the whole study is off.
    #[error("{node}: {reason}")]
    Node {
        /// Which node, with its address.
        node: String,
        /// What went wrong and what helps.
        reason: String,
    },
}

/// Which batches of sampled pixels a quality is measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Batches {
    /// No pixels: the cost alone.
    None,
    /// So many, or as many as there are.
    First(NonZeroU32),
    /// All that the plan has.
    All,
}

impl Batches {
    /// The first `count`; none of 0.
    pub fn first(count: u32) -> Self {
        NonZeroU32::new(count).map_or(Self::None, Self::First)
    }

    /// How many these are of a plan of `planned`.
    pub fn count(self, planned: u32) -> u32 {
        match self {
            Self::None => 0,
            Self::First(count) => count.get().min(planned),
            Self::All => planned,
        }
    }
}

/// Measures parameters on one step that stays the same throughout.
pub trait Evaluator: Send {
    /// The step measured.
    fn step(&self) -> u64;

    /// Batches of sampled pixels that there are.
    fn batches(&self) -> u32;

    /// The most sample points on a side of a reduced volume of the step; 0 if none can stand for it.
    fn longest_side(&self) -> u32;

    /// Costs for each of `gammas` from one march; the other parameters are those of `params`. Their generation time is the
    /// march's, not that of one gamma.
    fn sizes(
        &mut self,
        params: &GenerationParams,
        gammas: &[f64],
    ) -> impl Future<Output = Result<Vec<Cost>, TrialError>> + Send;

    /// Wall time of generation with `params`, which takes a tenth of what a whole trial does: nothing is encoded or measured. Of
    /// a volume it is without the coding, which [`Cost`] counts.
    ///
    /// The outer error ends the study; an inner one is about these parameters only.
    fn time(
        &mut self,
        params: &GenerationParams,
    ) -> impl Future<Output = Result<Result<Duration, Invalid>, TrialError>> + Send;

    /// Costs of all these parameters, and their quality from some `batches`. What was measured before is not measured again. One answer for each, in their order.
    ///
    /// The outer error ends the study; an inner one is about that set of parameters only.
    fn evaluate(
        &mut self,
        params: &[GenerationParams],
        batches: Batches,
    ) -> impl Future<Output = Result<Vec<Result<Measurement, Invalid>>, TrialError>> + Send;
}
