//! What a generator-node is told to generate steps with.

use crate::{GenerationParams, Limits, TuningState};

/// What is best among what keeps the limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Objective {
    /// The highest PSNR.
    #[default]
    Quality,
    /// The fewest bytes.
    Size,
    /// Something that time counts in.
    Time,
}

/// Parameters, and what to do where a step exceeds the size limit with them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Setting {
    /// Used first; `None`: what the node starts with by itself, or, where a setting only brings limits, what is in force.
    pub params: Option<GenerationParams>,
    /// What every step has to keep. A generator-node enforces the size alone: time cannot be taken back, and it does not know
    /// the quality.
    pub limits: Limits,
    /// What is best among what keeps them.
    pub objective: Objective,
    /// What the node starts with by itself is to be a VDI.
    pub only_vdis: bool,
    /// Tried in turn while the encoded step exceeds the size limit; by falling size.
    pub fallbacks: Vec<GenerationParams>,
    /// What the parameters come from.
    pub tuning: TuningState,
}
