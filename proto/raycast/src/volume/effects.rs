//! Effects of a scene in kernel units: positions in sample points, values as positions in the transfer function's range.

use super::color_channel::ColorChannel;
use super::light_volume::LightVolume;
use glam::DVec3;
use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::effects::{DepthCue, Shading};
use lamina_model::{Grid, Scene};
use std::sync::Arc;

/// Gradient magnitude, in ranges per voxel, at which half of the shading applies; less below it.
pub(crate) const WEAK_GRADIENT: f64 = 0.01;
/// Clipped steps shorter than this share of a step are skipped.
pub(crate) const SHORTEST: f64 = 1e-4;
/// Steps whose ends differ by fewer table rows than this are sampled in the middle: differences of sums would lose digits.
pub(crate) const FEWEST_ROWS: f64 = 4.0;

/// The effects of a field.
#[derive(Debug)]
pub struct FieldEffects {
    /// Unit vector towards the light.
    pub light: DVec3,
    /// Shading by the gradient.
    pub shading: Option<Shading>,
    /// Darkness of full shadow, 0 to 1.
    pub shadows: f64,
    /// Darkness of full occlusion, 0 to 1.
    pub ambient_occlusion: f64,
    /// Transmittance and openness of each point, if either of the above is positive; of a part of a field they come with its light.
    pub volume: Option<Arc<LightVolume>>,
    /// Isosurfaces by rising value.
    pub surfaces: Vec<Surface>,
    /// Clip half spaces: points with `normal` . index <= `offset` for all of them are kept.
    pub half_spaces: Vec<(DVec3, f64)>,
    /// Whether the transfer function is integrated over each step.
    pub pre_integrated: bool,
    /// Fading of colors with distance.
    pub cue: Option<DepthCue>,
    /// Field that gives the medium's colors in place of the transfer function.
    pub colors: Option<Arc<ColorChannel>>,
}

/// An isosurface.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Value, as a position in the range.
    pub at: f64,
    /// Straight color.
    pub color: [f64; 3],
    /// Optical depth of one crossing; may be infinite.
    pub optical_depth: f64,
}

impl FieldEffects {
    /// The effects of `scene` on `grid`, with color field `colors`, and no light volume yet; `None` if it has none.
    pub fn new(scene: &Scene, grid: &Grid, colors: Option<Arc<ColorChannel>>) -> Option<Self> {
        let asked = &scene.effects;
        if asked.is_none() {
            return None;
        }
        let light = asked.light.map_or(DVec3::Z, unit);
        let (shadows, ambient_occlusion) = (asked.shadows.unwrap_or(0.0), asked.ambient_occlusion.unwrap_or(0.0));
        let surface = |s: &lamina_model::effects::Isosurface| Surface {
            at: f64::from(scene.transfer.range().unit_from_value(s.value)),
            color: s.color,
            optical_depth: optical_depth_from_opacity(s.opacity),
        };
        let mut surfaces: Vec<Surface> = asked.isosurfaces.iter().map(surface).collect();
        surfaces.retain(|s| s.optical_depth > 0.0);
        surfaces.sort_by(|a, b| a.at.total_cmp(&b.at));
        let half_space = |p: lamina_model::effects::ClipPlane| {
            let normal = p.normal * grid.spacing();
            let scale = normal.abs().max_element();
            (normal / scale, (p.offset - p.normal.dot(grid.origin())) / scale)
        };
        let half_spaces: Vec<(DVec3, f64)> = asked.half_spaces().into_iter().map(half_space).collect();
        Some(Self {
            light,
            shading: asked.shading,
            shadows,
            ambient_occlusion,
            volume: None,
            surfaces,
            half_spaces,
            pre_integrated: asked.pre_integrated,
            cue: asked.depth_cue,
            colors,
        })
    }

    /// The light volume of the field on `grid` with this `extinction` on its points.
    pub(super) fn light_volume(&self, grid: &Grid, extinction: Vec<f32>) -> Arc<LightVolume> {
        let toward = (self.shadows > 0.0).then_some(self.light);
        Arc::new(LightVolume::new(grid, toward, self.ambient_occlusion > 0.0, extinction))
    }

    /// Whether clipping leaves the place at an index.
    pub(super) fn keeps(&self, index: DVec3) -> bool {
        self.half_spaces.iter().all(|(normal, offset)| normal.dot(index) <= *offset)
    }

    /// True if kernels need the scalars at the ends of steps.
    pub fn needs_ends(&self) -> bool {
        self.pre_integrated || !self.surfaces.is_empty()
    }

    /// Clips the ray `start` + t `direction` (in sample points), t in `from`..`to`, by all half spaces.
    pub fn clip(&self, start: DVec3, direction: DVec3, from: f64, to: f64) -> (f64, f64) {
        let (mut from, mut to) = (from, to);
        for (normal, offset) in &self.half_spaces {
            let (room, speed) = (offset - normal.dot(start), normal.dot(direction));
            if speed > 0.0 {
                to = to.min(room / speed);
            } else if speed < 0.0 {
                from = from.max(room / speed);
            } else if room < 0.0 {
                to = from;
            }
        }
        (from, to.max(from))
    }
}

/// `direction`, of any length, scaled to length 1 without overflow.
fn unit(direction: DVec3) -> DVec3 {
    (direction / direction.abs().max_element()).normalize()
}

/// Distances from `eye` to the nearest point and the farthest corner of the box, world units: the range of the depth cue.
pub(crate) fn cue_range(grid: &Grid, eye: DVec3) -> (f64, f64) {
    let bounds = grid.bounds();
    let near = (eye.clamp(bounds.min, bounds.max) - eye).length();
    let far = bounds.corners().map(|c| (c - eye).length()).into_iter().fold(0.0, f64::max);
    (near, far)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_fade_from_the_eye_on_where_it_is_inside() {
        let grid = Grid::new([3, 5, 5], DVec3::ONE, DVec3::ZERO).unwrap();
        assert_eq!(cue_range(&grid, DVec3::new(1.0, 2.0, 2.0)), (0.0, 3.0), "from the middle all corners are as far");
        assert_eq!(cue_range(&grid, DVec3::new(1.0, 2.0, 10.0)), (6.0, (1.0_f64 + 4.0 + 100.0).sqrt()));
    }
}
