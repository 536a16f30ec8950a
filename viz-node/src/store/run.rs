//! Description of a run, as recorded beside its steps.

use lamina_model::RunInfo;
use serde::{Deserialize, Serialize};

/// What is being simulated.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Unique.
    pub id: String,
    /// The user's name for it.
    pub name: String,
    /// What the scalar is.
    pub field: String,
    /// Sample points per axis.
    pub dims: [u64; 3],
}

impl From<RunInfo> for Run {
    fn from(run: RunInfo) -> Self {
        let dims = run.grid.dims().map(|n| n as u64);
        Self { id: run.id, name: run.name, field: run.field, dims }
    }
}
