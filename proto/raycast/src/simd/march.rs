//! Ray marching, eight rays at a time; counterpart of `reference/march.rs`.
//!
//! Positions are single precision, in units of sample points, along a ray from its entry into the box; the entry itself is
//! computed in double precision like the oracle's. Lanes advance independently: those in empty bricks jump to the first
//! sample beyond, those in visible bricks take the samples up to the nearest brick boundary.

use super::own_cells::OwnCells;
use crate::Field;
use crate::volume::occupancy::BRICK;
use crate::volume::transfer_lut::TransferLut;
use glam::DVec3;
use lamina_compute::simd::{Lanes, Pair, SimdF32, SimdI32, SimdMask, WIDTH};
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

/// The most samples passed to a sink at once.
const MOST: usize = 16;

/// A consumer of samples along eight rays.
pub(super) trait SampleSink<L: Lanes> {
    /// Takes the samples from step `step` on, given by their positions `at` in rows of the transfer table, for the lanes in
    /// `live`. Returns the lanes whose rays continue. Steps beyond a ray's last one must be ignored.
    #[inline(always)]
    fn samples(&mut self, packet: &RayPacket<L>, step: L::I, at: &[L::F], live: L::M) -> L::M {
        let (mut step, mut live) = (step, live);
        for &at in at {
            live = self.sample(packet, step, at, live & packet.steps.gt(step));
            step = step + L::I::splat(1);
        }
        live
    }

    /// Takes one sample.
    fn sample(&mut self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> L::M;
}

/// Samples the voxels of a field, for kernels.
pub(super) struct VolumeSampler<'a, V> {
    /// The voxels from the first one on, from the second row, the second slice, and the second row of the second slice.
    corners: [&'a [V]; 4],
    /// Smallest position on each axis, that of the first stored point.
    first: [f32; 3],
    /// Largest position on each axis: just below the last sample point, so that its cell is the last one.
    last: [f32; 3],
    /// True if voxel indices exceed 31 bits.
    huge: bool,
    /// Number of the first stored point, and of the first brick, as if those before it were there, too.
    before: usize,
    bricks_before: i32,
    /// The cells whose samples are taken, and the largest position in the whole grid, if that is not all of it.
    own: Option<OwnCells>,
    row: usize,
    slice: usize,
    /// Scale and offset from stored scalars to table rows.
    scale: f32,
    offset: f32,
    bricks: [i32; 3],
    distances: &'a [u8],
    /// The transfer function for this step length.
    pub table: &'a TransferLut,
}

/// True if `VolumeSampler` supports `field`: two sample points or more per axis, and positions, slices and bricks that fit 24, 31
/// and 31 bits.
pub fn fits(field: &Field) -> bool {
    let ([nx, ny, nz], bricks) = (field.grid_part().dims(), field.empty_space().distances().len());
    let positions = field.grid().dims().iter().all(|&n| n < 1 << 24);
    nx.min(ny).min(nz) >= 2 && positions && nx * ny < 1 << 31 && bricks < 1 << 31
}

impl<'a, V: Pair> VolumeSampler<'a, V> {
    /// A sampler of `voxels`, which must be `field`'s; the field must [fit](fits).
    pub(super) fn new(field: &'a Field, voxels: &'a [V], table: &'a TransferLut) -> Self {
        let (scale, offset) = field.unit_from_stored();
        let rows = table.bins() as f64;
        let offset = (offset * rows + f64::from(table.below)) as f32;
        Self::scaled(field, voxels, table, [(scale * rows) as f32, offset])
    }

    /// A sampler of other voxels on the grid of `field`, which must [fit](fits): samples are `scale` times them plus `offset`.
    pub(super) fn scaled(field: &'a Field, voxels: &'a [V], table: &'a TransferLut, [scale, offset]: [f32; 2]) -> Self {
        let (part, dims) = (field.grid_part(), field.grid_part().dims());
        let (start, bricks) = (part.start(), field.empty_space());
        assert!(fits(field) && voxels.len() == dims.iter().product::<usize>());
        Self {
            corners: [0, 1, dims[1], dims[1] + 1].map(|row| &voxels[row * dims[0]..]),
            first: start.map(|s| s as f32),
            last: std::array::from_fn(|a| ((start[a] + dims[a] - 1) as f32).next_down()),
            huge: voxels.len() >= 1 << 31,
            before: (start[2] * dims[1] + start[1]) * dims[0] + start[0],
            own: OwnCells::of(field.grid(), part),
            row: dims[0],
            slice: dims[0] * dims[1],
            scale,
            offset,
            bricks: bricks.dims().map(|n| n as i32),
            bricks_before: ((bricks.first()[2] * bricks.dims()[1] + bricks.first()[1]) * bricks.dims()[0]
                + bricks.first()[0]) as i32,
            distances: bricks.distances(),
            table,
        }
    }

    /// The cell that contains each position, and the weights of its far corners.
    #[inline(always)]
    fn cell<L: Lanes>(&self, p: [L::F; 3]) -> ([L::I; 3], [L::F; 3]) {
        let x = axes!(a => p[a].max(L::F::splat(self.first[a])).min(L::F::splat(self.last[a])));
        let cell = axes!(a => x[a].to_int());
        (cell, axes!(a => x[a] - L::F::from(cell[a])))
    }

