//! What all rays of one picture share.
//!
//! Rays are O + t D with D = base + x `across` + y `down` linear in the picture's pixels and not of unit length. They
//! are held twice: in the world, for the box, and in homogeneous image positions (U, V, Z) of the generation camera,
//! where U / Z and V / Z are the column and row counted from the occupied rectangle's corner and Z is depth along the
//! view.

use super::acceleration_grid::Index;
use super::clip::{Clip, Plane};
use crate::Displacement;
use glam::DVec3;
use lamina_model::{Camera, Vdi, VdiHeader};

/// How far the occupied rectangle is widened, in pixels: what rounding puts beside its rim is still found.
const HAIR: f64 = 1e-9;

/// Relative to the steps through the whole box, what single precision tells apart.
const THIN: f64 = 1e-6;

/// A pencil of rays from one origin, in one frame of reference.
pub struct Pencil {
    /// Where all rays start.
    pub origin: DVec3,
    /// Direction through picture position (0, 0).
    pub base: DVec3,
    /// Its change per pixel to the right.
    pub across: DVec3,
    /// Its change per pixel down.
    pub down: DVec3,
}

impl Pencil {
    fn new(camera: &Camera, width: u32, height: u32, of_point: DVec3, map: impl Fn(DVec3) -> DVec3) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let corner = |x: f64, y: f64| map(camera.direction(x, y, width, height));
        let base = corner(0.0, 0.0);
        // From one rim to the other, so that the last pixel is as exact as the first.
        Self { origin: of_point, base, across: (corner(w, 0.0) - base) / w, down: (corner(0.0, h) - base) / h }
    }

    /// Direction through picture position (`x`, `y`).
    #[inline(always)]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.base + x * self.across + y * self.down
    }

    /// The half space where `functional` of a point is at least `least`.
    fn plane(&self, functional: DVec3, least: f64) -> Plane {
        let b = [self.base, self.across, self.down].map(|d| d.dot(functional));
        Plane { a: self.origin.dot(functional) - least, b }
    }
}

/// See the file's head.
pub struct Frame<'a> {
    /// What is drawn.
    pub vdi: &'a Vdi,
    /// What was prepared of it.
    pub index: &'a Index,
    /// Rays in the world.
    pub world: Pencil,
    /// Rays in homogeneous image positions.
    pub image: Pencil,
    /// Between these planes the VDI may show something: the box, the occupied rectangle, the depths there are.
    pub clip: Clip,
    /// So many steps single precision tells apart everywhere.
    pub thin: f32,
}

impl<'a> Frame<'a> {
    /// A picture of `vdi`, its image displaced `by`, from `camera`.
    pub fn new(vdi: &'a Vdi, index: &'a Index, camera: &Camera, [width, height]: [u32; 2], by: Displacement) -> Self {
        let map = |direction| homogeneous(vdi.header(), index, by, direction);
        let image = Pencil::new(camera, width, height, map(camera.position() - vdi.header().camera.position()), map);
        let world = Pencil::new(camera, width, height, camera.position(), |direction| direction);
        let bounds = &vdi.header().bounds;
        let mut clip = Clip::default();
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            clip.push(world.plane(axis, bounds.min.dot(axis)));
            clip.push(world.plane(-axis, -bounds.max.dot(axis)));
        }
        let [w, h] = index.size.map(|n| f64::from(n) + HAIR);
        for side in [[1.0, 0.0, HAIR], [-1.0, 0.0, w], [0.0, 1.0, HAIR], [0.0, -1.0, h]] {
            clip.push(image.plane(side.into(), 0.0));
        }
        clip.push(image.plane(DVec3::Z, index.depths[0]));
        clip.push(image.plane(-DVec3::Z, -index.depths[1]));
        let thin = (THIN * bounds.size().length() / vdi.header().step_length) as f32;
        Self { vdi, index, world, image, clip, thin }
    }

    /// Columns and rows of the picture whose rays are best drawn together about picture position (`x`, `y`): rays in one
    /// plane with the generation camera are the same line in its image, and differ in depth alone.
    pub fn packet(&self, x: f64, y: f64) -> [usize; 2] {
        let line = self.image.origin.cross(self.image.direction(x, y));
        // How far from that line the next ray's is.
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

/// A world direction from the generation camera as (U, V, Z), the image displaced `by`.
pub fn homogeneous(header: &VdiHeader, index: &Index, by: Displacement, direction: DVec3) -> DVec3 {
    let h = header.camera.tan_half_fov();
    let per_tan = 0.5 * f64::from(header.params.resolution()) / h;
    let p = header.camera.view_from_world_direction(direction);
    let [i, j] = [0, 1].map(|axis| f64::from(index.corner[axis]) - by[axis]);
    DVec3::new((p.x + h * p.z) * per_tan - i * p.z, (h * p.z - p.y) * per_tan - j * p.z, p.z)
}
