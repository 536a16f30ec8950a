//! Connections to nodes: addresses, credentials, keep-alive, and the cause of a failure.

use crate::credentials::{CREDENTIALS_VARIABLE, Credentials, Role};
use crate::protocol::user_agent;
use lamina_model::Invalid;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::time::Duration;
use tonic::codegen::http::uri::Authority;
use tonic::transport::{Channel, Endpoint, Error};

/// Where a node is: `http://HOST:PORT`, or `https://HOST:PORT` of one that has credentials.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeAddress {
    /// Whether connections are secured by TLS.
    pub secure: bool,
    /// A name or an IP address; those of version 6 in brackets.
    pub host: String,
    /// The port, not 0.
    pub port: u16,
}

impl NodeAddress {
    /// Reads the address that `field` gives.
    ///
    /// # Errors
    /// If it is none.
    pub fn read(field: &'static str, address: &str) -> Result<Self, Invalid> {
        let refuse = |why| {
            let example =
                "write http://HOST:PORT, such as http://10.0.0.7:7102, or https:// where the node has credentials";
            Invalid::new(field, format!("\"{address}\" {why}; {example}"))
        };
        let (secure, authority) = match address.split_once("://") {
            Some(("http", authority)) => (false, authority),
            Some(("https", authority)) => (true, authority),
            _ => return Err(refuse("does not begin with http:// or https://")),
        };
        let named: Authority =
            authority.strip_suffix('/').unwrap_or(authority).parse().map_err(|_| refuse("names no host and port"))?;
        let port = named.port_u16().filter(|&port| port != 0).ok_or_else(|| refuse("has no port"))?;
        if named.host().is_empty() || named.as_str().contains('@') {
            return Err(refuse("names no host"));
        }
        Ok(Self { secure, host: named.host().to_owned(), port })
    }
}

impl fmt::Display for NodeAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "http{}://{}:{}", if self.secure { "s" } else { "" }, self.host, self.port)
    }
}

/// What connections to the node at `address`, which is to be a `server`, are made with.
///
/// # Errors
/// If the address is none, or asks for credentials that are not given or cannot be read.
pub fn endpoint(address: &str, server: Role, credentials: Option<&Credentials>) -> Result<Endpoint, Invalid> {
    let invalid = |reason: String| Invalid::new("address", reason);
    let secure = NodeAddress::read("address", address)?.secure;
    let endpoint = Endpoint::from_shared(address.to_owned()).map_err(|e| invalid(e.to_string()))?;
    let endpoint = endpoint.user_agent(user_agent()).map_err(|e| invalid(e.to_string()))?.tcp_nodelay(true);
    if !secure {
        return Ok(endpoint);
    }
    let missing = || invalid(format!("{address} asks for credentials; name their folder in {CREDENTIALS_VARIABLE}"));
    let tls = credentials.ok_or_else(missing)?.client_tls(server).map_err(|e| invalid(e.to_string()))?;
    endpoint.tls_config(tls).map_err(|e| invalid(format!("credentials: {}", innermost(&e))))
}

/// A connection to the node at `address`, which is to be a `server`, tried for at most two seconds. A peer that vanishes without a
/// word is noticed within twenty.
///
/// # Errors
/// As [`endpoint`], or if nobody answers there; the message is the cause at the bottom.
pub async fn connect(address: &str, server: Role, credentials: Option<&Credentials>) -> Result<Channel, String> {
    let endpoint = endpoint(address, server, credentials).map_err(|e| e.to_string())?;
    let endpoint = with_keep_alive(endpoint).connect_timeout(Duration::from_secs(2));
    channel(endpoint).await.map_err(|e| format!("not reachable ({})", innermost(&e)))
}

/// Connects to `endpoint`. A boxed future, so that the client's side of HTTP/2 is compiled once, in this crate.
pub fn channel(endpoint: Endpoint) -> Pin<Box<dyn Future<Output = Result<Channel, Error>> + Send>> {
    Box::pin(async move { endpoint.connect().await })
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
        .initial_stream_window_size(4 << 20)
        .initial_connection_window_size(8 << 20)
        .http2_keep_alive_interval(Duration::from_secs(10))
        .keep_alive_timeout(Duration::from_secs(10))
        .keep_alive_while_idle(true)
}

/// The name of this host; empty where the system does not say.
pub fn host_name() -> String {
    let name =
        std::fs::read_to_string("/proc/sys/kernel/hostname").or_else(|_| std::fs::read_to_string("/etc/hostname"));
    name.map(|name| name.trim().to_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::NodeAddress;

    #[test]
    fn addresses_have_a_host_and_a_port() {
        for (good, host, port) in [
            ("http://127.0.0.1:7101", "127.0.0.1", 7101),
            ("http://node-17.cluster:80", "node-17.cluster", 80),
            ("http://[::1]:7101", "[::1]", 7101),
            ("https://host:7101/", "host", 7101),
        ] {
            let address = NodeAddress::read("generator", good).unwrap();
            assert_eq!((address.host.as_str(), address.port), (host, port));
            assert_eq!(address.to_string(), good.trim_end_matches('/'));
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
            "ftp://host:7101",
            "host:7101",
        ] {
            let refused = NodeAddress::read("generator", bad).unwrap_err().to_string();
            assert!(refused.contains("generator") && refused.contains("http://HOST:PORT"), "{bad}: {refused}");
        }
    }
}
