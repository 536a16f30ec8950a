//! What is looked at and how: the paper's S_A.

use crate::{Camera, Effects, Grid, Invalid, TransferFunction, VdiParams};
use serde::{Deserialize, Serialize};

/// Transfer function, generation camera, background, sampling step and effects. The paper's S_A.
#[doc(alias = "S_A")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// From scalars to color and opacity.
    pub transfer: TransferFunction,
    /// Where VDIs are generated from.
    #[doc(alias = "P_A")]
    pub camera: Camera,
    /// Color behind everything, RGB in 0..1.
    #[serde(default)]
    pub background: [f32; 3],
    /// Sampling step in voxels.
    #[serde(default = "half_voxel")]
    pub step_voxels: f64,
    /// What else is to be seen.
    #[serde(default, skip_serializing_if = "Effects::is_none")]
    pub effects: Effects,
}

fn half_voxel() -> f64 {
    VdiParams::DEFAULT_STEP_VOXELS
}

impl Scene {
    /// Passes a scene whose plain numbers are valid too.
    ///
    /// # Errors
    /// If the background, the step or an effect is out of bounds.
    pub fn check(self) -> Result<Self, Invalid> {
        if !self.background.iter().all(|c| (0.0..=1.0).contains(c)) {
            return Err(Invalid::new("background", format!("{:?}: every channel must lie in 0..1", self.background)));
        }
        VdiParams::new(1, 0.0)?.with_step_voxels(self.step_voxels)?;
        self.effects.check(self.transfer.range())?;
        self.effects.check_step(self.step_voxels)?;
        Ok(self)
    }

    /// World length of one sampling step on `grid`.
    pub fn step_length(&self, grid: &Grid) -> f64 {
        self.step_voxels * grid.voxel_length()
    }
}
