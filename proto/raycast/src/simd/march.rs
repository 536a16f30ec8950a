//! Eight rays through the field: the fast twin of `scalar::march`.
//!
//! Positions are single precision, in units of sample points from the ray's entry into the box, which itself is found in
//! double precision by the same code as the oracle's. Lanes advance each at its own pace: those in empty bricks jump to
//! the first sample beyond, those in visible ones take the samples up to the nearest brick boundary.

use crate::Field;
use crate::volume::occupancy::BRICK;
use crate::volume::transfer_lut::TransferTable;
use glam::DVec3;
use lamina_compute::simd::{Floats, Ints, Lanes, Masks, Pair, WIDTH};
use lamina_model::{Camera, vdi};

/// An expression for each axis. Not a closure: a closure is a function of its own, which the compiler may fail to inline
/// into the one that enables the instructions, and then every operation is a call.
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

/// Samples handed over at once, at most.
const MOST: usize = 16;

/// What samples are handed to.
pub trait Visit<L: Lanes> {
    /// The samples from step `step` on, as their positions `at` in the rows of the transfer table, for the lanes in `live`;
    /// says which of them go on. Steps beyond a ray's last are to be passed over.
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<L>, step: L::I, at: &[L::F], live: L::M) -> L::M {
        let (mut step, mut live) = (step, live);
        for &at in at {
            live = self.sample(packet, step, at, live & packet.steps.gt(step));
            step = step + L::I::splat(1);
        }
        live
    }

    /// One of them.
    fn sample(&mut self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> L::M;
}

/// A field as kernels read it.
pub struct View<'a, V> {
    /// The voxels from the first one on, from the second row, the second slice, and the second row of the second slice.
    corners: [&'a [V]; 4],
    /// Greatest position on each axis: a hair below the last sample point, so that its cell is the last one.
    last: [f32; 3],
    /// True if 31 bits do not number the voxels.
    huge: bool,
    row: usize,
    slice: usize,
    /// From stored scalars to samples: rows of the table.
    scale: f32,
    offset: f32,
    bricks: [i32; 3],
    distances: &'a [u8],
    /// The transfer function for this step length.
    pub table: &'a TransferTable,
}

/// True if eight lanes can march `field`: every axis has a cell, and positions, slices and bricks keep to 24, 31 and 31 bits.
pub fn fits(field: &Field) -> bool {
    let ([nx, ny, nz], bricks) = (field.grid().dims(), field.skip().distances().len());
    nx.min(ny).min(nz) >= 2 && nx.max(ny).max(nz) < 1 << 24 && nx * ny < 1 << 31 && bricks < 1 << 31
}

impl<'a, V: Pair> View<'a, V> {
    /// `voxels` are `field`'s, and the field [`fits`].
    pub fn new(field: &'a Field, voxels: &'a [V], table: &'a TransferTable) -> Self {
        let (scale, offset) = field.unit_from_stored();
        let rows = table.bins() as f64;
        let offset = (offset * rows + f64::from(table.below)) as f32;
        Self::scaled(field, voxels, table, [(scale * rows) as f32, offset])
    }

    /// Other voxels on the grid of `field`, which [`fits`]: samples are `scale` times theirs plus `offset`.
    pub fn scaled(field: &'a Field, voxels: &'a [V], table: &'a TransferTable, [scale, offset]: [f32; 2]) -> Self {
        let dims = field.grid().dims();
        assert!(fits(field) && voxels.len() == dims.iter().product::<usize>());
        Self {
            corners: [0, 1, dims[1], dims[1] + 1].map(|row| &voxels[row * dims[0]..]),
            last: dims.map(|n| ((n - 1) as f32).next_down()),
            huge: voxels.len() >= 1 << 31,
            row: dims[0],
            slice: dims[0] * dims[1],
            scale,
            offset,
            bricks: field.skip().dims().map(|n| n as i32),
            distances: field.skip().distances(),
            table,
        }
    }

    /// The cells around a position, and where in them it lies.
    #[inline(always)]
    fn cell<L: Lanes>(&self, p: [L::F; 3]) -> ([L::I; 3], [L::F; 3]) {
        let x = axes!(a => p[a].max(L::F::splat(0.0)).min(L::F::splat(self.last[a])));
        let cell = axes!(a => x[a].to_int());
        (cell, axes!(a => x[a] - L::F::from(cell[a])))
    }

