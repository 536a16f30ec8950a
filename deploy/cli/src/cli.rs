//! The command line.

use crate::dims::Dims;
use clap::{Args, Parser, Subcommand, ValueEnum};
use lamina_compute::CpuLimit;
use lamina_compute::gpu::Choice;
use lamina_model::{Representation, Segmentation, VoxelType};
use lamina_tuner::Contract;
use lamina_tuner::search::Grid;
use lamina_tuner::units::{Bytes, Millis};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

/// Watch a running simulation at a price you name.
///
/// Without a command: `live`.
#[derive(Parser)]
#[command(name = "lamina", version)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[derive(Subcommand)]
pub enum Command {
    /// Run the example simulation (a blast into clumps) and watch it
    Live(Live),
    /// Replay recorded data as if it were being simulated, and watch it
    Replay(Replay),
    /// Ray-cast a volume to a picture
    Raycast(Raycast),
    /// Make the Volumetric Depth Image of a volume, or a reduced volume
    Generate(Generate),
    /// Render a Volumetric Depth Image, or a reduced volume, from another angle
    Render(Render),
    /// Compare two pictures; the last line is `psnr_db <number>`
    Compare(Compare),
    /// Measure what this machine takes for a volume or a .vdi: times, or memory
    Bench(Bench),
    /// Find the best parameters of a volume under a contract
    Tune(Tune),
    /// Measure every (gamma, resolution) of a grid, as in the paper, and report what is best under which limit
    Study(Study),
    /// Measure what each step of accuracy costs for a volume: error, time and bytes
    Accuracy(Accuracy),
    /// Measure decibels against bytes of every representation and coding for a volume
    Rd(Rd),
    /// Say what this machine offers
    Doctor,
}

impl Default for Command {
    fn default() -> Self {
        #[derive(Parser)]
        struct Defaults {
            #[command(flatten)]
            live: Live,
        }
        Self::Live(Defaults::parse_from(["lamina"]).live)
    }
}

#[derive(Args)]
pub struct Live {
    /// Grid cells per side of the example simulation
    #[arg(long, default_value_t = 96, value_name = "N")]
    pub cells: usize,
    /// Which clumps: another number, another field
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Steps a second of the example simulation; 0: as fast as it can
    #[arg(long, default_value = "2", value_name = "STEPS/S", allow_negative_numbers = true)]
    pub pace: Pace,
    /// Threads of the example simulation [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Terms of the example simulation beyond the gas itself; a tracer of the gas that was in the blast gives the colours
    #[arg(long, value_name = "TERM,..", value_delimiter = ',')]
    pub terms: Vec<Term>,
    #[command(flatten)]
    pub watch: Watch,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Term {
    Gravity,
    Cooling,
    Viscosity,
    Tracer,
}

#[derive(Args)]
pub struct Replay {
    /// .pvd, .vti, .nhdr, .nrrd, .raw or .raw.gz
    #[arg(value_name = "SERIES")]
    pub input: PathBuf,
    #[command(flatten)]
    pub raw: Raw,
    /// Steps a second, as a simulation that does not wait; without: as fast as the nodes take them
    #[arg(long, value_name = "STEPS/S", conflicts_with = "headless", allow_negative_numbers = true)]
    pub pace: Option<Pace>,
    #[command(flatten)]
    pub watch: Watch,
}

/// Steps a second; 0 is no limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace(pub f64);

impl FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pace = text.parse().ok().filter(|pace: &f64| (0.0..=1e6).contains(pace));
        pace.map(Self)
            .ok_or_else(|| format!("\"{text}\" is no number of steps a second, 0 to 1000000; 0 is as fast as it can"))
    }
}

