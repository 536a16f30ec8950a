//! The viz-node's configuration file.

use lamina_compute::CpuLimit;
use lamina_compute::gpu::Choice;
use lamina_model::Invalid;
use lamina_rpc::connect::NodeAddress;
use lamina_rpc::daemon::check_log;
use serde::{Deserialize, Serialize};
use std::{net::SocketAddr, path::PathBuf};

/// All keys of the configuration; every one has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What is logged, unless RUST_LOG says it: `error`, `warn`, `info`, `debug` or `trace`.
    pub log: String,
    /// Where the page, the metrics and the gRPC services are.
    pub listen: SocketAddr,
    /// Folder of keys that `lamina keys` made, with which others than the own user on this host may connect.
    pub credentials: Option<PathBuf>,
    /// Everybody who reaches the address may use the node.
    pub insecure: bool,
    /// Names by which browsers may reach the page, besides `localhost`, this host's name and IP addresses.
    pub hosts: Vec<String>,
    /// The generator-node to subscribe to.
    pub generator: String,
    /// Where the tuner reaches this node, `http://HOST:PORT`; a host of `0.0.0.0` or `[::]` is replaced by the address that the
    /// generator-node sees. Without it, `listen`; empty: no trials are measured here.
    pub quality_address: Option<String>,
    /// Folder in which every step is recorded; without one the newest are held in memory.
    pub store: Option<PathBuf>,
    /// Bytes of encoded VDIs held in memory when there is no folder.
    pub memory_bytes: u64,
    /// Largest encoded VDI accepted, bytes.
    pub max_frame_bytes: u64,
    /// Largest VDI accepted once decoded, bytes.
    pub max_decoded_bytes: u64,
    /// Processor time of the node's own: cores (0.5) or percent of the machine's ("25%").
    pub cpu_share: CpuLimit,
    /// What draws pictures and measures quality: `auto` (a GPU if there is a real one), `cpu` or `gpu`.
    pub backend: Choice,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            log: "info".to_owned(),
            listen: SocketAddr::from(([127, 0, 0, 1], 7102)),
            credentials: None,
            insecure: false,
            hosts: Vec::new(),
            generator: "http://127.0.0.1:7101".to_owned(),
            quality_address: None,
            store: None,
            memory_bytes: 256 << 20,
            max_frame_bytes: 256 << 20,
            max_decoded_bytes: 1 << 30,
            cpu_share: CpuLimit::default(),
            backend: Choice::Auto,
        }
    }
}

impl Config {
    /// Keys that a running node takes up on SIGHUP.
    pub const LIVE: &[&str] = &["log", "hosts", "cpu_share"];

    /// Passes a configuration that can be run.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn check(self) -> Result<Self, Invalid> {
        check_log(&self.log)?;
        NodeAddress::read("generator", &self.generator)?;
        if let Some(address) = self.quality_address.as_deref().filter(|a| !a.is_empty()) {
            NodeAddress::read("quality_address", address)?;
        }
        Ok(self)
    }
}
