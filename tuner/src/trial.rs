//! One measurement of one set of parameters, whoever takes it.

use lamina_model::{GenerationParams, Indicators, Invalid};
use std::future::Future;
use std::time::Duration;

/// What a trial measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// sigma, q and tau.
    pub indicators: Indicators,
    /// Wall time of encoding, its own figure.
    pub encode_time: Duration,
    /// Supersegments of the VDI.
    pub supersegments: u64,
}

/// Why a trial gave no measurement.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// These parameters cannot be measured; others may be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A node did not answer; try again later.
    #[error("{node} did not measure the trial: {reason}")]
    Node {
        /// Which node, and where.
        node: String,
        /// Its words or the transport's.
        reason: String,
    },
}

/// Something that can measure parameters on one time step.
pub trait Trial {
    /// The time step all measurements of this value are taken on.
    fn step(&self) -> u64;
    /// Measures `params`.
    fn measure(&mut self, params: &GenerationParams) -> impl Future<Output = Result<Measured, TrialError>> + Send;
}
