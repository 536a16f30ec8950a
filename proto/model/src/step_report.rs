//! What a generator-node says of a step it has generated.

use crate::{Cost, GenerationParams};

/// A step as generated.
#[derive(Debug, Clone, PartialEq)]
pub struct StepReport {
    /// The run's id.
    pub run_id: String,
    /// The step's number.
    pub step: u64,
    /// Simulation time, in the simulation's unit.
    pub time: f64,
    /// What it was generated with.
    pub params: GenerationParams,
    /// What that took, all that was generated for it included.
    pub cost: Cost,
    /// True if these are not the parameters that were set: with those it exceeded the size limit, or could not be generated.
    pub fell_back: bool,
    /// True if viewers can measure its quality.
    pub has_reference: bool,
    /// True if it was coded after the step before it: its size says little of the parameters.
    pub is_after_another: bool,
}
