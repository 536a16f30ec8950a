//! Description of a run, as recorded beside its steps.

use lamina_rpc::v1;
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

impl From<&v1::Run> for Run {
    fn from(run: &v1::Run) -> Self {
        let dims = run.grid.map_or([0; 3], |g| [g.nx, g.ny, g.nz]);
        Self { id: run.run_id.clone(), name: run.name.clone(), field: run.field.clone(), dims }
    }
}
