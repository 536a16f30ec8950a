//! What went wrong at a node, in words.

use crate::evaluator::TrialError;
use lamina_rpc::connect::innermost;
use tonic::Status;

/// A node of some `kind` at `address` failed.
pub(super) fn node_error(kind: &str, address: &str, reason: &str) -> TrialError {
    TrialError::Node { node: format!("{kind} {address}"), reason: reason.to_owned() }
}

/// What a failed call says: the cause at the bottom, if the transport knows one.
pub(crate) fn words(status: &Status) -> String {
    std::error::Error::source(status).map_or_else(|| status.message().to_owned(), innermost)
}
