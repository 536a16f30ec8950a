//! Traversal of the VDI's pixels along a straight ray.
//!
//! A line in the world is a line in the generation camera's image, so its pixels are traversed with a 2-D DDA. In the camera's
//! frame (X right, Y up, Z along the view) the ray is O + s D, and it crosses the plane X = f Z of a pixel boundary at s = (f
//! Z_O - X_O) / (X_D - f Z_D). The ray is first clipped to the box and to the camera's pyramid: inside it Z > 0 and image
//! positions are monotone in s, so the boundaries crossed are those between the first and the last pixel, and none that the
//! line reaches only behind the camera can come in between.

use crate::Displacement;
use glam::DVec3;
use lamina_model::{Ray, VdiHeader};
use std::ops::ControlFlow;

/// A ray in the generation camera's frame, clipped to the box and the camera's pyramid.
pub(super) struct FrustumWalk<'a> {
    header: &'a VdiHeader,
    origin: DVec3,
    direction: DVec3,
    enter: f64,
    leave: f64,
    displaced: Displacement,
}

/// The part of a ray inside one pixel's frustum.
pub(super) struct PixelCrossing {
    /// Pixel column.
    pub i: u32,
    /// Pixel row.
    pub j: u32,
    /// Ray distance at which the part begins.
    pub from: f64,
    /// Ray distance at which the part ends.
    pub to: f64,
}

impl<'a> FrustumWalk<'a> {
    /// `ray` clipped to the box and the pyramid of `header`, whose image is `displaced`; `None` if it misses them.
    pub(super) fn new(header: &'a VdiHeader, ray: &Ray, displaced: Displacement) -> Option<Self> {
        let (mut enter, mut leave) = header.bounds.clip(ray)?;
        let camera = &header.camera;
        let origin = camera.view_from_world(ray.origin);
        let direction = camera.view_from_world_direction(ray.direction);
        let h = camera.tan_half_fov();
        let [right, down] = displaced.map(|by| 2.0 * h * by / f64::from(header.params.resolution()));
        // The four sides: a + b s >= 0. Together they imply Z >= 0.
        let sides = [[1.0, 0.0, h + right], [-1.0, 0.0, h - right], [0.0, 1.0, h - down], [0.0, -1.0, h + down]];
        for side in sides.map(DVec3::from_array) {
            let (a, b) = (origin.dot(side), direction.dot(side));
            if b > 0.0 {
                enter = enter.max(-a / b);
            } else if b < 0.0 {
                leave = leave.min(-a / b);
            } else if a < 0.0 {
                return None;
            }
        }
        (enter < leave).then_some(Self { header, origin, direction, enter, leave, displaced })
    }

    /// Depth along the view at ray distance `s`.
    pub(super) fn depth(&self, s: f64) -> f64 {
        self.origin.z + s * self.direction.z
    }

    /// Passes the pixels crossed to `visit`, in order along the ray, until it breaks.
    pub(super) fn pixels(&self, mut visit: impl FnMut(PixelCrossing) -> ControlFlow<()>) {
        // Stay a little inside both ends: at the apex of the pyramid image positions are undefined.
        let hair = 1e-9 * (self.leave - self.enter);
        let (first, last) = (self.pixel_at(self.enter + hair), self.pixel_at(self.leave - hair));
        let (mut pixel, mut from) = (first, self.enter);
        let mut next = [0, 1].map(|axis| self.crossing(axis, pixel[axis], last[axis]));
        loop {
            let axis = usize::from(next[1] < next[0]);
            let at_end = pixel == last;
            // Rounding may put a crossing slightly before the previous one: then the part is empty.
            let to = if at_end { self.leave } else { next[axis].clamp(from, self.leave) };
            let stretch = PixelCrossing { i: pixel[0], j: pixel[1], from, to };
            if (to > from && visit(stretch).is_break()) || at_end {
                return;
            }
            pixel[axis] = if pixel[axis] < last[axis] { pixel[axis] + 1 } else { pixel[axis] - 1 };
            next[axis] = self.crossing(axis, pixel[axis], last[axis]);
            from = to;
        }
    }

    fn pixel_at(&self, s: f64) -> [u32; 2] {
        let r = self.header.params.resolution();
        let p = self.origin + s * self.direction;
        let hz = self.header.camera.tan_half_fov() * p.z;
        // NaN casts to 0; what rounding pushes over the edge belongs to the last pixel.
        let index = |ratio: f64, by: f64| ((0.5 * (ratio + 1.0) * f64::from(r) + by) as u32).min(r - 1);
        [index(p.x / hz, self.displaced[0]), index(-p.y / hz, self.displaced[1])]
    }

    /// Ray distance of the boundary between `pixel` and its neighbor towards `last`; infinity if `pixel` is `last`.
    fn crossing(&self, axis: usize, pixel: u32, last: u32) -> f64 {
        if pixel == last {
            return f64::INFINITY;
        }
        let boundary = f64::from(if pixel < last { pixel + 1 } else { pixel }) - self.displaced[axis];
        let f = self.header.camera.tan_half_fov() * (2.0 * boundary / f64::from(self.header.params.resolution()) - 1.0);
        let (o, d) = match axis {
            0 => (self.origin.x, self.direction.x),
            _ => (-self.origin.y, -self.direction.y),
        };
        let s = (f * self.origin.z - o) / (d - f * self.direction.z);
        // The boundary lies between first and last pixel, so it is crossed; NaN from rounding means immediately.
        if s.is_nan() { f64::NEG_INFINITY } else { s }
    }
}
