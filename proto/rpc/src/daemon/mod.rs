//! What every daemon does around its services: read its configuration, log, listen, answer, stop cleanly.

mod access;
mod address_share;
mod config;
mod connections;
mod diagnosis;
mod heartbeat;
mod histogram;
mod message_memory;
mod metrics;
mod png_file;
mod random;
mod rate_limit;
mod refusals;
mod reload;
mod serve;
mod server_tls;
mod traces;

pub use access::{Access, AllowRoles, Identity, Peer, peer_of};
pub use config::{check_log, exit_code, load_config, log_to_stderr};
pub use diagnosis::{DiagnosisService, diagnosis};
pub use heartbeat::with_heartbeat;
pub use histogram::Histogram;
pub use metrics::{Exposition, Metrics, route as metrics_route};
pub use png_file::png;
pub use random::random;
pub use refusals::Refusals;
pub use reload::ConfigSource;
pub use serve::{Running, Shutdown, listen, nowhere, serve, serve_grpc, stop_signal};
pub use traces::{Attributes, Timeline, Trace, Traces, collect_traces};

use std::net::SocketAddr;

/// Why a daemon did not start or stopped.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// The configuration file cannot be read.
    #[error("{path}: {reason}; give a readable file with --config")]
    Unreadable {
        /// The file.
        path: String,
        /// The system's words.
        reason: std::io::Error,
    },
    /// The configuration file says something it must not.
    #[error("{path}: {reason}")]
    Config {
        /// The file.
        path: String,
        /// Line, key, and what is accepted there.
        reason: String,
    },
    /// The address cannot be listened on.
    #[error(
        "cannot listen on {address}: {reason}; choose another address (--listen, `listen` in the configuration, --viewer of `lamina`), or stop what uses it"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's words.
        reason: std::io::Error,
    },
    /// Others could reach the node, and nothing says who may.
    #[error(
        "{address} can be reached from other hosts: name credentials (--credentials DIR, made by `lamina keys`), listen on 127.0.0.1, or let everybody in (--insecure)"
    )]
    Open {
        /// The address.
        address: SocketAddr,
    },
    /// The credentials cannot be used.
    #[error(transparent)]
    Credentials(#[from] crate::credentials::CredentialsError),
    /// A value of the configuration cannot be used.
    #[error(transparent)]
    Invalid(#[from] lamina_model::Invalid),
    /// The system gives no thread.
    #[error("no thread: {0}")]
    Thread(std::io::Error),
}
