//! The tuner's configuration file.

use crate::search::Grid;
use crate::utility::Utility;
use lamina_model::{GenerationParams, Invalid};
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;

/// All keys of the configuration; every one has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where the tuner's status can be asked for.
    pub listen: SocketAddr,
    /// The generator-node; the viz-nodes that measure quality are those that subscribe to it.
    pub generator: String,
    /// What the user wants.
    pub utility: Utility,
    /// Parameters tried.
    pub grid: Grid,
    /// Opacity cut-off of every candidate; 1 is off.
    pub opacity_cutoff: f64,
    /// Sampling step of every candidate, voxels.
    pub step_voxels: f64,
    /// Tune again every n-th step; 0: only when a limit is broken.
    pub retune_every: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 7103)),
            generator: "http://127.0.0.1:7101".to_owned(),
            utility: Utility::Size { limit_bytes: 300_000 },
            grid: Grid::default(),
            opacity_cutoff: 1.0,
            step_voxels: GenerationParams::DEFAULT_STEP_VOXELS,
            retune_every: 20,
        }
    }
}

impl Config {
    /// All parameters to try.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn candidates(&self) -> Result<Vec<GenerationParams>, Invalid> {
        self.utility.check()?;
        let base = GenerationParams::new(1, 0.0)?
            .with_opacity_cutoff(self.opacity_cutoff)?
            .with_step_voxels(self.step_voxels)?;
        self.grid.candidates(&base)
    }
}
