//! Effects in the units that kernels count in: positions in sample points, values in the transfer function's range.

use super::color_channel::Colors;
use super::light_volume::LightVolume;
use glam::DVec3;
use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::effects::{DepthCue, Shading};
use lamina_model::{Grid, Scene};
use std::sync::Arc;

/// Below this gradient, in shares of the range per voxel, less than half of the shading applies.
pub const WEAK_GRADIENT: f64 = 0.01;
/// A step cut shorter than this share of itself is nothing.
pub const SHORTEST: f64 = 1e-4;
/// Steps whose ends differ by fewer rows of the table than this are taken in the middle: sums there would lose digits.
pub const FEWEST_ROWS: f64 = 4.0;

/// What a scene asks for, ready to be applied.
#[derive(Debug)]
pub struct Effects {
    /// Unit vector towards the light.
    pub light: DVec3,
    /// Shading by the gradient.
    pub shading: Option<Shading>,
    /// How dark full shadow is.
    pub shadows: f64,
    /// How dark a closed-in point is.
    pub ambient_occlusion: f64,
    /// How much light reaches a point; there if either of those is above 0.
    pub volume: Option<LightVolume>,
    /// By rising value.
    pub surfaces: Vec<Surface>,
    /// Kept is where `normal` . index <= `offset` for all.
    pub half_spaces: Vec<(DVec3, f64)>,
    /// The transfer function is integrated over a step.
    pub pre_integrated: bool,
    /// Colours fade with distance.
    pub cue: Option<DepthCue>,
    /// Where the medium's colours come from instead of the transfer function.
    pub colors: Option<Arc<Colors>>,
}

/// An isosurface.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Its value, in the range.
    pub at: f64,
    /// Straight colour.
    pub color: [f64; 3],
    /// Of one crossing; may be infinite.
    pub optical_depth: f64,
}

impl Effects {
    /// The effects of `scene` on `grid`, whose second field is `colors`; `None` if it asks for nothing. `extinction` is the
    /// field's at an index.
    pub fn new(
        scene: &Scene,
        grid: &Grid,
        colors: Option<Arc<Colors>>,
        extinction: impl Fn(DVec3) -> f64 + Sync,
    ) -> Option<Self> {
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
        // What is cut away casts no shadow.
        let left = |p: DVec3| half_spaces.iter().all(|(normal, offset)| normal.dot(p) <= *offset);
        let volume = (shadows > 0.0 || ambient_occlusion > 0.0).then(|| {
            let toward = (shadows > 0.0).then_some(light);
            LightVolume::new(grid, toward, ambient_occlusion > 0.0, |p| if left(p) { extinction(p) } else { 0.0 })
        });
        Some(Self {
            light,
            shading: asked.shading,
            shadows,
            ambient_occlusion,
            volume,
            surfaces,
            half_spaces,
            pre_integrated: asked.pre_integrated,
            cue: asked.depth_cue,
            colors,
        })
    }

    /// True if the scalar at a step's ends matters.
    pub fn needs_ends(&self) -> bool {
        self.pre_integrated || !self.surfaces.is_empty()
    }

    /// The part of a ray `start` + t `direction` (in sample points) that lies in all half spaces, within `from`..`to`.
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

/// A direction of any length at length 1.
fn unit(direction: DVec3) -> DVec3 {
    (direction / direction.abs().max_element()).normalize()
}

/// Distances from `eye` to the nearest point and to the farthest corner of the box, world units: between them colours fade.
pub fn cue_range(grid: &Grid, eye: DVec3) -> (f64, f64) {
    let bounds = grid.bounds();
    let near = (eye.clamp(bounds.min, bounds.max) - eye).length();
    let far = bounds.corners().map(|c| (c - eye).length()).into_iter().fold(0.0, f64::max);
    (near, far)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_fade_from_the_eye_on_where_it_is_inside() {
        let grid = Grid::new([3, 5, 5], DVec3::ONE, DVec3::ZERO).unwrap();
        assert_eq!(cue_range(&grid, DVec3::new(1.0, 2.0, 2.0)), (0.0, 3.0), "from the middle all corners are as far");
        assert_eq!(cue_range(&grid, DVec3::new(1.0, 2.0, 10.0)), (6.0, (1.0_f64 + 4.0 + 100.0).sqrt()));
    }
}