    /// The trilinear value, as a position in the rows of the table.
    #[inline(always)]
    pub fn sample<L: Lanes>(&self, p: [L::F; 3]) -> L::F {
        let (cell, w) = self.cell::<L>(p);
        let in_slice = cell[1] * L::I::splat(self.row as i32) + cell[0];
        let index = if self.huge {
            let (z, in_slice) = (cell[2].to_indices(), in_slice.to_indices());
            std::array::from_fn(|l| z[l] * self.slice + in_slice[l])
        } else {
            (cell[2] * L::I::splat(self.slice as i32) + in_slice).to_indices()
        };
        let near = lerp::<L>(self.along_x::<L>(0, &index, w[0]), self.along_x::<L>(1, &index, w[0]), w[1]);
        let far = lerp::<L>(self.along_x::<L>(2, &index, w[0]), self.along_x::<L>(3, &index, w[0]), w[1]);
        lerp::<L>(near, far, w[2]) * L::F::splat(self.scale) + L::F::splat(self.offset)
    }

    /// Between the voxels at `index` of a corner and their right neighbours.
    #[inline(always)]
    fn along_x<L: Lanes>(&self, corner: usize, index: &[usize; WIDTH], w: L::F) -> L::F {
        // SAFETY: positions are clamped below the last sample point, so cells are at most dims - 2 on every axis; with a
        // row, a slice, or both added, and one more, an index is that of a voxel.
        #[expect(unsafe_code, reason = "indices were clamped at once, in `cell`")]
        let (a, b) = unsafe { L::pairs(self.corners[corner], index) };
        lerp::<L>(a, b, w)
    }

