//! The command line of `lamina-lab`.

use clap::{Args, Parser, Subcommand};
use lamina::cli::{Input, Raw, StepsPerSecond};
use lamina_compute::CpuLimit;
use lamina_compute::gpu::Choice;
use lamina_model::Segmentation;
use lamina_tuner::Contract;
use lamina_tuner::search::SearchGrid;
use lamina_tuner::units::{Bytes, Millis};
use std::path::PathBuf;

/// Measure Lamina on your data and this machine: parameters, codings, accuracy, speed.
#[derive(Parser)]
#[command(name = "lamina-lab", version)]
pub(crate) struct LabCli {
    #[command(subcommand)]
    pub command: LabCommand,
}

/// The commands of `lamina-lab`.
#[derive(Subcommand)]
pub(crate) enum LabCommand {
    /// Measure every (gamma, resolution) of a grid, as in the paper, and report what is best under which limit
    Study(StudyArguments),
    /// Measure decibels against bytes of every representation and coding for a volume
    Rd(Rd),
    /// Measure what coding each reduced volume of a series after the one before saves
    Consecutive(Consecutive),
    /// Measure what each step of accuracy costs for a volume: error, time and bytes
    Accuracy(Accuracy),
    /// Measure what this machine takes for a volume or a .vdi: times, or memory
    Bench(BenchArguments),
    /// Run a simulation alone, then with the nodes beside it: picks, slowdown, processor time, pictures
    BenchLive(BenchLive),
}

/// Options of `lamina-lab study`.
#[derive(Args)]
pub(crate) struct StudyArguments {
    /// What `lamina replay` takes; one or more
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
    pub grid: SearchGrid,
    /// How samples become the supersegments of a VDI: greedy (and bzip2) as in the paper, or fitted (and
    /// context-mixing) as nodes send them
    #[arg(long, value_name = "NAME", default_value_t = Segmentation::Greedy)]
    pub segmentation: Segmentation,
    /// Compare every pixel of views of 256 x 256, for structural similarity too, instead of one pixel in 64 of 768 x 768
    #[arg(long)]
    pub ssim: bool,
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

/// Options of `lamina-lab consecutive`.
#[derive(Args)]
pub(crate) struct Consecutive {
    #[command(flatten)]
    pub input: Input,
    /// Steps after the first, which --time-step names
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: u32,
    /// Sample points of the longest side
    #[arg(long, default_value_t = 1024, value_name = "R")]
    pub resolution: u32,
    /// Error bounds, shares of the range shown
    #[arg(long, default_value = "0.03,0.01,0.003,0.001", value_delimiter = ',', value_name = "G,..")]
    pub gammas: Vec<f64>,
}

/// Options of `lamina-lab bench`.
#[derive(Args)]
pub(crate) struct BenchArguments {
    #[command(flatten)]
    pub input: Input,
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
    /// A GPU beside the processor, instead: times of both, and how near their results are. Pictures are 16:9, the first size
    /// their height
    #[arg(long, conflicts_with_all = ["memory", "json", "gammas", "effects"])]
    pub devices: bool,
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
}

/// Options of `lamina-lab bench-live`.
#[derive(Args)]
pub(crate) struct BenchLive {
    /// Also with N threads beside it that compute without end
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub busy: u16,
    /// A recorded series instead of the example simulation
    #[arg(long, value_name = "SERIES")]
    pub replay: Option<PathBuf>,
    /// Steps a second; 0: as fast as it can
    #[arg(long, default_value = "2", value_name = "STEPS/S", allow_negative_numbers = true)]
    pub pace: StepsPerSecond,
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
    /// Processor time of the nodes together, as of `lamina live`
    #[arg(long, value_name = "CORES", allow_negative_numbers = true)]
    pub cpu_share: Option<CpuLimit>,
}

/// Options of `lamina-lab accuracy`.
#[derive(Args)]
pub(crate) struct Accuracy {
    #[command(flatten)]
    pub input: Input,
    /// Folder for accuracy.csv, report.html and accuracy.svg
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Rays per side of the base setting, around which each parameter is varied
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

/// Options of `lamina-lab rd`.
#[derive(Args)]
pub(crate) struct Rd {
    #[command(flatten)]
    pub input: Input,
    /// Folder for rd.csv, bd.csv and rd.svg
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Measure reduced volumes alone, not VDIs
    #[arg(long)]
    pub volumes_only: bool,
    /// Encodings that other programs made, to compare with: a table `coding,how,bytes,psnr_db,encode_ms,volume`, as tests/bench/peers.py writes
    #[arg(long, value_name = "TABLE.csv")]
    pub peers: Option<PathBuf>,
}
