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
    /// gamma in premultiplied color and opacity over one unit length.
    #[default]
    Fitted,
    /// The paper's: front to back, each sample joins the open one or, where it differs by gamma or more, opens the next.
    Greedy,
}

named!(Segmentation, "segmentation", "neither fitted nor greedy", Fitted "fitted", Greedy "greedy");

/// Generation parameters. The paper's P_M.
///
/// Both kinds are spanned by two numbers, a resolution and a tolerance, on which the tuner's grids and models stand:
/// [`Self::resolution`] and [`Self::gamma`].
#[doc(alias = "P_M")]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ParamsFields", into = "ParamsFields")]
pub enum GenerationParams {
    /// Those of a Volumetric Depth Image.
    Vdi(VdiParams),
    /// Those of a reduced volume.
    Volume(VolumeParams),
}

/// Parameters of a Volumetric Depth Image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VdiParams {
    resolution: u32,
    gamma: f64,
    opacity_cutoff: f64,
    step_voxels: f64,
}

/// Parameters of a reduced volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumeParams {
    longest_side: u32,
    error_bound: f64,
}

/// Generation parameters as written in files.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParamsFields {
    /// What a step is turned into.
    #[serde(default)]
    representation: Representation,
    /// Rays per side; of a reduced volume, the most sample points on a side.
    #[serde(default = "rays")]
    resolution: u32,
    /// Interrupt parameter; of a reduced volume, the greatest error of a value, 1 being the transfer function's range.
    #[serde(default = "gamma")]
    gamma: f64,
    /// Opacity at which a ray ends; 1 never. Not of volumes.
    #[serde(default = "one")]
    opacity_cutoff: f64,
    /// Sampling step in voxels. Not of volumes.
    #[serde(default = "half")]
    step_voxels: f64,
}

fn rays() -> u32 {
    VdiParams::default().resolution
}
fn gamma() -> f64 {
    VdiParams::default().gamma
}
fn one() -> f64 {
    1.0
}
fn half() -> f64 {
    VdiParams::DEFAULT_STEP_VOXELS
}

impl TryFrom<ParamsFields> for GenerationParams {
    type Error = Invalid;
    fn try_from(f: ParamsFields) -> Result<Self, Invalid> {
        match f.representation {
            Representation::Vdi => {
                let params = VdiParams::new(f.resolution, f.gamma)?.with_opacity_cutoff(f.opacity_cutoff)?;
                Ok(Self::Vdi(params.with_step_voxels(f.step_voxels)?))
            }
            Representation::Volume => Self::volume(f.resolution, f.gamma),
        }
    }
}

impl From<GenerationParams> for ParamsFields {
    fn from(p: GenerationParams) -> Self {
        let (opacity_cutoff, step_voxels) = match p {
            GenerationParams::Vdi(vdi) => (vdi.opacity_cutoff, vdi.step_voxels),
            GenerationParams::Volume(_) => (one(), half()),
        };
        Self {
            representation: p.representation(),
            resolution: p.resolution(),
            gamma: p.gamma(),
            opacity_cutoff,
            step_voxels,
        }
    }
}

impl Default for VdiParams {
    /// What is in use before anything is known of the data: 256 x 256 rays, gamma 0.02.
    fn default() -> Self {
        Self { resolution: 256, gamma: 0.02, opacity_cutoff: 1.0, step_voxels: Self::DEFAULT_STEP_VOXELS }
    }
}

impl Default for GenerationParams {
    /// VDIs with [`VdiParams::default`].
    fn default() -> Self {
        Self::Vdi(VdiParams::default())
    }
}

impl From<VdiParams> for GenerationParams {
    fn from(params: VdiParams) -> Self {
        Self::Vdi(params)
    }
}

impl From<VolumeParams> for GenerationParams {
    fn from(params: VolumeParams) -> Self {
        Self::Volume(params)
    }
}

/// Parameters as something to look up by.
pub type ParamsKey = (Representation, [u64; 4]);

fn checked_resolution(name: &'static str, resolution: u32) -> Result<u32, Invalid> {
    let most = VdiParams::MAX_RESOLUTION;
    if !(1..=most).contains(&resolution) {
        return Err(Invalid::new(name, format!("{resolution} must lie in 1..={most}")));
    }
    Ok(resolution)
}

fn checked_tolerance(name: &'static str, tolerance: f64) -> Result<f64, Invalid> {
    if !(tolerance.is_finite() && tolerance >= 0.0) {
        return Err(Invalid::new(name, format!("{tolerance} must be a finite number, 0 or more")));
    }
    Ok(tolerance)
}

impl VdiParams {
    /// The most rays per side; of a reduced volume, the most sample points on a side.
    pub const MAX_RESOLUTION: u32 = 8192;
    /// Sampling step where none is stated: two samples per voxel.
    pub const DEFAULT_STEP_VOXELS: f64 = 0.5;

    /// `resolution` x `resolution` rays; what `gamma` means is the [`Segmentation`]'s matter, but at 0 every sample stands for
    /// itself. No opacity cut-off, half-voxel steps.
    ///
    /// # Errors
    /// If the resolution is outside 1..=8192 or gamma is negative or not finite.
    pub fn new(resolution: u32, gamma: f64) -> Result<Self, Invalid> {
        let resolution = checked_resolution("resolution", resolution)?;
        Ok(Self { resolution, gamma: checked_tolerance("gamma", gamma)?, ..Self::default() })
    }

    /// The same with another resolution.
    ///
    /// # Errors
    /// If it is outside 1..=8192.
    pub fn with_resolution(self, resolution: u32) -> Result<Self, Invalid> {
        Ok(Self { resolution: checked_resolution("resolution", resolution)?, ..self })
    }