    /// Bricks to the nearest visible one (0: here), and how many samples from this one on lie in the empty cube, or in the
    /// visible brick.
    #[inline(always)]
    fn run<L: Lanes>(&self, packet: &Packet<L>, p: [L::F; 3]) -> (L::I, L::I) {
        let (cell, _) = self.cell::<L>(p);
        let brick = axes!(a => cell[a].shr::<2>());
        let [bx, by, _] = self.bricks;
        let number = (brick[2] * L::I::splat(by) + brick[1]) * L::I::splat(bx) + brick[0];
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

    /// Hands all samples that may show something to `visit`, each ray front to back.
    #[inline(always)]
    pub fn march<L: Lanes>(&self, packet: &Packet<L>, visit: &mut impl Visit<L>) {
        let mut step = packet.first;
        let mut live = packet.steps.gt(step);
        let mut ahead = self.run(packet, packet.position(step));
        while live.any() {
            let (distance, run) = ahead;
            let visible = live & distance.eq(L::I::splat(0));
            // Samples beyond a lane's brick do no harm, they are looked up like others: all go as far as the farthest.
            let shared = L::I::select(visible, run, L::I::splat(0)).greatest().min(MOST as i32);
            let next = step + L::I::select(visible, L::I::splat(shared), run);
            // Looked up before it is needed: its latency passes while the samples below are taken.
            ahead = self.run(packet, packet.position(next));
            if visible.any() {
                // First all positions in the table, then what is done with them: each loop keeps its numbers in registers.
                let mut at = [L::F::splat(0.0); MOST];
                let count = shared as usize;
                for (k, at) in at.iter_mut().enumerate().take(count) {
                    *at = self.sample::<L>(packet.position(step + L::I::splat(k as i32)));
                }
                // Lanes that end here leave `live`, lanes not active now stay as they are.
                live = live & (visit.visit(packet, step, &at[..count], visible) | !visible);
            }
            step = next;
            live = live & packet.steps.gt(step);
        }
    }
}

/// From `a` to `b`.
#[inline(always)]
fn lerp<L: Lanes>(a: L::F, b: L::F, w: L::F) -> L::F {
    a + w * (b - a)
}

/// A camera's picture, in units of sample points.
pub struct Lens {
    /// In units of sample points.
    pub eye: [f64; 3],
    /// Per axis, whether the eye is between the box's faces or on one, told in the world as the oracle does.
    beside: [bool; 3],
    last: [f64; 3],
    per_spacing: [f64; 3],
    per_step: f64,
    /// World direction of the ray through the first pixel, not normalised, and what a column and a row add to it.
    corner: [f64; 3],
    right: [f64; 3],
    down: [f64; 3],
}

impl Lens {
    /// The picture of `width` x `height` pixels, sampled every `step_length`.
    pub fn new(field: &Field, camera: &Camera, [width, height]: [u32; 2], step_length: f64) -> Self {
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

impl Lens {
    /// World direction of the ray through a pixel, not normalised.
    pub fn direction(&self, i: u32, j: u32) -> DVec3 {
        DVec3::from_array(self.corner)
            + f64::from(i) * DVec3::from_array(self.right)
            + f64::from(j) * DVec3::from_array(self.down)
    }

    /// A world direction in units of sample points.
    pub fn per_spacing(&self, world: DVec3) -> DVec3 {
        world * DVec3::from_array(self.per_spacing)
    }

    /// Steps in the length of a direction.
    pub fn rate(&self, world: DVec3) -> f64 {
        world.length() * self.per_step
    }
}

/// Eight rays, clipped to the box.
pub struct Packet<L: Lanes> {
    /// The first sample of each ray that counts: 0, unless an effect cuts it off.
    pub first: L::I,
    /// Samples of each ray; 0 for a ray that misses.
    pub steps: L::I,
    /// Steps from the eye to the entry.
    pub entry_at: [f64; WIDTH],
    /// Number of the last sample.
    pub last: L::I,
    /// Length of the last step, as a share of a whole one.
    pub last_length: [f32; WIDTH],
    /// Middle of the last step, in steps from the entry.
    last_at: L::F,
    entry: [L::F; 3],
    delta: [L::F; 3],
    inverse: [L::F; 3],
    forward: [L::M; 3],
}

impl<L: Lanes> Packet<L> {
    /// The rays of up to eight `pixels` of a picture.
    ///
    /// In units of sample points the box is 0..dims - 1; the arithmetic is double precision in plain loops, which the
    /// compiler turns into lanes of its own.
    #[inline(always)]
    pub fn new(lens: &Lens, pixels: &[(u32, u32)]) -> Self {
        let (mut i, mut j) = ([0.0; WIDTH], [0.0; WIDTH]);
        for (l, pixel) in pixels.iter().enumerate().take(WIDTH) {
            (i[l], j[l]) = (f64::from(pixel.0), f64::from(pixel.1));
        }
        let (mut near, mut far, mut square) = ([0.0; WIDTH], [f64::MAX; WIDTH], [0.0; WIDTH]);
        let mut direction = [[0.0; WIDTH]; 3];
        for (a, direction) in direction.iter_mut().enumerate() {
            // A ray that does not move along an axis is inside that slab for ever, or never.
            let still = if lens.beside[a] { [f64::MIN, f64::MAX] } else { [f64::MAX, f64::MIN] };
            for l in 0..WIDTH {
                let world = lens.corner[a] + i[l] * lens.right[a] + j[l] * lens.down[a];
                let d = world * lens.per_spacing[a];
                square[l] += world * world;
                direction[l] = d;
                let inverse = 1.0 / d;
                let (s, t) = ((0.0 - lens.eye[a]) * inverse, (lens.last[a] - lens.eye[a]) * inverse);
                let (s, t) = if s < t { (s, t) } else { (t, s) };
                let (s, t) = if d == 0.0 { (still[0], still[1]) } else { (s, t) };
                near[l] = if s > near[l] { s } else { near[l] };
                far[l] = if t < far[l] { t } else { far[l] };
            }
        }
        let (mut steps, mut last_length, mut last_at) = ([0; WIDTH], [1.0; WIDTH], [0.0; WIDTH]);
        let (mut entry, mut delta, mut entry_at) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3], [0.0; WIDTH]);
        for l in 0..WIDTH {
            // Steps per unit of the direction's length.
            let rate = square[l].sqrt() * lens.per_step;
            let length = if far[l] > near[l] { (far[l] - near[l]) * rate } else { 0.0 };
            let n = (length - vdi::STEP_ROUNDING).ceil().max(0.0);
            let rest = (length - (n - 1.0)).min(1.0);
            steps[l] = n as i32;
            entry_at[l] = near[l] * rate;
            last_length[l] = rest as f32;
            last_at[l] = (n - 1.0 + 0.5 * rest) as f32;
            for a in 0..3 {
                entry[a][l] = (lens.eye[a] + near[l] * direction[a][l]) as f32;
                delta[a][l] = (direction[a][l] / rate) as f32;
            }
        }
        for count in steps.iter_mut().skip(pixels.len()) {
            *count = 0;
        }
        let steps = L::I::from_array(steps);
        let delta = axes!(a => L::F::from_array(delta[a]));
        let zero = L::F::splat(0.0);
        // A ray that does not move along an axis never leaves a brick there.
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

    /// The point `t` steps from the entry, in units of sample points.
    #[inline(always)]
    pub fn at(&self, t: L::F) -> [L::F; 3] {
        axes!(a => self.entry[a] + t * self.delta[a])
    }

    /// Where sample `step` lies, in units of sample points.
    #[inline(always)]
    fn position(&self, step: L::I) -> [L::F; 3] {
        // The middle of the last step comes before that of a whole one.
        self.at((L::F::from(step) + L::F::splat(0.5)).min(self.last_at))
    }
}
