//! Where a step's parameters come from.

use crate::named;
use serde::{Deserialize, Serialize};

/// How far the study has come that parameters are from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TuningState {
    /// The generator-node's own, before any trial.
    #[default]
    None,
    /// The best trial so far of a study that goes on or was cut short.
    Provisional,
    /// A whole study.
    Done,
}

named!(TuningState, "tuning", "neither none, provisional nor done", None "none", Provisional "provisional", Done "done");