    /// The same with another interrupt parameter.
    ///
    /// # Errors
    /// If it is negative or not finite.
    pub fn with_gamma(self, gamma: f64) -> Result<Self, Invalid> {
        Ok(Self { gamma: checked_tolerance("gamma", gamma)?, ..self })
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

    /// Rays per side, r.
    #[doc(alias = "r")]
    #[inline]
    pub fn resolution(&self) -> u32 {
        self.resolution
    }
    /// Interrupt parameter: largest difference, per channel of the premultiplied RGBA of one unit length, 0..1.
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

impl VolumeParams {
    /// At most `longest_side` sample points on a side, and values off by at most `error_bound`, 1 being the transfer function's
    /// range.
    ///
    /// # Errors
    /// If the side is outside 1..=8192 or the bound is negative or not finite.
    pub fn new(longest_side: u32, error_bound: f64) -> Result<Self, Invalid> {
        let longest_side = checked_resolution("longest_side", longest_side)?;
        Ok(Self { longest_side, error_bound: checked_tolerance("error_bound", error_bound)? })
    }

    /// The most sample points on a side.
    pub fn longest_side(&self) -> u32 {
        self.longest_side
    }
    /// The greatest error of a value, 1 being the transfer function's range.
    pub fn error_bound(&self) -> f64 {
        self.error_bound
    }
}

impl GenerationParams {
    /// A VDI: [`VdiParams::new`].
    ///
    /// # Errors
    /// As there.
    pub fn vdi(resolution: u32, gamma: f64) -> Result<Self, Invalid> {
        VdiParams::new(resolution, gamma).map(Self::Vdi)
    }

    /// A reduced volume: [`VolumeParams::new`].
    ///
    /// # Errors
    /// As there.
    pub fn volume(longest_side: u32, error_bound: f64) -> Result<Self, Invalid> {
        VolumeParams::new(longest_side, error_bound).map(Self::Volume)
    }

    /// What tells these parameters from all others.
    pub fn key(&self) -> ParamsKey {
        let ParamsFields { representation, resolution, gamma, opacity_cutoff, step_voxels } = (*self).into();
        let [gamma, cutoff, step] = [gamma, opacity_cutoff, step_voxels].map(f64::to_bits);
        (representation, [u64::from(resolution), gamma, cutoff, step])
    }

    /// The same with another resolution: rays per side, or sample points on the longest side.
    ///
    /// # Errors
    /// If it is outside 1..=8192.
    pub fn with_resolution(self, resolution: u32) -> Result<Self, Invalid> {
        match self {
            Self::Vdi(vdi) => vdi.with_resolution(resolution).map(Self::Vdi),
            Self::Volume(volume) => Self::volume(resolution, volume.error_bound),
        }
    }

    /// The same with another tolerance: interrupt parameter, or error bound.
    ///
    /// # Errors
    /// If it is negative or not finite.
    pub fn with_gamma(self, gamma: f64) -> Result<Self, Invalid> {
        match self {
            Self::Vdi(vdi) => vdi.with_gamma(gamma).map(Self::Vdi),
            Self::Volume(volume) => Self::volume(volume.longest_side, gamma),
        }
    }

    /// What a step is turned into.
    pub fn representation(&self) -> Representation {
        match self {
            Self::Vdi(_) => Representation::Vdi,
            Self::Volume(_) => Representation::Volume,
        }
    }
    /// Rays per side, r; of a reduced volume, the most sample points on a side.
    #[doc(alias = "r")]
    pub fn resolution(&self) -> u32 {
        match self {
            Self::Vdi(vdi) => vdi.resolution,
            Self::Volume(volume) => volume.longest_side,
        }
    }
    /// Interrupt parameter; of a reduced volume, the error bound.
    pub fn gamma(&self) -> f64 {
        match self {
            Self::Vdi(vdi) => vdi.gamma,
            Self::Volume(volume) => volume.error_bound,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_parameters_are_refused_by_name() {
        assert_eq!(VdiParams::new(0, 0.1).unwrap_err().thing, "resolution");
        assert_eq!(VdiParams::new(1 << 20, 0.1).unwrap_err().thing, "resolution");
        assert_eq!(VdiParams::new(64, -0.1).unwrap_err().thing, "gamma");
        assert_eq!(VdiParams::new(64, f64::NAN).unwrap_err().thing, "gamma");
        let p = VdiParams::new(64, 0.0).unwrap();
        assert_eq!(p.with_opacity_cutoff(0.0).unwrap_err().thing, "opacity_cutoff");
        assert_eq!(p.with_step_voxels(f64::NAN).unwrap_err().thing, "step_voxels");
        assert_eq!(GenerationParams::volume(0, 0.1).unwrap_err().thing, "longest_side");
        assert_eq!(GenerationParams::volume(64, f64::INFINITY).unwrap_err().thing, "error_bound");
    }

    #[test]
    fn files_written_before_the_kinds_were_apart_still_read() {
        let read = |text: &str| serde_json::from_str::<GenerationParams>(text);
        let all = r#"{"representation":"volume","resolution":96,"gamma":0.01,"opacity_cutoff":1.0,"step_voxels":0.5}"#;
        assert_eq!(read(all).unwrap(), GenerationParams::volume(96, 0.01).unwrap());
        assert_eq!(read(r#"{"resolution":64}"#).unwrap(), GenerationParams::vdi(64, 0.02).unwrap());
        assert!(read(r#"{"gamma":-1.0}"#).is_err());
    }
}
