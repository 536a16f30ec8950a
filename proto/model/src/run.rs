//! What is being simulated.

use crate::Grid;

/// A run of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct RunInfo {
    /// Unique: the user's name for it and a part that the generator-node adds.
    pub id: String,
    /// The user's name for it.
    pub name: String,
    /// What is shown: a field, or an expression over fields.
    pub field: String,
    /// The grid of its steps.
    pub grid: Grid,
}

impl RunInfo {
    /// The id of what is shown of the simulation's run `id` after so many changes of its field: each is a run of its own, because
    /// their steps cannot be compared.
    pub fn shown_id(id: &str, changes: u32) -> String {
        if changes == 0 { id.to_owned() } else { format!("{id}.{}", changes + 1) }
    }

    /// True if both ids are of one run of the simulation, whose own has no full stop.
    pub fn is_same_simulation(a: &str, b: &str) -> bool {
        a.split('.').next() == b.split('.').next()
    }
}
