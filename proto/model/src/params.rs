//! What steers generation: the paper's P_M.

use crate::Invalid;
use crate::named;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// What a step is turned into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Representation {
    /// A Volumetric Depth Image: supersegments along rays.
    #[default]
    Vdi,
    /// A reduced volume: fewer sample points, coarser values.
    Volume,
}

impl Representation {
    /// Generation time and encoding time of what took `made` to make and `coded` to turn into bytes. What a volume loses it
    /// loses while it is coded: that is part of making it.
    pub fn times(self, made: Duration, coded: Duration) -> (Duration, Duration) {
        match self {
            Self::Vdi => (made, coded),
            Self::Volume => (made + coded, Duration::ZERO),
        }
    }
}

named!(Representation, "representation", "neither vdi nor volume", Vdi "vdi", Volume "volume");

/// How the samples of a ray become the supersegments of a VDI, and what gamma then means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Segmentation {
    /// Where the ray's error is least for their number. Gamma is the price of one: it is worth as much as being off by 1.75
    /// gamma in premultiplied colour and opacity over one unit length.
    #[default]
    Fitted,
    /// The paper's: front to back, each sample joins the open one or, where it differs by gamma or more, opens the next.
    Greedy,
}

named!(Segmentation, "segmentation", "neither fitted nor greedy", Fitted "fitted", Greedy "greedy");

/// Generation parameters. The paper's P_M.
#[doc(alias = "P_M")]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ParamsFields", into = "ParamsFields")]
pub struct GenerationParams {
    representation: Representation,
    resolution: u32,
    gamma: f64,
    opacity_cutoff: f64,
    step_voxels: f64,
}

/// Generation parameters as written in files.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParamsFields {
    /// What a step is turned into.
    #[serde(default)]
    pub representation: Representation,
    /// Rays per side; of a reduced volume, the most sample points on a side.
    #[serde(default = "rays")]
    pub resolution: u32,
    /// Interrupt parameter; of a reduced volume, the greatest error of a value, 1 being the transfer function's range.
    #[serde(default = "gamma")]
    pub gamma: f64,
    /// Opacity at which a ray ends; 1 never.
    #[serde(default = "one")]
    pub opacity_cutoff: f64,
    /// Sampling step in voxels.
    #[serde(default = "half")]
    pub step_voxels: f64,
}

fn rays() -> u32 {
    GenerationParams::default().resolution
}
fn gamma() -> f64 {
    GenerationParams::default().gamma
}
fn one() -> f64 {
    1.0
}
fn half() -> f64 {
    GenerationParams::DEFAULT_STEP_VOXELS
}

impl TryFrom<ParamsFields> for GenerationParams {
    type Error = Invalid;
    fn try_from(f: ParamsFields) -> Result<Self, Invalid> {
        let params = Self::new(f.resolution, f.gamma)?.with_opacity_cutoff(f.opacity_cutoff)?;
        Ok(params.with_step_voxels(f.step_voxels)?.with_representation(f.representation))
    }
}

impl From<GenerationParams> for ParamsFields {
    fn from(p: GenerationParams) -> Self {
        let GenerationParams { representation, resolution, gamma, opacity_cutoff, step_voxels } = p;
        Self { representation, resolution, gamma, opacity_cutoff, step_voxels }
    }
}

impl Default for GenerationParams {
    /// What is in use before anything is known of the data: VDIs of 256 x 256 rays, gamma 0.02.
    fn default() -> Self {
        let (representation, step_voxels) = (Representation::Vdi, Self::DEFAULT_STEP_VOXELS);
        Self { representation, resolution: 256, gamma: 0.02, opacity_cutoff: 1.0, step_voxels }
    }
}

/// Parameters as something to look up by.
pub type ParamsKey = (Representation, [u64; 4]);

impl GenerationParams {
    /// The most rays per side.
    pub const MAX_RESOLUTION: u32 = 8192;
    /// Sampling step where none is stated: two samples per voxel.
    pub const DEFAULT_STEP_VOXELS: f64 = 0.5;

