//! What is being simulated.

use crate::Grid;

/// A run of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct RunInfo {
    /// Unique: the user's name for it and a part that the generator-node adds.
    pub id: String,
    /// The user's name for it.
    pub name: String,
    /// What the scalar is.
    pub field: String,
    /// The grid of its steps.
    pub grid: Grid,
}