/// How a run is watched.
#[derive(Args)]
pub struct Watch {
    /// Stop after N steps
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// No viewer: every step is tuned, measured and recorded before the next is taken
    #[arg(long)]
    pub headless: bool,
    /// Folder for steps.csv, VDIs, pictures and report.html
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Scene file (TOML): transfer function, camera, background, step
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// What every step must keep and what is best, such as "size <= 300kB, time <= 40ms"; default: size <= 300kB
    #[arg(long, value_name = "CONTRACT")]
    pub contract: Option<Contract>,
    /// Rays per side, with --gamma: no tuning
    #[arg(long, value_name = "R", requires = "gamma", conflicts_with = "contract")]
    pub resolution: Option<u32>,
    /// Interrupt parameter, with --resolution: no tuning
    #[arg(long, value_name = "G", requires = "resolution", allow_negative_numbers = true)]
    pub gamma: Option<f64>,
    /// What a step may be turned into: vdi, volume, or both, of which the tuner takes what is better; untuned: the first
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = Representation::ALL)]
    pub representation: Vec<Representation>,
    /// Tune again every n-th step (0: only when a step is unlike those tuned for, or a limit is broken)
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub retune_every: u64,
    /// Parameters of VDIs that the tuner chooses from: auto, coarse, paper, or R_FROM:R_TO:R_STEP,GAMMA_FROM:GAMMA_TO:GAMMA_STEP
    #[arg(long, default_value = "auto", value_name = "GRID")]
    pub grid: Grid,
    /// What casts rays and draws: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
    /// Processor time of the nodes, viewer and tuner together: cores, such as 0.5, or percent of the machine's; default: half of
    /// the cores, at least one
    #[arg(long, value_name = "CORES", conflicts_with_all = ["headless", "generator"], allow_negative_numbers = true)]
    pub cpu_share: Option<CpuLimit>,
    /// Address of the viewer
    #[arg(long, default_value = "127.0.0.1:7102", value_name = "IP:PORT")]
    pub viewer: SocketAddr,
    /// Push to this running generator-node instead of starting the nodes here
    #[arg(long, value_name = "http://HOST:PORT", conflicts_with_all = ["out", "headless", "contract", "resolution"])]
    pub generator: Option<String>,
}

#[derive(Args)]
pub struct Study {
    /// .pvd, .vti, .nhdr, .nrrd, .raw or .raw.gz; one or more
    #[arg(value_name = "INPUT", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Folder for measurements.csv, report.html and what else is found; what an interrupted study measured is there too
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Which time steps of series, counted from 0
    #[arg(long, value_name = "N,..", value_delimiter = ',')]
    pub steps: Vec<usize>,
    /// Parameters measured: the paper's 1300, coarse: 18 for a quick look, auto: 880 in a range found from the data, or
    /// R_FROM:R_TO:R_STEP,GAMMA_FROM:GAMMA_TO:GAMMA_STEP
    #[arg(long, default_value = "paper", value_name = "GRID")]
    pub grid: Grid,
    /// How samples become the supersegments of a VDI: greedy (and bzip2) as in the paper, or fitted (and context-mixing) as nodes send
    /// them
    #[arg(long, value_name = "NAME", default_value_t = Segmentation::Greedy)]
    pub segmentation: Segmentation,
    /// Size limits to choose under; without: a ladder, each 1.5 times the one before
    #[arg(long, value_name = "SIZE,..", value_delimiter = ',')]
    pub size_limits: Vec<Bytes>,
    /// Limits on generation time to choose under; without: a ladder as well
    #[arg(long, value_name = "TIME,..", value_delimiter = ',')]
    pub time_limits: Vec<Millis>,
    #[command(flatten)]
    pub raw: Raw,
    /// Scene file (TOML)
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// What casts rays and draws: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
}

#[derive(Args)]
pub struct Tune {
    #[command(flatten)]
    pub input: Input,
    /// What to keep and what is best, such as "size <= 300kB, psnr >= 35dB, minimise time"
    #[arg(long, value_name = "CONTRACT", default_value_t)]
    pub contract: Contract,
    /// What a step may be turned into: vdi, volume, or both, of which the tuner takes what is better
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = Representation::ALL)]
    pub representation: Vec<Representation>,
    /// Parameters of VDIs to choose from: auto, coarse, paper, or R_FROM:R_TO:R_STEP,GAMMA_FROM:GAMMA_TO:GAMMA_STEP
    #[arg(long, default_value = "auto", value_name = "GRID")]
    pub grid: Grid,
}