    /// A VDI of `resolution` x `resolution` rays; what `gamma` means is the [`Segmentation`]'s
    /// matter, but at 0 every sample stands for itself. No opacity cut-off, half-voxel steps.
    ///
    /// # Errors
    /// If the resolution is outside 1..=8192 or gamma is negative or not finite.
    pub fn new(resolution: u32, gamma: f64) -> Result<Self, Invalid> {
        if !(1..=Self::MAX_RESOLUTION).contains(&resolution) {
            return Err(Invalid::new("resolution", format!("{resolution} must lie in 1..={}", Self::MAX_RESOLUTION)));
        }
        if !(gamma.is_finite() && gamma >= 0.0) {
            return Err(Invalid::new("gamma", format!("{gamma} must be a finite number, 0 or more")));
        }
        Ok(Self { resolution, gamma, ..Self::default() })
    }

    /// What tells these parameters from all others.
    pub fn key(&self) -> ParamsKey {
        let [gamma, cutoff, step] = [self.gamma, self.opacity_cutoff, self.step_voxels].map(f64::to_bits);
        (self.representation, [u64::from(self.resolution), gamma, cutoff, step])
    }

    /// The same with another resolution.
    ///
    /// # Errors
    /// If it is outside 1..=8192.
    pub fn with_resolution(self, resolution: u32) -> Result<Self, Invalid> {
        let Self { resolution, .. } = Self::new(resolution, self.gamma)?;
        Ok(Self { resolution, ..self })
    }

    /// The same with another interrupt parameter.
    ///
    /// # Errors
    /// If it is negative or not finite.
    pub fn with_gamma(self, gamma: f64) -> Result<Self, Invalid> {
        let Self { gamma, .. } = Self::new(self.resolution, gamma)?;
        Ok(Self { gamma, ..self })
    }

    /// The same with rays ending at this accumulated opacity (1: never).
    ///
    /// # Errors
    /// If it is outside (0, 1].
    pub fn with_opacity_cutoff(self, opacity_cutoff: f64) -> Result<Self, Invalid> {
        if !(opacity_cutoff > 0.0 && opacity_cutoff <= 1.0) {
            return Err(Invalid::new("opacity_cutoff", format!("{opacity_cutoff} must lie above 0 and up to 1 (off)")));
        }
        Ok(Self { opacity_cutoff, ..self })
    }

    /// The same with this sampling step, in voxels.
    ///
    /// # Errors
    /// If it is outside 1/64..=64.
    pub fn with_step_voxels(self, step_voxels: f64) -> Result<Self, Invalid> {
        if !(1.0 / 64.0..=64.0).contains(&step_voxels) {
            return Err(Invalid::new("step_voxels", format!("{step_voxels} must lie in 0.015625..=64 voxels")));
        }
        Ok(Self { step_voxels, ..self })
    }

    /// The same for another representation.
    pub fn with_representation(self, representation: Representation) -> Self {
        Self { representation, ..self }
    }

    /// What a step is turned into.
    pub fn representation(&self) -> Representation {
        self.representation
    }
    /// Rays per side, r; of a reduced volume, the most sample points on a side.
    #[doc(alias = "r")]
    #[inline]
    pub fn resolution(&self) -> u32 {
        self.resolution
    }
    /// Interrupt parameter: largest difference, per channel of the premultiplied RGBA of one unit length, 0..1. Of a reduced
    /// volume, the greatest error of a value, 1 being the transfer function's range.
    pub fn gamma(&self) -> f64 {
        self.gamma
    }
    /// Accumulated opacity at which a ray ends; 1 is off.
    pub fn opacity_cutoff(&self) -> f64 {
        self.opacity_cutoff
    }
    /// Sampling step in voxels.
    pub fn step_voxels(&self) -> f64 {
        self.step_voxels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_parameters_are_refused_by_name() {
        assert_eq!(GenerationParams::new(0, 0.1).unwrap_err().thing, "resolution");
        assert_eq!(GenerationParams::new(1 << 20, 0.1).unwrap_err().thing, "resolution");
        assert_eq!(GenerationParams::new(64, -0.1).unwrap_err().thing, "gamma");
        assert_eq!(GenerationParams::new(64, f64::NAN).unwrap_err().thing, "gamma");
        let p = GenerationParams::new(64, 0.0).unwrap();
        assert_eq!(p.with_opacity_cutoff(0.0).unwrap_err().thing, "opacity_cutoff");
        assert_eq!(p.with_step_voxels(f64::NAN).unwrap_err().thing, "step_voxels");
    }
}
