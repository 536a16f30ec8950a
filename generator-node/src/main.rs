//! The generator-node as a daemon.

use clap::Parser;
use lamina_codec::Codec;
use lamina_compute::CpuShare;
use lamina_compute::gpu::Choice;
use lamina_generator_node::{Config, run, run_member};
use lamina_raycast::Backend;
use lamina_rpc::daemon::{ConfigSource, exit_code, listen, load_config, log_to_stderr, stop_signal};
use lamina_rpc::launcher::launched_rank;
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
    /// Folder of keys that `lamina keys` made, instead of the configuration's.
    #[arg(long, value_name = "DIR", env = "LAMINA_CREDENTIALS")]
    credentials: Option<PathBuf>,
    /// Let everybody use the node who reaches its address.
    #[arg(long)]
    insecure: bool,
    /// What casts the rays, instead of the configuration's: auto, cpu or gpu.
    #[arg(long)]
    backend: Option<Choice>,
    /// Be one of a group: `mpirun -n P generator-node --group`, or `srun`. Rank 0 listens where it is told to, and simulations, viewers
    /// and the tuner connect there; the others take a free port each.
    #[arg(long)]
    group: bool,
}

#[tokio::main]
async fn main() -> std::process::ExitCode {
    exit_code(start().await)
}

/// Whether the members of a group can do what `config` asks for.
///
/// # Errors
/// If not.
fn can_be_shared(config: &Config) -> anyhow::Result<()> {
    config.check_triggers_of_group()?;
    if config.encode_options().codec != Codec::ContextMixing {
        anyhow::bail!("codec: the members of a group code by context-mixing; leave codec out, or use one node");
    }
    Ok(())
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
        ..config
    }
    .check()?;
    if arguments.group {
        can_be_shared(&config)?;
    }
    let mesh = arguments.group.then(|| lamina_mpi::join(launched_rank().map(|(_, ranks)| ranks))).transpose()?;
    let config = match &mesh {
        Some((outbox, _)) if outbox.rank() > 0 => Config { listen: SocketAddr::new(config.listen.ip(), 0), ..config },
        _ => config,
    };
    let backend = Backend::open(arguments.backend.unwrap_or(config.backend))?;
    let listener = listen(config.listen).await?;
    let share = CpuShare::new(config.cpu_share)?;
    let stop = Box::pin(stop_signal());
    let (live, path) = (Config::LIVE, arguments.config);
    let settings =
        ConfigSource { path, in_file, in_force: config, live, check: Config::check, log: |config| &config.log };
    match mesh {
        Some(mesh) => run_member(settings.follow(), backend, share, listener, stop, mesh).await?,
        None => run(settings.follow(), backend, share, listener, stop).await?,
    }
    Ok(())
}
