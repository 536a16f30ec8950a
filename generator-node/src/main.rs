//! The generator-node as a daemon.

use clap::Parser;
use lamina_compute::CpuShare;
use lamina_compute::gpu::Choice;
use lamina_generator_node::{Config, run};
use lamina_raycast::Backend;
use lamina_rpc::daemon::{exit_code, listen, load_config, log_to_stderr, stop_signal};
use std::{net::SocketAddr, path::PathBuf};

/// Stands beside a simulation: takes its time steps and publishes them as Volumetric Depth Images.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Configuration file (TOML); every key has a default.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Address to listen on, instead of the configuration's.
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
    /// What casts the rays, instead of the configuration's: auto, cpu or gpu.
    #[arg(long)]
    backend: Option<Choice>,
}

#[tokio::main]
async fn main() -> std::process::ExitCode {
    exit_code(start().await)
}

async fn start() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    log_to_stderr("info");
    let config: Config = load_config(arguments.config.as_deref())?;
    let config = Config { listen: arguments.listen.unwrap_or(config.listen), ..config }.check()?;
    let backend = Backend::open(arguments.backend.unwrap_or(config.backend))?;
    let listener = listen(config.listen).await?;
    let share = CpuShare::new(config.cpu_share)?;
    Ok(run(config, backend, share, listener, Box::pin(stop_signal())).await?)
}
