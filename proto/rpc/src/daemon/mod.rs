//! What every daemon does around its services: read its configuration, log, listen, stop cleanly.

use lamina_model::Invalid;
use serde::de::DeserializeOwned;
use std::{future::Future, net::SocketAddr, path::Path, pin::Pin, time::Duration};
use tokio::net::TcpListener;
use tonic::codegen::http::uri::Authority;
use tonic::transport::server::Router;
use tonic::transport::{Channel, Endpoint};

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
    /// The transport failed while serving.
    #[error("serving: {0}")]
    Serve(#[from] tonic::transport::Error),
}

/// The configuration in the TOML file at `path`, or the defaults without one.
///
/// # Errors
/// If the file cannot be read, or has a key or value its type does not know.
pub fn load_config<T: DeserializeOwned + Default>(path: Option<&Path>) -> Result<T, NodeError> {
    let Some(path) = path else { return Ok(T::default()) };
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|reason| NodeError::Unreadable { path: name.clone(), reason })?;
    toml::from_str(&text).map_err(|e| NodeError::Config { path: name, reason: e.to_string().trim_end().to_owned() })
}

/// Log lines to standard error, `default_level` and above unless RUST_LOG says otherwise.
pub fn log_to_stderr(default_level: &str) {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| default_level.into());
    // A second call, in a process with several nodes, keeps the first subscriber.
    let colour = std::io::IsTerminal::is_terminal(&std::io::stderr());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let _ = log.with_target(false).with_ansi(colour).try_init();
}

/// What a binary ends with: one line about the error, if there is one.
pub fn exit_code(outcome: Result<(), impl std::fmt::Display>) -> std::process::ExitCode {
    match outcome {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}

/// Listens on `address`; port 0 takes a free one.
///
/// # Errors
/// If the address is in use or not this machine's.
pub async fn listen(address: SocketAddr) -> Result<TcpListener, NodeError> {
    TcpListener::bind(address).await.map_err(|reason| NodeError::Listen { address, reason })
}

/// Host and port of a node's address, `http://HOST:PORT`, that `field` gives.
///
/// # Errors
/// If it is none.
pub fn host_and_port(field: &'static str, address: &str) -> Result<(String, u16), Invalid> {
    let refuse = |why| {
        let example = "write http://HOST:PORT, such as http://10.0.0.7:7102";
        Invalid::new(field, format!("\"{address}\" {why}; {example}"))
    };
    let authority = address.strip_prefix("http://").ok_or_else(|| refuse("does not begin with http://"))?;
    let named: Authority =
        authority.strip_suffix('/').unwrap_or(authority).parse().map_err(|_| refuse("names no host and port"))?;
    let port = named.port_u16().filter(|&port| port != 0).ok_or_else(|| refuse("has no port"))?;
    if named.host().is_empty() || named.as_str().contains('@') {
        return Err(refuse("names no host"));
    }
    Ok((named.host().to_owned(), port))
}

/// A connection to the node at `address`, tried for at most two seconds. A peer that vanishes without a word is noticed
/// within twenty.
///
/// # Errors
/// If the address is none, or nobody answers there; the message is the cause at the bottom.
pub async fn connect(address: &str) -> Result<Channel, String> {
    let cause = |e: tonic::transport::Error| format!("not reachable ({})", innermost(&e));
    let endpoint = Endpoint::from_shared(address.to_owned()).map_err(cause)?;
    with_keep_alive(endpoint).connect_timeout(Duration::from_secs(2)).connect().await.map_err(cause)
}

/// The cause at the bottom: "connection refused" rather than "transport error".
pub fn innermost(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(next) = cause.source() {
        cause = next;
    }
    cause.to_string()
}

/// Windows for large payloads, and pings that tell a dead peer from a silent one.
fn with_keep_alive(endpoint: Endpoint) -> Endpoint {
    endpoint
        .tcp_nodelay(true)
        .initial_stream_window_size(4 << 20)
        .initial_connection_window_size(8 << 20)
        .http2_keep_alive_interval(Duration::from_secs(10))
        .keep_alive_timeout(Duration::from_secs(10))
        .keep_alive_while_idle(true)
}

/// How long connections may finish what they are doing after a stop was asked for.
const GRACE: Duration = Duration::from_secs(1);

/// What a node stops on. A boxed future, so that a node's machinery is compiled once, in its own crate.
pub type Shutdown = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Serves `router` on `listener` until `shutdown` completes, then for at most [`GRACE`] more.
///
/// # Errors
/// If the transport fails.
pub async fn serve(router: Router, listener: TcpListener, shutdown: Shutdown) -> Result<(), NodeError> {
    let incoming = tonic::transport::server::TcpIncoming::from(listener).with_nodelay(Some(true));
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let server = router.serve_with_incoming_shutdown(incoming, async {
        let _ = stopped.await;
    });
    tokio::pin!(server);
    tokio::select! {
        result = &mut server => return Ok(result?),
        () = shutdown => drop(stop),
    }
    match tokio::time::timeout(GRACE, server).await {
        Ok(result) => Ok(result?),
        // Streams that never end by themselves are cut here.
        Err(_) => Ok(()),
    }
}

/// Completes on SIGTERM or Ctrl-C.
pub async fn stop_signal() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        match signal(SignalKind::terminate()) {
            Ok(mut terminate) => tokio::select! { _ = interrupt => {}, _ = terminate.recv() => {} },
            Err(_) => drop(interrupt.await),
        }
    }
    #[cfg(not(unix))]
    drop(interrupt.await);
}

#[cfg(test)]
mod tests {
    use super::host_and_port;

    #[test]
    fn addresses_have_a_host_and_a_port() {
        for (good, host, port) in [
            ("http://127.0.0.1:7101", "127.0.0.1", 7101),
            ("http://node-17.cluster:80", "node-17.cluster", 80),
            ("http://[::1]:7101", "[::1]", 7101),
            ("http://host:7101/", "host", 7101),
        ] {
            assert_eq!(host_and_port("generator", good), Ok((host.to_owned(), port)));
        }
        for bad in [
            "",
            "http://",
            "http://:7101",
            "http://host",
            "http://host:0",
            "http://host:99999",
            "http://host:x",
            "http://host:7101//",
            "http://host:7101/x?y",
            "http://me@host:7101",
            "http://a b:1",
            "https://host:7101",
            "host:7101",
        ] {
            let refused = host_and_port("generator", bad).unwrap_err().to_string();
            assert!(refused.contains("generator") && refused.contains("http://HOST:PORT"), "{bad}: {refused}");
        }
    }
}