/// What a raw file does not say.
#[derive(Args)]
pub struct Raw {
    /// Voxels per side of a raw file, x fastest
    #[arg(long, value_name = "NXxNYxNZ")]
    pub dims: Option<Dims>,
    /// Voxel type of a raw file: uint8, uint16, int16, float32, float64
    #[arg(long, value_name = "TYPE")]
    pub dtype: Option<VoxelType>,
    /// Array to read, where a file has several
    #[arg(long, value_name = "NAME")]
    pub field: Option<String>,
}

/// One volume.
#[derive(Args)]
pub struct Input {
    /// .pvd, .vti, .nhdr, .nrrd, .raw or .raw.gz
    pub input: PathBuf,
    #[command(flatten)]
    pub raw: Raw,
    /// Which time step of a series, counted from 0
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub time_step: usize,
    /// Scene file (TOML)
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// What casts the rays: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
    /// Sampling step in voxels, instead of the scene's
    #[arg(long, value_name = "VOXELS", allow_negative_numbers = true)]
    pub step: Option<f64>,
}

/// One picture.
#[derive(Args)]
pub struct View {
    /// Rotation about +y through the target, degrees
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_negative_numbers = true)]
    pub view: f64,
    /// Side of the picture, pixels
    #[arg(long, default_value_t = 768, value_name = "PX")]
    pub size: u32,
    /// Where to write: .png, or .pfm for float
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

#[derive(Args)]
pub struct Raycast {
    #[command(flatten)]
    pub input: Input,
    #[command(flatten)]
    pub view: View,
}

