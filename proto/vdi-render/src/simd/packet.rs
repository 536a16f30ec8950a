//! Packets of eight rays, clipped to where the VDI may be visible, as straight lines in the VDI's image.
//!
//! Between entry and exit, columns and rows are linear in a parameter mu in [0, 1], and so is 1/Z. With Z0 and Z1 the depths at
//! both ends, the share of the ray's length in front of mu is mu Z0 / (mu Z0 + (1 - mu) Z1). Lines are computed in double
//! precision and stored in single: depths count from the middle of the stored depths, so that they stay as small as the volume.

use super::acceleration_grid::DepthBins;
use super::clip::ClipPlanes;
use super::ray_setup::{RaySetup, margin};
use crate::Displacement;
use lamina_compute::simd::{Lanes, SimdF32, SimdI32, SimdMask, WIDTH};

/// Relative length left out at both ends of a ray: at the apex of the pyramid image positions are undefined.
const HAIR: f64 = 1e-9;

/// Reciprocal of no change: puts all boundaries but the one under the ray far beyond its ends.
const FAR: f32 = 1e30;

/// Relative error of positions in single precision, per pixel or bin of the range.
const ROUNDING: f32 = 1e-6;

/// Eight rays as lines; see the module's documentation.
pub(super) struct LinePacket<L: Lanes> {
    /// Lanes with a ray that may meet something.
    pub live: L::M,
    /// Column and row at mu = 0; also split into the pixel and the position in it, which keeps more digits.
    start: [L::F; 2],
    first: [L::I; 2],
    inside: [L::F; 2],
    /// Change of column and row from mu = 0 to 1.
    change: [L::F; 2],
    /// Reciprocal of `change`.
    per_change: [L::F; 2],
    /// Depth at mu = 0, relative to the middle depth.
    depth: L::F,
    /// Change of depth from mu = 0 to 1; negative for rays that approach the generation camera.
    depth_change: L::F,
    /// Z0 / Z1.
    ratio: L::F,
    /// Position on the scale of depth bins at mu = 0, and its change.
    depth_bins: [L::F; 2],
    /// Rounding error of positions on the scale of depth bins.
    bin_margin: L::F,
    /// Rounding error of columns and rows.
    pub pixel_margin: L::F,
    /// Length of the line in step lengths; negative for lanes without a ray.
    steps: L::F,
}

/// The signs of direction that the rays of a group share.
#[derive(Clone, Copy)]
pub(super) struct Heading {
    /// Whether column and row grow along the rays.
    pub forward: [bool; 2],
    /// Whether depth grows along the rays.
    pub receding: bool,
    /// Axis of the larger change: 0 for columns, 1 for rows.
    pub along: usize,
}

impl Heading {
    /// Step to the next pixel.
    #[inline(always)]
    pub(super) fn step(self, axis: usize) -> i32 {
        if self.forward[axis] { 1 } else { -1 }
    }

    /// Offset from a pixel to the boundary at which rays leave it.
    #[inline(always)]
    pub(super) fn far_side(self, axis: usize) -> i32 {
        i32::from(self.forward[axis])
    }
}

impl<L: Lanes> LinePacket<L> {
    /// The rays through the centers of one to eight `pixels`; `clip` must hold all planes that clip them.
    #[inline(always)]
    pub(super) fn new(setup: &RaySetup, clip: &ClipPlanes, pixels: &[(u32, u32)]) -> Self {
        // Clip the rays in double precision.
        let (mut x, mut y) = ([0.0; WIDTH], [0.0; WIDTH]);
        for l in 0..WIDTH {
            let (i, j) = pixels[l.min(pixels.len() - 1)];
            (x[l], y[l]) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
        }
        let (enter, leave) = clip.spans(&x, &y);
        let (origin, image, world) = (setup.image.origin, &setup.image, &setup.world);
        let [w, h] = setup.grid.size.map(f64::from);
        let margin = margin(setup.sharpness);
        let depth_bins = setup.grid.depth_bins;
        let per_step = 1.0 / setup.vdi.header().step_length;
        let mut lines = [[0.0_f32; WIDTH]; 12];
        let mut first = [[0_i32; WIDTH]; 2];
        // Transform entry and exit to the VDI's image.
        for l in 0..WIDTH {
            let hair = HAIR * (leave[l] - enter[l]);
            let (from, to) = (enter[l] + hair, leave[l] - hair);
            let direction = image.direction(x[l], y[l]);
            let (a, b) = (origin + from * direction, origin + to * direction);
            let (inverse0, inverse1) = (1.0 / a.z, 1.0 / b.z);
            // Clamp what rounding pushed over the edge of the rectangle.
            let within = |place: f64, size: f64| place.max(-margin).min(size + margin);
            let start = [within(a.x * inverse0, w), within(a.y * inverse0, h)];
            let end = [within(b.x * inverse1, w), within(b.y * inverse1, h)];
            let pixel = start.map(f64::floor);
            let length = (to - from) * world.direction(x[l], y[l]).length();
            // False for NaN too.
            let live = enter[l] < leave[l] && leave[l] < f64::INFINITY && a.z > 0.0 && b.z > 0.0;
            let line = [
                start[0],
                start[1],
                end[0] - start[0],
                end[1] - start[1],
                a.z - setup.grid.middle,
                b.z - a.z,
                a.z * inverse1,
                (inverse0 - depth_bins.far) * depth_bins.per_inverse_depth,
                (inverse1 - inverse0) * depth_bins.per_inverse_depth,
                length * per_step,
                start[0] - pixel[0],
                start[1] - pixel[1],
            ];
            (first[0][l], first[1][l]) = (pixel[0] as i32, pixel[1] as i32);
            for (n, number) in line.into_iter().enumerate() {
                lines[n][l] = number as f32;
            }
            // A negative length marks a lane without a ray.
            if !live || l >= pixels.len() {
                lines[9][l] = -1.0;
            }
        }
        // Load the lines into lanes.
        let [columns, rows] = [L::F::from_array(lines[2]), L::F::from_array(lines[3])];
        let (bin_change, steps) = (L::F::from_array(lines[8]), L::F::from_array(lines[9]));
        let zero = L::F::splat(0.0);
        let live = zero.le(steps);
        Self {
            live,
            start: [L::F::from_array(lines[0]), L::F::from_array(lines[1])],
            first: [L::I::from_array(first[0]), L::I::from_array(first[1])],
            inside: [L::F::from_array(lines[10]), L::F::from_array(lines[11])],
            change: [columns, rows],
            per_change: [per_change::<L>(columns), per_change::<L>(rows)],
            depth: L::F::from_array(lines[4]),
            depth_change: L::F::from_array(lines[5]),
            ratio: L::F::from_array(lines[6]),
            depth_bins: [L::F::from_array(lines[7]), bin_change],
            bin_margin: bin_change.abs() * L::F::splat(ROUNDING),
            pixel_margin: L::F::splat(ROUNDING * w.max(h) as f32),
            steps,
        }
    }

