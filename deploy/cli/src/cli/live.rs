//! Options of the commands that watch a simulation: `live`, `replay` and `serve`.

use super::Raw;
use clap::{Args, ValueEnum};
use lamina_compute::CpuLimit;
use lamina_compute::gpu::Choice;
use lamina_model::Representation;
use lamina_tuner::Contract;
use lamina_tuner::search::SearchGrid;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

/// Options of `lamina live`.
#[derive(Debug, Args)]
pub struct Live {
    /// Grid cells per side of the example simulation
    #[arg(long, default_value_t = 96, value_name = "N")]
    pub cells: usize,
    /// Which clumps: another number, another field
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Steps a second of the example simulation; 0: as fast as it can
    #[arg(long, default_value = "2", value_name = "STEPS/S", allow_negative_numbers = true)]
    pub pace: StepsPerSecond,
    /// Threads of the example simulation [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Terms of the example simulation beyond the gas itself; a tracer of the gas that was in the blast gives the colors
    #[arg(long, value_name = "TERM,..", value_delimiter = ',')]
    pub terms: Vec<Term>,
    #[command(flatten)]
    pub watch: Watch,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Term {
    Gravity,
    Cooling,
    Viscosity,
    Tracer,
}

/// Options of `lamina replay`.
#[derive(Debug, Args)]
pub struct Replay {
    /// .pvd, .vti, .nhdr, .nrrd, .raw, .raw.gz, .h5, .vtkhdf, .nc, .zarr, .tif, a plotfile, or a pattern or folder of them
    #[arg(value_name = "SERIES")]
    pub input: PathBuf,
    #[command(flatten)]
    pub raw: Raw,
    /// Steps a second, as a simulation that does not wait; without: as fast as the nodes take them
    #[arg(long, value_name = "STEPS/S", conflicts_with = "headless", allow_negative_numbers = true)]
    pub pace: Option<StepsPerSecond>,
    #[command(flatten)]
    pub watch: Watch,
}

/// Steps a second; 0 is no limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepsPerSecond(pub f64);

impl FromStr for StepsPerSecond {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pace = text.parse().ok().filter(|pace: &f64| (0.0..=1e6).contains(pace));
        pace.map(Self)
            .ok_or_else(|| format!("\"{text}\" is no number of steps a second, 0 to 1000000; 0 is as fast as it can"))
    }
}

/// Options of `lamina serve`.
#[derive(Debug, Args)]
pub struct Serve {
    /// Where simulations connect
    #[arg(long, default_value = "127.0.0.1:7101", value_name = "IP:PORT")]
    pub listen: SocketAddr,
    /// Memory for time steps in the generator-node, MiB
    #[arg(long, default_value_t = 2048, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..=1 << 30))]
    pub memory: u64,
    #[command(flatten)]
    pub nodes: NodeOptions,
}

/// How a run is watched.
#[derive(Debug, Args)]
pub struct Watch {
    /// Stop after N steps
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// No viewer: every step is tuned, measured and recorded before the next is taken
    #[arg(long, conflicts_with = "cpu_share")]
    pub headless: bool,
    /// Rays per side, with --gamma: no tuning
    #[arg(long, value_name = "R", requires = "gamma", conflicts_with = "contract")]
    pub resolution: Option<u32>,
    /// Interrupt parameter, with --resolution: no tuning
    #[arg(long, value_name = "G", requires = "resolution", allow_negative_numbers = true)]
    pub gamma: Option<f64>,
    /// Push to this running generator-node instead of starting the nodes here
    #[arg(long, value_name = "http://HOST:PORT", conflicts_with_all = ["out", "headless", "contract", "resolution", "cpu_share"])]
    pub generator: Option<String>,
    #[command(flatten)]
    pub nodes: NodeOptions,
}

/// How the nodes are set up that run in this process.
#[derive(Debug, Args)]
pub struct NodeOptions {
    /// Folder for steps.csv, VDIs, pictures and report.html
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Scene file (TOML): transfer function, camera, background, step
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// What every step must keep and what is best, such as "size <= 300kB, time <= 40ms"; default: size <= 300kB
    #[arg(long, value_name = "CONTRACT")]
    pub contract: Option<Contract>,
    /// What a step may be turned into: vdi, volume, or both, of which the tuner takes what is better; untuned: the first
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = Representation::ALL)]
    pub representation: Vec<Representation>,
    /// Tune again every n-th step (0: only when a step is unlike those tuned for, or a limit is broken)
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub retune_every: u64,
    /// Parameters of VDIs that the tuner chooses from: auto, coarse, paper, or R_FROM:R_TO:R_STEP,GAMMA_FROM:GAMMA_TO:GAMMA_STEP
    #[arg(long, default_value = "auto", value_name = "GRID")]
    pub grid: SearchGrid,
    /// What casts rays and draws: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
    /// Processor time of the nodes, viewer and tuner together: cores, such as 0.5, or percent of the machine's; default: half of
    /// the cores, at least one
    #[arg(long, value_name = "CORES", allow_negative_numbers = true)]
    pub cpu_share: Option<CpuLimit>,
    /// Let everybody in who reaches an address, where that is another than this host's own
    #[arg(long)]
    pub insecure: bool,
    /// Address of the viewer
    #[arg(long, default_value = "127.0.0.1:7102", value_name = "IP:PORT")]
    pub viewer: SocketAddr,
}
