//! Errors of the store.

/// Why a step cannot be stored or shown.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder cannot be used.
    #[error("{path}: {reason}; give a folder that can be written with `store`")]
    Folder {
        /// Which.
        path: String,
        /// The system's words.
        reason: std::io::Error,
    },
    /// No such run is recorded beside the current one.
    #[error("run {0:?} is not recorded here; /api/runs lists those that are")]
    NoRun(String),
    /// No such step is held.
    #[error("step {0} is not held; /api/state lists those that are")]
    NoStep(u64),
    /// The step's bytes are damaged.
    #[error("step {step}: {reason}")]
    Damaged {
        /// Which.
        step: u64,
        /// What the codec says.
        reason: lamina_codec::CodecError,
    },
}
