//! The reduced volume: the representation to choose where the scalars themselves are cheaper to send than what rays see
//! of them; and what may stand for a step, one or the other.

use crate::{Camera, GenerationParams, Grid, Invalid, Representation, Scene, Vdi, VolumeParams};
use std::sync::Arc;

/// A volume of fewer sample points and coarser values under the scene it was made for. Any view can be drawn from it, under any
/// transfer function that shows nothing where the scene's does not. Clones share the values.
#[derive(Debug, Clone, PartialEq)]
pub struct ReducedVolume {
    grid: Grid,
    scene: Scene,
    params: VolumeParams,
    units: Arc<Vec<f32>>,
}

impl ReducedVolume {
    /// Why none can stand for a step, to those who know only that it may have 0 points on a side.
    pub const WHY_NONE: &str = "no reduced volume can stand for this step: colors come from a second field";

    /// Positions in the range of the scene's transfer function, `units`, on `grid`, x fastest; NaN where a point is missing.
    ///
    /// # Errors
    /// If there are not as many as sample points, one is infinite, colors are to come from a second field, or the scene's
    /// opacities refer to no stated length: to what one voxel was, another grid does not tell.
    pub fn new(grid: Grid, scene: Scene, params: VolumeParams, units: Vec<f32>) -> Result<Self, Invalid> {
        if units.len() != grid.voxels() {
            let reason = format!("{} values given, a grid of {:?} needs {}", units.len(), grid.dims(), grid.voxels());
            return Err(Invalid::new("volume", reason));
        }
        if let Some(unit) = units.iter().find(|u| u.is_infinite()) {
            return Err(Invalid::new("volume", format!("a value of {unit}; NaN is a missing point")));
        }
        if scene.transfer.stated_unit_length().is_none() {
            return Err(Invalid::new("transfer.unit_length", "must be stated in a reduced volume"));
        }
        if scene.effects.color_field.is_some() {
            let reason = "a reduced volume holds one field; colors cannot come from a second";
            return Err(Invalid::new("effects.color_field", reason));
        }
        Ok(Self { grid, scene: scene.check()?, params, units: Arc::new(units) })
    }

    /// The same with another error bound.
    ///
    /// # Errors
    /// If it is negative or not finite.
    pub fn with_error_bound(self, error_bound: f64) -> Result<Self, Invalid> {
        Ok(Self { params: VolumeParams::new(self.params.longest_side(), error_bound)?, ..self })
    }

    /// Where its sample points lie: over the same box as those it was made from.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
    /// What it is seen under.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
    /// How it was made.
    pub fn params(&self) -> &VolumeParams {
        &self.params
    }
    /// Positions in the range of the transfer function, x fastest; NaN where a point is missing.
    pub fn units(&self) -> &[f32] {
        &self.units
    }
    /// The same, owned, with the grid and scene.
    pub fn into_parts(self) -> (Grid, Scene, Vec<f32>) {
        (self.grid, self.scene, Arc::unwrap_or_clone(self.units))
    }
}

/// What stands for a step. The paper's M.
#[doc(alias = "M")]
#[derive(Debug, Clone, PartialEq)]
pub enum Intermediate {
    /// Rays.
    Vdi(Box<Vdi>),
    /// Sample points.
    Volume(Box<ReducedVolume>),
}

impl Intermediate {
    /// The camera it was made for.
    pub fn camera(&self) -> &Camera {
        match self {
            Self::Vdi(vdi) => &vdi.header().camera,
            Self::Volume(volume) => &volume.scene().camera,
        }
    }

    /// How it was made.
    pub fn params(&self) -> GenerationParams {
        match self {
            Self::Vdi(vdi) => vdi.header().params.into(),
            Self::Volume(volume) => (*volume.params()).into(),
        }
    }

    /// Which it is.
    pub fn representation(&self) -> Representation {
        match self {
            Self::Vdi(_) => Representation::Vdi,
            Self::Volume(_) => Representation::Volume,
        }
    }

    /// Supersegments, or sample points.
    pub fn elements(&self) -> u64 {
        match self {
            Self::Vdi(vdi) => vdi.segments().len() as u64,
            Self::Volume(volume) => volume.units().len() as u64,
        }
    }
}
