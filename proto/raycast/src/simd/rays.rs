//! The rays of a picture, in packets of eight, clipped to the box; counterpart of `reference/march.rs`.
//!
//! Positions are single precision, in units of sample points, along a ray from its entry into the box; the entry itself is
//! computed in double precision like the oracle's.

use super::own_cells::OwnCells;
use crate::Field;
use glam::DVec3;
use lamina_compute::simd::{Lanes, SimdF32, SimdI32, WIDTH};
use lamina_model::{Camera, vdi};

/// Evaluates an expression for each axis. A macro, because the compiler may fail to inline a closure into the function that
/// enables the instruction set, and then every operation becomes a call.
macro_rules! axes {
    ($a:ident => $value:expr) => {{
        let [x, y, z] = [0, 1, 2];
        [
            {
                let $a: usize = x;
                $value
            },
            {
                let $a: usize = y;
                $value
            },
            {
                let $a: usize = z;
                $value
            },
        ]
    }};
}

pub(super) use axes;

/// The rays of a camera's picture, in units of sample points.
pub(super) struct RaySetup {
    /// Eye in units of sample points.
    pub eye: [f64; 3],
    /// Whether the eye lies between the box's faces of each axis, in world coordinates as the oracle tests it.
    beside: [bool; 3],
    last: [f64; 3],
    per_spacing: [f64; 3],
    per_step: f64,
    /// World direction of the ray through the first pixel, not normalized, and its change per column and per row.
    corner: [f64; 3],
    right: [f64; 3],
    down: [f64; 3],
}

impl RaySetup {
    /// The rays of a `width` x `height` picture, sampled every `step_length` (world units).
    pub(super) fn new(field: &Field, camera: &Camera, [width, height]: [u32; 2], step_length: f64) -> Self {
        let direction = |i: f64, j: f64| camera.direction(i + 0.5, j + 0.5, width, height);
        let corner = direction(0.0, 0.0);
        let (columns, rows) = (f64::from(width), f64::from(height));
        let (eye, bounds) = (camera.position(), field.grid().bounds());
        Self {
            beside: [0, 1, 2].map(|a| bounds.min[a] <= eye[a] && eye[a] <= bounds.max[a]),
            eye: field.index_from_world(camera.position()).to_array(),
            last: field.grid().dims().map(|n| (n - 1) as f64),
            per_spacing: field.grid().spacing().recip().to_array(),
            per_step: 1.0 / step_length,
            corner: corner.to_array(),
            right: ((direction(columns, 0.0) - corner) / columns).to_array(),
            down: ((direction(0.0, rows) - corner) / rows).to_array(),
        }
    }
}

impl RaySetup {
    /// World direction of the ray through a pixel, not normalized.
    pub(super) fn direction(&self, i: u32, j: u32) -> DVec3 {
        DVec3::from_array(self.corner)
            + f64::from(i) * DVec3::from_array(self.right)
            + f64::from(j) * DVec3::from_array(self.down)
    }

    /// A world direction in units of sample points.
    pub(super) fn per_spacing(&self, world: DVec3) -> DVec3 {
        world * DVec3::from_array(self.per_spacing)
    }

    /// Number of steps in the length of a direction.
    pub(super) fn rate(&self, world: DVec3) -> f64 {
        world.length() * self.per_step
    }
}

/// Eight rays, clipped to the box.
#[derive(Clone, Copy)]
pub(super) struct RayPacket<L: Lanes> {
    /// First sample of each ray: 0, unless the ray is clipped.
    pub first: L::I,
    /// End of the samples of each ray; 0 if the ray misses the box.
    pub steps: L::I,
    /// Steps from the eye to the entry.
    pub entry_at: [f64; WIDTH],
    /// Index of the last sample.
    pub last: L::I,
    /// Length of the last step, as a share of a full step.
    pub last_length: [f32; WIDTH],
    /// Middle of the last step, in steps from the entry.
    last_at: L::F,
    entry: [L::F; 3],
    delta: [L::F; 3],
    /// Reciprocal of the change of position per step, per axis; 1e30 where there is none.
    pub inverse: [L::F; 3],
    /// Whether positions grow along the ray, per axis.
    pub forward: [L::M; 3],
}

