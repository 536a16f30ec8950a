//! Connections to nodes: addresses, keep-alive, and the cause of a failure.

use lamina_model::Invalid;
use std::time::Duration;
use tonic::codegen::http::uri::Authority;
use tonic::transport::{Channel, Endpoint};

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

/// The name of this host; empty where the system does not say.
pub fn host_name() -> String {
    let name =
        std::fs::read_to_string("/proc/sys/kernel/hostname").or_else(|_| std::fs::read_to_string("/etc/hostname"));
    name.map(|name| name.trim().to_owned()).unwrap_or_default()
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
