//! What happens to a time step that finds the generator-node's memory full.

/// The run's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FullPolicy {
    /// The oldest waiting step makes room: the simulation never waits, and who watches sees the present.
    #[default]
    DropOldest,
    /// The new step is not taken.
    DropNewest,
    /// The simulation waits, up to its own deadline.
    Block,
}
