//! Options of the commands that work on files, without nodes.

use super::Input;
use clap::{Args, ValueEnum};
use lamina_compute::gpu::Choice;
use lamina_model::{Representation, Segmentation};
use lamina_tuner::Contract;
use lamina_tuner::search::SearchGrid;
use lamina_tuner::units::Bytes;
use std::path::PathBuf;

/// Options of `lamina tune`.
#[derive(Debug, Args)]
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
    pub grid: SearchGrid,
}

/// The view and file of one picture.
#[derive(Debug, Args)]
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

/// Options of `lamina raycast`.
#[derive(Debug, Args)]
pub struct Raycast {
    #[command(flatten)]
    pub input: Input,
    #[command(flatten)]
    pub view: View,
}

/// Options of `lamina generate`.
#[derive(Debug, Args)]
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
    pub layout: LayoutArgument,
    /// What makes a VDI small: context-mixing (of neighboring rays), bzip2, or zstd in a sixth of the time [default:
    /// context-mixing; bzip2 for the plain layout]
    #[arg(long, value_name = "NAME", hide_possible_values = true)]
    pub codec: Option<CodecArgument>,
    /// What --gamma limits of a reduced volume: the error of each value, or the mean square error, as in runs, where it may take
    /// half the bytes
    #[arg(long, value_name = "NAME", default_value = "maximum")]
    pub error: ErrorArgument,
    /// Read the volume in slabs, so that no more memory is taken than this: for raw values, in a .raw or NRRD file, that do not fit
    #[arg(long, value_name = "2GB")]
    pub memory: Option<Bytes>,
    /// Where to write it
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// What an error bound limits.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum ErrorArgument {
    /// The error of each value.
    Maximum,
    /// The mean square error.
    MeanSquare,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum LayoutArgument {
    Columns,
    Plain,
}

#[derive(Debug, Clone, Copy, ValueEnum, PartialEq)]
pub enum CodecArgument {
    ContextMixing,
    Bzip2,
    Zstd,
}

/// Options of `lamina render`.
#[derive(Debug, Args)]
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

/// Options of `lamina export`.
#[derive(Debug, Args)]
pub struct Export {
    /// A recorded step, or the folder of a recorded run
    #[arg(value_name = "STEP|RUN")]
    pub input: PathBuf,
    /// A .vti or .vtkhdf file for a reduced volume, a .pvd for a run of them; a .cdb folder for a Cinema database of pictures; a movie,
    /// .webp (lossless) or .mp4 (by ffmpeg)
    #[arg(long, value_name = "FILE.vti|FILE.vtkhdf|FILE.pvd|DIR.cdb|FILE.webp|FILE.mp4")]
    pub out: PathBuf,
    /// Of a Cinema database: cameras around the data
    #[arg(long, default_value_t = 12, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=360))]
    pub azimuths: u32,
    /// Of a Cinema database: elevations of the cameras, degrees; of a movie, one
    #[arg(long, default_value = "0", value_name = "DEG,..", value_delimiter = ',', allow_hyphen_values = true)]
    pub elevations: Vec<f64>,
    /// Of a movie: by how much the camera turns about the data, degrees; 0 for a run, 360 for a step, unless given
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub turn: Option<f64>,
    /// Of a movie: pictures, over which the steps are spread; of a run one a step, of a step 5 seconds, unless given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub frames: Option<u32>,
    /// Of a movie: pictures a second
    #[arg(long, default_value_t = 25, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub fps: u32,
    /// Pixels per side of a picture
    #[arg(long, default_value_t = 512, value_name = "PIXELS")]
    pub size: u32,
    /// What draws: auto (a GPU if there is a real one), cpu or gpu
    #[arg(long, default_value_t)]
    pub backend: Choice,
}

/// Options of `lamina compare`.
#[derive(Debug, Args)]
pub struct Compare {
    /// A picture: .png or .pfm
    pub a: PathBuf,
    /// Another of the same size
    pub b: PathBuf,
}
