//! Why a step was not handed over.

use lamina_model::Invalid;
use std::time::Duration;

/// Why a step was not handed over.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The arguments cannot be right, whoever listens.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// The generator-node refused; trying the same again will not help.
    #[error("refused by the generator-node: {0}")]
    Refused(String),
    /// The generator-node cannot be reached now; the client tries again by itself.
    #[error("generator-node {address} is not reachable ({reason}); start it or correct the address")]
    Unreachable {
        /// Where it should be.
        address: String,
        /// The transport's words.
        reason: String,
    },
    /// The time for it passed: the node is full (policy `block`) or stuck.
    #[error("no answer from the generator-node within {0:?}")]
    Deadline(Duration),
    /// The runtime that drives the connection could not be started.
    #[error("cannot start the client's runtime: {0}")]
    Runtime(std::io::Error),
}
