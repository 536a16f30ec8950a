//! Why ingest did not do what a rank asked.

use lamina_model::Invalid;

/// A refusal, told apart by what the simulation can do about it. Every text names the thing and the remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IngestError {
    /// What the rank said cannot be right, whatever the node's state.
    #[error("{0}")]
    Refused(String),
    /// The same brick of the same step was pushed before; the first one stands.
    #[error("step {step}: rank {rank} pushed twice")]
    Repeated {
        /// The step.
        step: u64,
        /// Whose brick.
        rank: u32,
    },
    /// It contradicts a run, or another rank of it, that is there.
    #[error("{0}")]
    Conflict(String),
    /// The run's grid does not fit the node's memory.
    #[error(
        "a grid of {dims:?} {voxels} voxels needs {needed_bytes} bytes, this generator-node has {memory_bytes}; raise memory_bytes in its configuration"
    )]
    Exhausted {
        /// Sample points per axis.
        dims: [usize; 3],
        /// Types of the fields.
        voxels: String,
        /// Bytes of a step and of the work on it.
        needed_bytes: u64,
        /// Bytes there are.
        memory_bytes: u64,
    },
    /// The run's id is not that of the open run.
    #[error("no run \"{0}\" is open on this generator-node (it may have been restarted); open it again")]
    UnknownRun(String),
}

impl From<Invalid> for IngestError {
    fn from(invalid: Invalid) -> Self {
        Self::Refused(invalid.to_string())
    }
}