impl<L: Lanes> RayPacket<L> {
    /// The rays through up to eight `pixels`.
    ///
    /// In units of sample points the box is 0..dims - 1. The arithmetic is double precision in plain loops, which the compiler
    /// vectorizes.
    #[inline(always)]
    pub(super) fn new(setup: &RaySetup, pixels: &[(u32, u32)]) -> Self {
        // Load pixel positions.
        let (mut i, mut j) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (l, pixel) in pixels.iter().enumerate().take(WIDTH) {
            (i[l], j[l]) = (f64::from(pixel.0), f64::from(pixel.1));
        }
        // Intersect the rays with the box, slab by slab.
        let (mut near, mut far, mut square) = ([0.0; WIDTH], [f64::MAX; WIDTH], [0.0; WIDTH]);
        let mut direction = [[0.0; WIDTH]; 3];
        for (a, direction) in direction.iter_mut().enumerate() {
            // A ray parallel to a slab is inside it everywhere or nowhere.
            let still = if setup.beside[a] { [f64::MIN, f64::MAX] } else { [f64::MAX, f64::MIN] };
            for l in 0..WIDTH {
                let world = setup.corner[a] + i[l] * setup.right[a] + j[l] * setup.down[a];
                let d = world * setup.per_spacing[a];
                square[l] += world * world;
                direction[l] = d;
                let inverse = 1.0 / d;
                let (s, t) = ((0.0 - setup.eye[a]) * inverse, (setup.last[a] - setup.eye[a]) * inverse);
                let (s, t) = if s < t { (s, t) } else { (t, s) };
                let (s, t) = if d == 0.0 { (still[0], still[1]) } else { (s, t) };
                near[l] = if s > near[l] { s } else { near[l] };
                far[l] = if t < far[l] { t } else { far[l] };
            }
        }
        // Count steps, and convert to single precision relative to the entry.
        let (mut steps, mut last_length, mut last_at) = ([0; WIDTH], [1.0; WIDTH], [0.0; WIDTH]);
        let (mut entry, mut delta, mut entry_at) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3], [0.0; WIDTH]);
        for l in 0..WIDTH {
            // Steps per unit of the direction's length.
            let rate = square[l].sqrt() * setup.per_step;
            let length = if far[l] > near[l] { (far[l] - near[l]) * rate } else { 0.0 };
            let n = (length - vdi::STEP_ROUNDING).ceil().max(0.0);
            let rest = (length - (n - 1.0)).min(1.0);
            steps[l] = n as i32;
            entry_at[l] = near[l] * rate;
            last_length[l] = rest as f32;
            last_at[l] = (n - 1.0 + 0.5 * rest) as f32;
            for a in 0..3 {
                entry[a][l] = (setup.eye[a] + near[l] * direction[a][l]) as f32;
                delta[a][l] = (direction[a][l] / rate) as f32;
            }
        }
        for count in steps.iter_mut().skip(pixels.len()) {
            *count = 0;
        }
        let steps = L::I::from_array(steps);
        let delta = axes!(a => L::F::from_array(delta[a]));
        let zero = L::F::splat(0.0);
        // A ray parallel to an axis never leaves a brick along it.
        let inverse = axes!(a => {
            let still = delta[a].abs().le(L::F::splat(1e-30));
            L::F::select(still, L::F::splat(1e30), L::F::splat(1.0).div(delta[a]))
        });
        Self {
            first: L::I::splat(0),
            steps,
            entry_at,
            last: steps - L::I::splat(1),
            last_length,
            last_at: L::F::from_array(last_at),
            entry: axes!(a => L::F::from_array(entry[a])),
            delta,
            inverse,
            forward: axes!(a => zero.lt(inverse[a])),
        }
    }

    /// The same rays with only those steps whose samples lie in the cells of `own`.
    #[inline(always)]
    pub(super) fn within(&self, own: &OwnCells) -> Self {
        let (entry, delta) = (self.entry.map(SimdF32::to_array), self.delta.map(SimdF32::to_array));
        let (mut first, mut steps, last_at) = (self.first.to_array(), self.steps.to_array(), self.last_at.to_array());
        own.restrict(&entry, &delta, &last_at, (&mut first, &mut steps));
        Self { first: L::I::from_array(first), steps: L::I::from_array(steps), ..*self }
    }

    /// The point `t` steps from the entry, in units of sample points.
    #[inline(always)]
    pub(super) fn at(&self, t: L::F) -> [L::F; 3] {
        axes!(a => self.entry[a] + t * self.delta[a])
    }

    /// Position of sample `step`, in units of sample points.
    #[inline(always)]
    pub(super) fn position(&self, step: L::I) -> [L::F; 3] {
        // The middle of a shortened last step comes before that of a full one.
        self.at((L::F::from(step) + L::F::splat(0.5)).min(self.last_at))
    }
}
