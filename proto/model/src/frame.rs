//! What accompanies an encoded step on its way to the viewers.

use crate::{Cost, Diagnostics, GenerationParams, Limits, TuningState};
use std::time::Duration;

/// One encoded step, without its bytes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// The run's id.
    pub run_id: String,
    /// The step's number.
    pub step: u64,
    /// Simulation time, in the simulation's unit.
    pub time: f64,
    /// What it was generated with.
    pub params: GenerationParams,
    /// What that took.
    pub cost: Cost,
    /// The trial it was made for; `None` for a live step.
    pub trial_id: Option<u64>,
    /// Steps of the run that were dropped or left incomplete so far.
    pub dropped_steps: u64,
    /// Bytes as encoded.
    pub bytes: u64,
    /// The step that this one was coded after, the last one sent before it: without it the bytes cannot be decoded. `None` for a key
    /// frame.
    pub after_step: Option<u64>,
    /// Voxels that are NaN or infinite, drawn as empty.
    pub empty_voxels: u64,
    /// Ranks that fell silent and whose bricks the step lacks: a hole, among the empty voxels.
    pub lost_ranks: Vec<u32>,
    /// Triggers that fired at this step.
    pub triggers: Vec<String>,
    /// What the simulation told of the step beside its field.
    pub diagnostics: Diagnostics,
    /// What computing the shown field from the run's took; zero where one is shown as it is.
    pub derivation: Duration,
    /// The limits in force.
    pub limits: Limits,
    /// What the parameters come from.
    pub tuning: TuningState,
    /// By which share of its time a step of the simulation takes longer beside the nodes, where that is known.
    pub overhead: Option<f64>,
    /// Share of its processor time that the generator-node allows itself to keep a limit on overhead, at most 1.
    pub throttle: f64,
}
