//! `lamina doctor`: what this machine offers, and what it reaches.

mod cluster;
mod link;

use crate::cli;
use std::net::{Ipv4Addr, TcpListener};

/// Ports that the nodes use by default.
const PORTS: [(u16, &str); 3] = [(7101, "generator-node"), (7102, "viz-node and viewer"), (7103, "tuner")];

/// Prints one line a finding.
pub fn doctor(arguments: &cli::Doctor) -> anyhow::Result<()> {
    if !arguments.cluster.is_empty() {
        return cluster::check(&arguments.cluster, arguments.credentials.as_deref());
    }
    say!("lamina     {}", env!("CARGO_PKG_VERSION"));
    say!("cores      {}", std::thread::available_parallelism().map_or(1, usize::from));
    say!("vectors    {}", vector_units());
    say!("memory     {}", memory());
    for (port, node) in PORTS {
        let free = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok();
        let state = if free { "free" } else { "in use; choose another with --listen or --viewer" };
        say!("port {port}  {state} ({node})");
    }
    match lamina_compute::gpu::adapter() {
        Some(a) => say!("gpu        {} ({}, {})", a.name, a.kind, a.driver),
        None => say!("gpu        none (no Vulkan loader or no device); nothing needs one"),
    }
    Ok(())
}

fn vector_units() -> String {
    #[cfg(target_arch = "x86_64")]
    {
        let units = [
            ("sse4.2", is_x86_feature_detected!("sse4.2")),
            ("avx2", is_x86_feature_detected!("avx2")),
            ("fma", is_x86_feature_detected!("fma")),
            ("avx512f", is_x86_feature_detected!("avx512f")),
        ];
        let found: Vec<&str> = units.iter().filter(|(_, has)| *has).map(|(name, _)| *name).collect();
        if found.is_empty() { "sse2".to_owned() } else { found.join(" ") }
    }
    #[cfg(not(target_arch = "x86_64"))]
    std::env::consts::ARCH.to_owned()
}

fn memory() -> String {
    let info = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kib = |key: &str| {
        let line = info.lines().find(|l| l.starts_with(key))?;
        line.split_whitespace().nth(1)?.parse::<f64>().ok()
    };
    match (kib("MemTotal:"), kib("MemAvailable:")) {
        (Some(total), Some(free)) => format!("{:.1} GiB, {:.1} GiB available", total / 1048576.0, free / 1048576.0),
        _ => "unknown (no /proc/meminfo)".to_owned(),
    }
}
