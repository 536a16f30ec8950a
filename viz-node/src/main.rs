//! The viz-node as a daemon.

use clap::Parser;
use lamina_compute::CpuShare;
use lamina_compute::gpu::Choice;
use lamina_rpc::daemon::{ConfigSource, exit_code, listen, load_config, log_to_stderr, stop_signal};
use lamina_vdi_render::Backend;
use lamina_viz_node::{Config, open_store, run};
use std::{net::SocketAddr, path::PathBuf};

/// Shows a run from any angle in a web page, and measures the quality of what it shows.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Configuration file (TOML); every key has a default.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Address to listen on, instead of the configuration's.
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
    /// Folder of keys that `lamina keys` made, instead of the configuration's.
    #[arg(long, value_name = "DIR", env = "LAMINA_CREDENTIALS")]
    credentials: Option<PathBuf>,
    /// Let everybody use the node who reaches its address.
    #[arg(long)]
    insecure: bool,
    /// The generator-node, instead of the configuration's.
    #[arg(long, value_name = "http://HOST:PORT")]
    generator: Option<String>,
    /// Folder in which every step is recorded, instead of the configuration's.
    #[arg(long, value_name = "DIR")]
    store: Option<PathBuf>,
    /// What draws, instead of the configuration's: auto, cpu or gpu.
    #[arg(long, value_name = "auto|cpu|gpu")]
    backend: Option<Choice>,
}

#[tokio::main]
async fn main() -> std::process::ExitCode {
    exit_code(start().await)
}

async fn start() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    log_to_stderr("info");
    let in_file: Config = load_config(arguments.config.as_deref())?;
    let config = in_file.clone();
    let config = Config {
        listen: arguments.listen.unwrap_or(config.listen),
        credentials: arguments.credentials.or(config.credentials),
        insecure: arguments.insecure || config.insecure,
        generator: arguments.generator.unwrap_or(config.generator),
        store: arguments.store.or(config.store),
        backend: arguments.backend.unwrap_or(config.backend),
        ..config
    }
    .check()?;
    let listener = listen(config.listen).await?;
    let (store, backend) = (open_store(&config)?, Backend::open(config.backend)?);
    let share = CpuShare::new(config.cpu_share)?;
    let (live, path) = (Config::LIVE, arguments.config);
    let settings =
        ConfigSource { path, in_file, in_force: config, live, check: Config::check, log: |config| &config.log };
    Ok(run(settings.follow(), store, backend, share, listener, Box::pin(stop_signal())).await?)
}