#[derive(Args)]
pub struct Generate {
    #[command(flatten)]
    pub input: Input,
    /// What the volume is turned into: vdi or volume
    #[arg(long, value_name = "NAME", default_value_t)]
    pub representation: Representation,
    /// Rays per side; of a volume, the most sample points on a side
    #[arg(long, default_value_t = 256, value_name = "R")]
    pub resolution: u32,
    /// Interrupt parameter, how much supersegments may leave out: 0 keeps every sample. Of a volume, the greatest error of a
    /// value, 1 being the range shown
    #[arg(long, default_value_t = 0.02, value_name = "G", allow_negative_numbers = true)]
    pub gamma: f64,
    /// End rays at this opacity; 1 never
    #[arg(long, default_value_t = 1.0, value_name = "ALPHA")]
    pub opacity_cutoff: f64,
    /// How samples become the supersegments of a VDI: fitted, or greedy as in the paper
    #[arg(long, value_name = "NAME", default_value_t)]
    pub segmentation: Segmentation,
    /// Byte layout: columns, or the paper's plain records
    #[arg(long, default_value = "columns")]
    pub layout: LayoutName,
    /// What makes a VDI small: context-mixing (of neighboring rays), bzip2, or zstd in a sixth of the time [default:
    /// context-mixing; bzip2 for the plain layout]
    #[arg(long, value_name = "NAME", hide_possible_values = true)]
    pub codec: Option<CodecName>,
    /// Where to write it
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum LayoutName {
    Columns,
    Plain,
}

#[derive(Clone, Copy, ValueEnum, PartialEq)]
pub enum CodecName {
    ContextMixing,
    Bzip2,
    Zstd,
}

#[derive(Args)]
pub struct Render {
    /// A Volumetric Depth Image or reduced volume, as `generate` writes them
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// What draws: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
    #[command(flatten)]
    pub view: View,
}

#[derive(Args)]
pub struct Compare {
    /// A picture: .png or .pfm
    pub a: PathBuf,
    /// Another of the same size
    pub b: PathBuf,
}

#[derive(Args)]
#[command(mut_arg("input", |input| input.required(false).default_value(NO_INPUT).hide_default_value(true)))]
pub struct Bench {
    #[command(flatten)]
    pub input: Input,
    #[command(flatten)]
    pub coupled: BenchLive,
    /// Rays per side of the VDI that is encoded and rendered
    #[arg(long, default_value_t = 256, value_name = "R")]
    pub resolution: u32,
    /// Interrupt parameter
    #[arg(long, default_value_t = 0.02, value_name = "G", allow_negative_numbers = true)]
    pub gamma: f64,
    /// Sides of the pictures, pixels. For the first one all rays are also cast to their end, and a VDI generated with
    /// as many
    #[arg(long, default_value = "768,512", value_delimiter = ',', value_name = "PX,..")]
    pub size: Vec<u32>,
    /// Also generate for all 65 gammas of the paper at once; their VDIs are kept together and take memory
    #[arg(long)]
    pub gammas: bool,
    /// How often each is measured, after once to warm up
    #[arg(long, default_value_t = 7, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub rounds: u32,
    /// The most memory in use at once, instead of times
    #[arg(long)]
    pub memory: bool,
    /// What each effect costs and changes, alone and in pairs, instead: pictures of the first size, VDIs of --resolution
    #[arg(long, conflicts_with_all = ["memory", "json", "gammas"])]
    pub effects: bool,
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
}

/// Stands for a file that is not given.
pub const NO_INPUT: &str = "-";

/// A simulation beside the nodes.
#[derive(Args)]
pub struct BenchLive {
    /// Run a simulation alone, then beside the nodes: picks, slowdown, processor time, pictures
    #[arg(long)]
    pub live: bool,
    /// Also beside N threads that compute without end
    #[arg(long, default_value_t = 0, value_name = "N", requires = "live")]
    pub busy: u16,
    /// A recorded series instead of the example simulation
    #[arg(long, value_name = "SERIES", requires = "live")]
    pub replay: Option<PathBuf>,
    /// Steps a second; 0: as fast as it can
    #[arg(long, default_value = "2", value_name = "STEPS/S", allow_negative_numbers = true)]
    pub pace: Pace,
    /// Seconds of the coupled part; alone takes as long
    #[arg(long, default_value_t = 40.0, value_name = "S", allow_negative_numbers = true)]
    pub seconds: f64,
    /// Pages that turn the picture meanwhile
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub pages: u16,
    /// Runs, of which medians are printed
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub runs: u32,
    /// Grid cells per side of the example simulation
    #[arg(long, default_value_t = 96, value_name = "N")]
    pub cells: usize,
    /// Threads of the example simulation [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// What every step must keep and what is best
    #[arg(long, value_name = "CONTRACT", default_value_t)]
    pub contract: Contract,
    /// Processor time of the nodes together, as of `live`
    #[arg(long, value_name = "CORES", allow_negative_numbers = true)]
    pub cpu_share: Option<CpuLimit>,
}

#[derive(Args)]
pub struct Accuracy {
    #[command(flatten)]
    pub input: Input,
    /// Folder for accuracy.csv, report.html and accuracy.svg
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Rays per side of the base setting, around which everything is turned
    #[arg(long, default_value_t = 256, value_name = "R")]
    pub resolution: u32,
    /// Interrupt parameter of the base setting
    #[arg(long, default_value_t = 0.02, value_name = "G", allow_negative_numbers = true)]
    pub gamma: f64,
    /// Side of the pictures that are timed and sampled, pixels
    #[arg(long, default_value_t = 512, value_name = "PX")]
    pub size: u32,
    /// The quality whose cheapest settings are named
    #[arg(long, default_value_t = 40.0, value_name = "DB", allow_negative_numbers = true)]
    pub psnr: f64,
    /// Measure tricubic interpolation (Catmull-Rom) too
    #[arg(long)]
    pub tricubic: bool,
}

#[derive(Args)]
pub struct Rd {
    #[command(flatten)]
    pub input: Input,
    /// Folder for rd.csv, bd.csv and rd.svg
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Codings made elsewhere, to be measured beside: a table `coding,how,bytes,psnr_db,volume`, as tests/bench/beside.py writes
    #[arg(long, value_name = "TABLE.csv")]
    pub beside: Option<PathBuf>,
}