    /// The lines moved `by` in the VDI's image.
    #[inline(always)]
    pub(super) fn displaced(&self, by: Displacement) -> Self {
        let mut moved = Self { ..*self };
        let by = by.map(|by| L::F::splat(by as f32));
        moved.start = [self.start[0] + by[0], self.start[1] + by[1]];
        // `first` stays: `inside` then lies beyond the pixel, by too little to lose digits.
        moved.inside = [self.inside[0] + by[0], self.inside[1] + by[1]];
        moved
    }

    /// Where the lines in `group` enter and leave the occupied rectangle of `size`.
    #[inline(always)]
    pub(super) fn visible(&self, heading: Heading, size: [i32; 2], group: L::M) -> [L::F; 2] {
        let (zero, one) = (L::F::splat(0.0), L::F::splat(1.0));
        let (mut from, mut to) = (L::F::select(group, zero, one), L::F::select(group, one, zero));
        for (axis, size) in size.into_iter().enumerate() {
            let (low, high) = (self.boundary(axis, 0), self.boundary(axis, size));
            let (enter, leave) = if heading.forward[axis] { (low, high) } else { (high, low) };
            (from, to) = (enter.max(from), leave.min(to));
        }
        [from, to]
    }

    /// The first ray of `left` and all those that share its signs of direction.
    #[inline(always)]
    pub(super) fn group(&self, left: L::M) -> (L::M, Heading) {
        let (zero, first) = (L::F::splat(0.0), left.bits().trailing_zeros());
        let (mut group, mut grows) = (left, [true; 3]);
        for (grows, change) in grows.iter_mut().zip([self.change[0], self.change[1], self.depth_change]) {
            let falls = change.lt(zero);
            *grows = falls.bits() >> first & 1 == 0;
            group = group & if *grows { !falls } else { falls };
        }
        let steep = self.change[0].abs().lt(self.change[1].abs());
        let along = (steep.bits() >> first & 1) as usize;
        (group, Heading { forward: [grows[0], grows[1]], receding: grows[2], along })
    }

    /// Column or row at `mu`.
    #[inline(always)]
    pub(super) fn place(&self, axis: usize, mu: L::F) -> L::F {
        self.start[axis] + self.change[axis] * mu
    }

    /// Position mu at which each line crosses the boundary before pixel `k`.
    #[inline(always)]
    pub(super) fn boundary(&self, axis: usize, k: i32) -> L::F {
        (L::F::from(L::I::splat(k) - self.first[axis]) - self.inside[axis]) * self.per_change[axis]
    }

    /// Mask of the depth bins that the lines in `met` cross between two positions mu.
    #[inline(always)]
    pub(super) fn depth_bins(&self, heading: Heading, from: L::F, to: L::F, met: L::M) -> u64 {
        let (a, b) = (self.depth_bins[0] + self.depth_bins[1] * from, self.depth_bins[0] + self.depth_bins[1] * to);
        let (low, high) = if heading.receding { (b, a) } else { (a, b) };
        // Bins 0 and 63 extend to infinity.
        let (zero, last) = (L::F::splat(0.0), L::F::splat(63.0));
        let low = (low - self.bin_margin).min(last).max(zero);
        let high = (high + self.bin_margin).min(last).max(zero);
        let [low, high] = L::F::range_where(low, high, met);
        DepthBins::bits(low as u32, high as u32)
    }

    /// Share of the line's length in front of `mu`.
    #[inline(always)]
    pub(super) fn way(&self, mu: L::F) -> L::F {
        let part = mu * self.ratio;
        part.div(part + (L::F::splat(1.0) - mu))
    }

    /// Depth, relative to the middle depth, behind the share `way` of the line's length.
    #[inline(always)]
    pub(super) fn depth(&self, way: L::F) -> L::F {
        self.depth + way * self.depth_change
    }

    /// Length, in step lengths, of a share of the line.
    #[inline(always)]
    pub(super) fn steps(&self, part: L::F) -> L::F {
        part * self.steps
    }
}

#[inline(always)]
fn per_change<L: Lanes>(change: L::F) -> L::F {
    let zero = L::F::splat(0.0);
    let far = L::F::select(change.lt(zero), L::F::splat(-FAR), L::F::splat(FAR));
    L::F::select(change.abs().lt(L::F::splat(1.0 / FAR)), far, L::F::splat(1.0).div(change))
}
