//! What all rays of one picture share.
//!
//! Rays are O + t D with D = base + x `across` + y `down` linear in the picture's pixels and not of unit length. They are
//! held twice: in the world, for the box, and in homogeneous image positions (U, V, Z) of the generation camera, where
//! U / Z and V / Z are the column and row counted from the occupied rectangle's corner and Z is depth along the view.

use super::gather::Light;
use super::index::Index;
use super::line::Line;
use super::walk;
use glam::DVec3;
use lamina_model::{Camera, Vdi, VdiHeader};

/// How far the occupied rectangle is widened, in pixels: what rounding puts beside its rim is still found.
const HAIR: f64 = 1e-9;

/// A pencil of rays from one origin, in one frame of reference.
pub struct Pencil {
    /// Where all rays start.
    pub origin: DVec3,
    base: DVec3,
    across: DVec3,
    down: DVec3,
}

impl Pencil {
    fn new(camera: &Camera, width: u32, height: u32, of_point: DVec3, map: impl Fn(DVec3) -> DVec3) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let corner = |x: f64, y: f64| map(camera.direction(x, y, width, height));
        let base = corner(0.0, 0.0);
        // From one rim to the other, so that the last pixel is as exact as the first.
        Self { origin: of_point, base, across: (corner(w, 0.0) - base) / w, down: (corner(0.0, h) - base) / h }
    }

    /// Direction of the ray through the centre of pixel (`i`, `j`).
    #[inline(always)]
    pub fn direction(&self, i: u32, j: u32) -> DVec3 {
        self.base + (f64::from(i) + 0.5) * self.across + (f64::from(j) + 0.5) * self.down
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
    /// Functionals (U, V, Z) -> number that are >= 0 where the VDI may show something: the rectangle's sides, then depth.
    pub sides: [DVec3; 4],
}

impl<'a> Frame<'a> {
    /// A picture of `vdi` from `camera`.
    pub fn new(vdi: &'a Vdi, index: &'a Index, camera: &Camera, width: u32, height: u32) -> Self {
        let map = |direction| homogeneous(vdi.header(), index, direction);
        let image = Pencil::new(camera, width, height, map(camera.position() - vdi.header().camera.position()), map);
        let world = Pencil::new(camera, width, height, camera.position(), |direction| direction);
        let [w, h] = index.size.map(|n| f64::from(n) + HAIR);
        let sides = [
            DVec3::new(1.0, 0.0, HAIR),
            DVec3::new(-1.0, 0.0, w),
            DVec3::new(0.0, 1.0, HAIR),
            DVec3::new(0.0, -1.0, h),
        ];
        Self { vdi, index, world, image, sides }
    }

    /// The colour of pixel (`i`, `j`).
    pub fn color(&self, i: u32, j: u32) -> [f32; 3] {
        let mut light = Light::default();
        if let Some(line) = Line::new(self, i, j) {
            let mut hint = 0;
            let _ = walk::walk(self.index, &line, |pixel, from, to| {
                light.gather(self, &line, pixel, from, to, &mut hint)
            });
        }
        light.over(self.vdi.header().background)
    }
}

/// A world direction from the generation camera as (U, V, Z).
fn homogeneous(header: &VdiHeader, index: &Index, direction: DVec3) -> DVec3 {
    let h = header.camera.tan_half_fov();
    let per_tan = 0.5 * f64::from(header.params.resolution()) / h;
    let p = header.camera.view_from_world_direction(direction);
    let [i, j] = index.corner.map(f64::from);
    DVec3::new((p.x + h * p.z) * per_tan - i * p.z, (h * p.z - p.y) * per_tan - j * p.z, p.z)
}
