//! View uniforms: all quantities that kernels need, as functions linear in the picture's columns and rows and along each ray.
//!
//! A distant camera, or a distant generation camera, has coordinates so large that single precision would shift rays by steps.
//! So rays start on the plane through the middle of the box, depths count from a plane through the middle of the stored depths,
//! and all coefficients are computed here, once per picture, in double precision.

use super::layout::{LinearForm, PLANES, ViewUniforms};
use crate::reconstruction::{INNER_RING, OUTER_RING};
use crate::simd::{AccelerationGrid, homogeneous, margin};
use glam::DVec3;
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Camera, Vdi};

/// Nearest depth that is drawn, in units of the farthest one: nearer to the generation camera the whole image shrinks to a
/// point, and single precision finds no pixels in it.
const NEAR: f64 = 1e-5;

/// Rays in double precision, which start on the plane through the box's middle.
struct RayForms {
    camera: Camera,
    /// Depth of the plane on which they start.
    middle: f64,
    forward: DVec3,
    /// Change of the direction per half pixel to the right, and down.
    right: DVec3,
    down: DVec3,
    width: u32,
    height: u32,
}

impl RayForms {
    fn new(camera: &Camera, middle: DVec3, width: u32, height: u32) -> Self {
        let (x, y) = (0.5 * f64::from(width), 0.5 * f64::from(height));
        let forward = camera.direction(x, y, width, height);
        // Change per half pixel, from a span as long as the picture is high, to limit cancellation.
        let h = f64::from(height);
        let right = (camera.direction(x + 0.5 * h, y, width, height) - forward) / h;
        let down = (camera.direction(x, y + 0.5 * h, width, height) - forward) / h;
        let middle = camera.view_from_world(middle).z.max(0.0);
        Self { camera: *camera, middle, forward, right, down, width, height }
    }

    /// Coefficients, along the rays, of a linear function of world directions that is -`least` at the point `zero`.
    fn form(&self, zero: DVec3, least: f64, function: impl Fn(DVec3) -> f64) -> [[f64; 3]; 2] {
        let change = [self.forward, self.right, self.down].map(&function);
        let start = function(self.camera.position() + self.middle * self.forward - zero) - least;
        [[start, self.middle * change[1], self.middle * change[2]], change]
    }

    /// The half space where such a function is at least `least`, scaled so that its change along rays is about 1.
    fn plane(&self, zero: DVec3, least: f64, function: impl Fn(DVec3) -> f64) -> LinearForm {
        let form = self.form(zero, least, function);
        let [a, x, y] = form[1].map(f64::abs);
        let most = a.max(x * f64::from(self.width)).max(y * f64::from(self.height));
        let scale = if most > 0.0 { 1.0 / most } else { 1.0 };
        single(form.map(|part| part.map(|c| c * scale)))
    }
}

fn single(form: [[f64; 3]; 2]) -> LinearForm {
    let [start, change] = form.map(|part| part.map(|c| c.clamp(f32::MIN.into(), f32::MAX.into()) as f32));
    LinearForm { start, pad0: 0.0, change, pad1: 0.0 }
}

impl ViewUniforms {
    /// The rays of `camera` through a `width` x `height` picture of `vdi`, with nearest rays or the `sharpness` of a cubic one.
    pub(crate) fn new(
        vdi: &Vdi,
        grid: &AccelerationGrid,
        camera: &Camera,
        [width, height]: [u32; 2],
        sharpness: Option<f32>,
    ) -> Self {
        let header = vdi.header();
        let bounds = &header.bounds;
        let rays = RayForms::new(camera, bounds.center(), width, height);
        let eye = header.camera.position();
        let image = |direction| homogeneous(header, grid, direction);
        let mut planes = [LinearForm::default(); PLANES];
        for axis in 0..3 {
            planes[2 * axis] = rays.plane(bounds.min, 0.0, |d| d[axis]);
            planes[2 * axis + 1] = rays.plane(bounds.max, 0.0, |d| -d[axis]);
        }
        // Displaced lines reach into the rectangle from outside.
        let margin = margin(sharpness);
        let [w, h] = grid.size.map(|n| f64::from(n) + margin);
        planes[6] = rays.plane(eye, 0.0, |d| image(d).x + margin * image(d).z);
        planes[7] = rays.plane(eye, 0.0, |d| w * image(d).z - image(d).x);
        planes[8] = rays.plane(eye, 0.0, |d| image(d).y + margin * image(d).z);
        planes[9] = rays.plane(eye, 0.0, |d| h * image(d).z - image(d).y);
        let [near, far] = grid.depths;
        planes[10] = rays.plane(eye, near.max(NEAR * far), |d| image(d).z);
        planes[11] = rays.plane(eye, -far, |d| -image(d).z);
        Self {
            column: single(rays.form(eye, 0.0, |d| image(d).x)),
            row: single(rays.form(eye, 0.0, |d| image(d).y)),
            depth: single(rays.form(eye, grid.middle, |d| image(d).z)),
            planes,
            background: header.background,
            floor: TRANSMITTANCE_FLOOR as f32,
            width,
            height,
            eye: -rays.middle as f32,
            slope: (camera.tan_half_fov() / f64::from(height)) as f32,
            steps: (1.0 / header.step_length) as f32,
            sharpness: sharpness.unwrap_or_default(),
            inner: INNER_RING.map(|by| by as f32),
            outer: OUTER_RING.map(|by| by as f32),
            margin: margin as f32,
            pad0: 0,
        }
    }
}