    /// The trilinear value at each position, in rows of the transfer table.
    #[inline(always)]
    pub(super) fn sample<L: Lanes>(&self, p: [L::F; 3]) -> L::F {
        let (cell, w) = self.cell::<L>(p);
        let in_slice = cell[1] * L::I::splat(self.row as i32) + cell[0];
        let index = if self.huge {
            let (z, in_slice) = (cell[2].to_indices(), in_slice.to_indices());
            std::array::from_fn(|l| z[l] * self.slice + in_slice[l] - self.before)
        } else {
            (cell[2] * L::I::splat(self.slice as i32) + in_slice - L::I::splat(self.before as i32)).to_indices()
        };
        let near = lerp::<L>(self.along_x::<L>(0, &index, w[0]), self.along_x::<L>(1, &index, w[0]), w[1]);
        let far = lerp::<L>(self.along_x::<L>(2, &index, w[0]), self.along_x::<L>(3, &index, w[0]), w[1]);
        lerp::<L>(near, far, w[2]) * L::F::splat(self.scale) + L::F::splat(self.offset)
    }

    /// Interpolates between the voxels at `index` of a corner and their neighbors along x.
    #[inline(always)]
    fn along_x<L: Lanes>(&self, corner: usize, index: &[usize; WIDTH], w: L::F) -> L::F {
        // SAFETY: positions are clamped below the last sample point, so cells are at most dims - 2 on every axis, and an
        // index plus a row, a slice, or both, plus one, is that of a voxel.
        #[expect(unsafe_code, reason = "indices were clamped at once, in `cell`")]
        let (a, b) = unsafe { L::pairs(self.corners[corner], index) };
        lerp::<L>(a, b, w)
    }

    /// For each lane, the distance in bricks to the nearest visible one (0: the current one), and the number of samples from this
    /// one on that lie in the empty cube, or in the visible brick.
    #[inline(always)]
    fn run<L: Lanes>(&self, packet: &RayPacket<L>, p: [L::F; 3]) -> (L::I, L::I) {
        let (cell, _) = self.cell::<L>(p);
        let brick = axes!(a => cell[a].shr::<2>());
        let [bx, by, _] = self.bricks;
        let number = (brick[2] * L::I::splat(by) + brick[1]) * L::I::splat(bx) + brick[0];
        let number = number - L::I::splat(self.bricks_before);
        let (number, mut bytes) = (number.to_indices(), 0);
        for l in (0..WIDTH).rev() {
            bytes = bytes << 8 | u64::from(self.distances[number[l]]);
        }
        let distance = L::I::from_bytes(bytes);
        let reach = distance.max(L::I::splat(1)) - L::I::splat(1);
        let steps = axes!(a => {
            let edge = L::I::select(packet.forward[a], brick[a] + reach + L::I::splat(1), brick[a] - reach);
            (L::F::from(edge * L::I::splat(BRICK as i32)) - p[a]) * packet.inverse[a]
        });
        let least = steps[0].min(steps[1]).min(steps[2]).max(L::F::splat(0.0)).min(L::F::splat(1e9));
        (distance, least.to_int() + L::I::splat(1))
    }

    /// Passes all samples in the field's own cells that may be visible to `sink`, each ray front to back.
    #[inline(always)]
    pub(super) fn march<L: Lanes>(&self, packet: &RayPacket<L>, sink: &mut impl SampleSink<L>) {
        let (first, steps) = match &self.own {
            None => (packet.first, packet.steps),
            Some(own) => packet.steps_in(own),
        };
        let packet = &RayPacket { first, steps, ..*packet };
        let mut step = packet.first;
        let mut live = packet.steps.gt(step);
        let mut ahead = self.run(packet, packet.position(step));
        while live.any() {
            let (distance, run) = ahead;
            let visible = live & distance.eq(L::I::splat(0));
            // Take as many samples as the lane that stays longest: samples beyond a lane's brick are harmless.
            let shared = L::I::select(visible, run, L::I::splat(0)).max_lane().min(MOST as i32);
            let next = step + L::I::select(visible, L::I::splat(shared), run);
            // Look the next brick up early, so that its latency passes while samples are taken.
            ahead = self.run(packet, packet.position(next));
            if visible.any() {
                // Compute all positions in the table first, then consume them: each loop keeps its values in registers.
                let mut at = [L::F::splat(0.0); MOST];
                let count = shared as usize;
                for (k, at) in at.iter_mut().enumerate().take(count) {
                    *at = self.sample::<L>(packet.position(step + L::I::splat(k as i32)));
                }
                // Remove the lanes that end here; lanes that are not in a visible brick stay.
                live = live & (sink.samples(packet, step, &at[..count], visible) | !visible);
            }
            step = next;
            live = live & packet.steps.gt(step);
        }
    }
}

/// Linear interpolation from `a` to `b`.
#[inline(always)]
fn lerp<L: Lanes>(a: L::F, b: L::F, w: L::F) -> L::F {
    a + w * (b - a)
}

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
    inverse: [L::F; 3],
    forward: [L::M; 3],
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

    /// First and end of the steps whose samples lie in the cells of `own`.
    #[inline(always)]
    fn steps_in(&self, own: &OwnCells) -> (L::I, L::I) {
        let (entry, delta) = (self.entry.map(SimdF32::to_array), self.delta.map(SimdF32::to_array));
        let (mut first, mut steps, last_at) = (self.first.to_array(), self.steps.to_array(), self.last_at.to_array());
        own.restrict(&entry, &delta, &last_at, (&mut first, &mut steps));
        (L::I::from_array(first), L::I::from_array(steps))
    }

    /// The point `t` steps from the entry, in units of sample points.
    #[inline(always)]
    pub(super) fn at(&self, t: L::F) -> [L::F; 3] {
        axes!(a => self.entry[a] + t * self.delta[a])
    }

    /// Position of sample `step`, in units of sample points.
    #[inline(always)]
    fn position(&self, step: L::I) -> [L::F; 3] {
        // The middle of a shortened last step comes before that of a full one.
        self.at((L::F::from(step) + L::F::splat(0.5)).min(self.last_at))
    }
}
