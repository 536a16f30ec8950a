//! Ray setup: what all rays of one picture share.
//!
//! Rays are O + t D with D = base + x `across` + y `down`, linear in the picture's pixels and not of unit length. They are held
//! twice: in world coordinates, for the box, and in homogeneous image positions (U, V, Z) of the generation camera, where U / Z
//! and V / Z are column and row from the occupied rectangle's corner and Z is depth along the view.

use super::acceleration_grid::AccelerationGrid;
use super::clip::{ClipPlanes, Plane};
use crate::reconstruction::REACH;
use glam::DVec3;
use lamina_model::{Camera, Vdi, VdiHeader};

/// Enlargement of the occupied rectangle, in pixels, to allow for rounding.
const HAIR: f64 = 1e-9;

/// Resolution of single precision, relative to the steps through the whole box.
const THIN: f64 = 1e-6;

/// All rays of a picture in one coordinate system.
pub(super) struct CameraRays {
    /// Where all rays start.
    pub origin: DVec3,
    /// Direction through picture position (0, 0).
    pub base: DVec3,
    /// Its change per pixel to the right.
    pub across: DVec3,
    /// Its change per pixel down.
    pub down: DVec3,
}

impl CameraRays {
    fn new(camera: &Camera, width: u32, height: u32, of_point: DVec3, map: impl Fn(DVec3) -> DVec3) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let corner = |x: f64, y: f64| map(camera.direction(x, y, width, height));
        let base = corner(0.0, 0.0);
        // Interpolate from edge to edge, so that the last pixel is as exact as the first.
        Self { origin: of_point, base, across: (corner(w, 0.0) - base) / w, down: (corner(0.0, h) - base) / h }
    }

    /// Direction through picture position (`x`, `y`).
    #[inline(always)]
    pub(super) fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.base + x * self.across + y * self.down
    }

    /// The half space where the linear `functional` of a point is at least `least`.
    fn plane(&self, functional: DVec3, least: f64) -> Plane {
        let b = [self.base, self.across, self.down].map(|d| d.dot(functional));
        Plane { a: self.origin.dot(functional) - least, b }
    }
}

/// What all rays of one picture share.
pub(super) struct RaySetup<'a> {
    /// The VDI.
    pub vdi: &'a Vdi,
    /// Its acceleration grid.
    pub grid: &'a AccelerationGrid,
    /// Rays in world coordinates.
    pub world: CameraRays,
    /// Rays in homogeneous image positions.
    pub image: CameraRays,
    /// Planes of the visible region: the box, the occupied rectangle, and the range of stored depths.
    pub clip: ClipPlanes,
    /// Number of steps that single precision resolves everywhere.
    pub thin: f32,
    /// Weight of the difference in cubic pictures; `None` for nearest rays.
    pub sharpness: Option<f32>,
}

impl<'a> RaySetup<'a> {
    /// The setup for a picture of `vdi` from `camera`, with nearest rays or the `sharpness` of a cubic one.
    pub(super) fn new(
        vdi: &'a Vdi,
        grid: &'a AccelerationGrid,
        camera: &Camera,
        [width, height]: [u32; 2],
        sharpness: Option<f32>,
    ) -> Self {
        let map = |direction| homogeneous(vdi.header(), grid, direction);
        let image =
            CameraRays::new(camera, width, height, map(camera.position() - vdi.header().camera.position()), map);
        let world = CameraRays::new(camera, width, height, camera.position(), |direction| direction);
        let bounds = &vdi.header().bounds;
        let mut clip = ClipPlanes::default();
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            clip.push(world.plane(axis, bounds.min.dot(axis)));
            clip.push(world.plane(-axis, -bounds.max.dot(axis)));
        }
        let margin = HAIR + margin(sharpness);
        let [w, h] = grid.size.map(|n| f64::from(n) + margin);
        for side in [[1.0, 0.0, margin], [-1.0, 0.0, w], [0.0, 1.0, margin], [0.0, -1.0, h]] {
            clip.push(image.plane(side.into(), 0.0));
        }
        clip.push(image.plane(DVec3::Z, grid.depths[0]));
        clip.push(image.plane(-DVec3::Z, -grid.depths[1]));
        let thin = (THIN * bounds.size().length() / vdi.header().step_length) as f32;
        Self { vdi, grid, world, image, clip, thin, sharpness }
    }

    /// Columns and rows of the best packet shape at picture position (`x`, `y`). Rays in one plane with the generation camera are
    /// the same line in its image and differ in depth only, so they are best drawn together.
    pub(super) fn packet(&self, x: f64, y: f64) -> [usize; 2] {
        let line = self.image.origin.cross(self.image.direction(x, y));
        // Distance of the next ray from that line.
        let [right, down] = [self.image.across, self.image.down].map(|step| line.dot(step).abs());
        if right < 0.5 * down {
            [8, 1]
        } else if down < 0.5 * right {
            [1, 8]
        } else {
            [4, 2]
        }
    }
}

/// By how far displaced lines may reach into the occupied rectangle from outside, pixels.
pub(crate) fn margin(sharpness: Option<f32>) -> f64 {
    if sharpness.is_some() { REACH } else { 0.0 }
}

/// A world direction from the generation camera as (U, V, Z).
pub(crate) fn homogeneous(header: &VdiHeader, grid: &AccelerationGrid, direction: DVec3) -> DVec3 {
    let h = header.camera.tan_half_fov();
    let per_tan = 0.5 * f64::from(header.params.resolution()) / h;
    let p = header.camera.view_from_world_direction(direction);
    let [i, j] = grid.corner.map(f64::from);
    DVec3::new((p.x + h * p.z) * per_tan - i * p.z, (h * p.z - p.y) * per_tan - j * p.z, p.z)
}
