//! Color channel: the second field of a scene whose colors come from one, mapped once per field for all kernels.

use super::interpolate::trilinear;
use super::stored::units;
use glam::DVec3;
use lamina_model::Voxels;
use lamina_model::effects::{ColorField, ColorPoint};

/// A field that gives colors, and its color map.
#[derive(Debug)]
pub struct ColorChannel {
    dims: [usize; 3],
    /// Positions in the map's range, per sample point, x fastest; NaN where the field is not finite.
    pub units: Vec<f32>,
    map: ColorField,
}

impl ColorChannel {
    /// The channel of `voxels`, `dims` per axis, under `map`.
    pub fn new(dims: [usize; 3], voxels: Voxels, map: &ColorField) -> Self {
        Self { dims, units: units(voxels, &map.range), map: map.clone() }
    }

    /// The control points of the map.
    pub fn points(&self) -> &[ColorPoint] {
        &self.map.points
    }

    /// The color at `index` (units of sample points); `None` in a cell with a point that is not finite.
    pub fn at(&self, index: DVec3) -> Option<[f64; 3]> {
        let u = trilinear(self.dims, &self.units, index);
        (!u.is_nan()).then(|| self.map.at(u))
    }
}
