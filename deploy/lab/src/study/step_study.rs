//! All measurements of one step.

use lamina::in_process::InProcessEvaluator;
use lamina_tuner::tune::Trial;

/// One step of one input, measured.
pub(crate) struct StepStudy {
    /// The input's name.
    pub name: String,
    /// Which step of it.
    pub step: u64,
    /// Every trial, gamma by gamma within a resolution.
    pub rows: Vec<Trial>,
    /// What can measure more of it.
    pub trial: InProcessEvaluator,
}
