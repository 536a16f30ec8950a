//! The command line of `lamina`, and the options that its commands share with those of `lamina-lab`.

#![allow(missing_docs, reason = "the help of options is their documentation")]

mod live;
mod offline;

pub use live::{Live, NodeOptions, Replay, Serve, StepsPerSecond, Term, Watch};
pub use offline::{
    CodecArgument, Compare, ErrorArgument, Export, Generate, LayoutArgument, Raycast, Render, Tune, View,
};

use crate::dims::Dims;
use clap::{Args, Parser, Subcommand};
use lamina_compute::gpu::Choice;
use lamina_model::VoxelType;
use lamina_rpc::credentials::Role;
use lamina_volume_io::AxisOrder;
use std::ffi::OsString;
use std::path::PathBuf;
use std::str::FromStr;

/// Watch a running simulation at a price you name.
///
/// Without a command: `live`.
#[derive(Debug, Parser)]
#[command(name = "lamina", version)]
pub struct Cli {
    /// The command; `None` is `live` with its defaults.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// The commands of `lamina`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the example simulation (a blast into clumps) and watch it
    Live(Live),
    /// Replay recorded data as if it were being simulated, and watch it
    Replay(Replay),
    /// Wait for simulations, and watch them
    Serve(Serve),
    /// Follow files and streams that others write, by the Python package: deploy/python/README.md
    Watch(Follow),
    /// Ray-cast a volume to a picture
    Raycast(Raycast),
    /// Make the Volumetric Depth Image of a volume, or a reduced volume
    Generate(Generate),
    /// Render a Volumetric Depth Image, or a reduced volume, from another angle
    Render(Render),
    /// Write what was recorded for other tools: VTK image data, a Cinema database
    Export(Export),
    /// Compare two pictures; the last line is `psnr_db <number>`
    Compare(Compare),
    /// Find the best parameters of a volume under a contract
    Tune(Tune),
    /// Make the keys with which nodes and simulations know each other
    Keys(Keys),
    /// Say what this machine offers, or what is amiss between it and the nodes of a cluster
    Doctor(Doctor),
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

/// Credentials: a folder for each role, signed by a private authority that the first call makes. A later call makes new
/// certificates, which running nodes take up.
#[derive(Debug, Args)]
pub struct Keys {
    /// Folder for all of them
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Only this role's: simulation, generator, viewer, tuner or admin
    #[arg(long, value_name = "ROLE")]
    pub role: Option<Role>,
    /// Days until the certificates expire
    #[arg(long, default_value_t = 365, value_name = "N")]
    pub days: u32,
    /// A name or address by which browsers reach the page, besides this host's; may be given again
    #[arg(long, value_name = "HOST")]
    pub host: Vec<String>,
}

/// Options of `lamina doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// Nodes to reach from here, such as generator=https://node-17:7101,viewer=https://head:7102
    #[arg(long, value_name = "ROLE=URL,..", value_delimiter = ',')]
    pub cluster: Vec<ClusterNode>,
    /// Folder of keys to show them; default: where LAMINA_CREDENTIALS says
    #[arg(long, value_name = "DIR", requires = "cluster")]
    pub credentials: Option<PathBuf>,
}

/// A node, and what it is to be.
#[derive(Debug, Clone)]
pub struct ClusterNode {
    pub role: Role,
    pub address: String,
}

impl FromStr for ClusterNode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (role, address) = text.split_once('=').ok_or("write ROLE=URL, such as generator=http://node-17:7101")?;
        Ok(Self { role: role.parse().map_err(|e| format!("{e}"))?, address: address.to_owned() })
    }
}

/// What the Python package is given.
#[derive(Debug, Args)]
pub struct Follow {
    /// SOURCE and options; `lamina watch SOURCE --help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true, value_name = "SOURCE")]
    pub arguments: Vec<OsString>,
}

/// Properties of a raw file that the file itself does not state.
#[derive(Debug, Args)]
pub struct Raw {
    /// Voxels per side of a raw file, x fastest
    #[arg(long, value_name = "NXxNYxNZ")]
    pub dims: Option<Dims>,
    /// Voxel type of a raw file: uint8, uint16, int16, float32, float64
    #[arg(long, value_name = "TYPE")]
    pub dtype: Option<VoxelType>,
    /// Array to read, where a file has several, or an expression over them, such as "magnitude(v)"
    #[arg(long, value_name = "NAME")]
    pub field: Option<String>,
    /// Value that stands where a voxel is missing, such as -9999; NaN is missing in any case
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    pub missing: Option<f64>,
    /// Order of the axes of arrays that do not name them (HDF5, Zarr), the slowest first
    #[arg(long, value_name = "ORDER", default_value = "zyx")]
    pub axes: AxisOrder,
    /// Of an adaptive mesh (AMReX): the level whose cells are shown, instead of the finest
    #[arg(long, value_name = "N")]
    pub level: Option<usize>,
}

/// One volume of a file, the scene it is shown under, and the backend that casts its rays.
#[derive(Debug, Args)]
pub struct Input {
    /// .pvd, .vti, .nhdr, .nrrd, .raw, .raw.gz, .h5, .vtkhdf, .nc, .zarr, .tif, a plotfile, or a pattern or folder of them
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
