//! One ray, clipped to where the VDI may show something, as a straight line in the VDI's image.
//!
//! Between entry and exit, columns and rows are linear in a parameter mu in [0, 1], and so is 1/Z. With Z0 and Z1 the
//! depths at both ends, Z(mu) = Z0 Z1 / (Z1 + mu (Z0 - Z1)), and the way covered is perspective-correct: s(mu) = s1 mu
//! Z(mu) / Z1. So a step from one pixel to the next takes a product for mu and one division for depth.

use super::frame::Frame;
use super::index::Slabs;

/// How much of the ray is left out at both ends, relative: at the tip of the pyramid image positions are not defined.
const HAIR: f64 = 1e-9;

/// Relative change of depth below which a ray counts as parallel to the generation camera's image plane.
const FLAT: f64 = 1e-9;

/// A point of a [`Line`].
#[derive(Clone, Copy)]
pub struct Point {
    /// Place on the line.
    pub mu: f64,
    /// The slab of its depth.
    pub slab: u32,
}

/// See the file's head.
pub struct Line {
    /// Column and row at mu = 0.
    pub start: [f64; 2],
    /// Change of column and row from mu = 0 to 1.
    pub change: [f64; 2],
    /// One over it; infinite if there is none.
    pub per_change: [f64; 2],
    z1: f64,
    z0_minus_z1: f64,
    z0_z1: f64,
    /// Place on the scale of slabs at mu = 0, and its change.
    slabs: [f64; 2],
    /// Length of the whole in step lengths, over Z1.
    steps_over_z1: f64,
    /// Length in step lengths per depth; `None` if the ray runs along a depth plane.
    pub steps_per_depth: Option<f64>,
}

impl Line {
    /// The ray through picture position (`x`, `y`) from entry to exit; `None` if nothing of it is before the camera.
    #[inline(always)]
    pub fn new(frame: &Frame, x: f64, y: f64, (enter, leave): (f64, f64)) -> Option<Self> {
        let (origin, direction) = (frame.image.origin, frame.image.direction(x, y));
        let hair = HAIR * (leave - enter);
        let (enter, leave) = (enter + hair, leave - hair);
        let (a, b) = (origin + enter * direction, origin + leave * direction);
        let (z0, z1) = (a.z, b.z);
        if !(z0 > 0.0 && z1 > 0.0) {
            return None;
        }
        // What rounding pushes over the rim is pulled back by more than rounding, so that the rim is never crossed.
        let place = |x: f64, n: u32| x.max(HAIR).min(f64::from(n) - HAIR);
        let [w, h] = frame.index.size;
        let start = [place(a.x / z0, w), place(a.y / z0, h)];
        let end = [place(b.x / z1, w), place(b.y / z1, h)];
        let change = [end[0] - start[0], end[1] - start[1]];
        let steps = (leave - enter) * frame.world.direction(x, y).length() / frame.vdi.header().step_length;
        let slabs = frame.index.slabs;
        let place_of = |z: f64| (1.0 / z - slabs.far) * slabs.per_inverse_depth;
        Some(Self {
            start,
            change,
            per_change: [1.0 / change[0], 1.0 / change[1]],
            z1,
            z0_minus_z1: z0 - z1,
            z0_z1: z0 * z1,
            slabs: [place_of(z0), place_of(z1) - place_of(z0)],
            steps_over_z1: steps / z1,
            // Below, the difference of two depths keeps too few digits.
            steps_per_depth: ((z1 - z0).abs() > FLAT * z1.max(z0)).then(|| steps / (z1 - z0).abs()),
        })
    }

    /// The point at `mu`.
    #[inline(always)]
    pub fn at(&self, mu: f64) -> Point {
        Point { mu, slab: Slabs::slab(self.slabs[0] + mu * self.slabs[1]) }
    }

    /// Depth along the view.
    #[inline(always)]
    pub fn depth(&self, point: Point) -> f64 {
        self.z0_z1 / (self.z1 + point.mu * self.z0_minus_z1)
    }

    /// World length between two points, in step lengths.
    pub fn steps(&self, from: Point, to: Point) -> f64 {
        (to.mu * self.depth(to) - from.mu * self.depth(from)) * self.steps_over_z1
    }
}
