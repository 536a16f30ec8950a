//! The second field of a scene whose colours come from one: made once for a field, looked up by all kernels.

use super::field::{trilinear, units};
use glam::DVec3;
use lamina_model::effects::{ColorField, ColorPoint};
use lamina_model::{Grid, Voxels};

/// Its positions in the range that maps to colours.
#[derive(Debug)]
pub struct Colors {
    dims: [usize; 3],
    /// Of each sample point, x fastest; NaN where the field is not finite.
    pub units: Vec<f32>,
    map: ColorField,
}

impl Colors {
    /// `voxels` on `grid` as `map` asks for.
    pub fn new(grid: &Grid, voxels: Voxels, map: &ColorField) -> Self {
        Self { dims: grid.dims(), units: units(voxels, &map.range), map: map.clone() }
    }

    /// The corners of the map.
    pub fn points(&self) -> &[ColorPoint] {
        &self.map.points
    }

    /// The colour at `index` (units of sample points); `None` next to a point that is not finite.
    pub fn at(&self, index: DVec3) -> Option<[f64; 3]> {
        let u = trilinear(self.dims, &self.units, index);
        (!u.is_nan()).then(|| self.map.at(u))
    }
}
