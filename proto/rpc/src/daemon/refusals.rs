//! What a node's server refused, for its metrics.

use std::sync::atomic::AtomicU64;

/// What was refused.
#[derive(Debug, Default)]
pub struct Refusals {
    /// Requests of connections that sent too many.
    pub rate: AtomicU64,
    /// Requests whose body did not come in time, and calls whose message did not.
    pub slow: AtomicU64,
    /// Messages that waited until others of their address had come.
    pub waited: AtomicU64,
    /// Connections of addresses that had as many as one may have.
    pub crowded: AtomicU64,
    /// Connections that ended with an error, those whose requests did not come in time among them.
    pub broken: AtomicU64,
}
