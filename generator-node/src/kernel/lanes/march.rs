//! Eight rays through the field: the fast twin of `scalar::march`.
//!
//! Positions are single precision, in units of sample points from the ray's entry into the box, which itself is found in
//! double precision by the same code as the oracle's. Lanes advance each at its own pace: those in empty bricks jump to
//! the first sample beyond, those in visible ones take the samples up to the nearest brick boundary.

use super::{Floats, Ints, Lanes, Masks, Pair, WIDTH};
use crate::kernel::skip::BRICK;
use crate::kernel::{Field, table::TransferTable};
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

/// What a sample is handed to.
pub trait Visit<L: Lanes> {
    /// Sample `value` (a position in the transfer function's range) of step `step` for the lanes in `live`; says which of
    /// them go on.
    fn visit(&mut self, packet: &Packet<L>, step: L::I, value: L::F, live: L::M) -> L::M;
}

/// A field as kernels read it.
pub struct View<'a, V> {
    voxels: &'a [V],
    /// Greatest position and cell on each axis.
    last: [f32; 3],
    last_cell: [i32; 3],
    row: usize,
    slice: usize,
    scale: f32,
    offset: f32,
    bricks: [i32; 3],
    distances: &'a [u8],
    field: &'a Field,
    /// The transfer function for this step length.
    pub table: &'a TransferTable,
    step_length: f64,
}

/// True if eight lanes can march `field`: every axis has a cell, and cells and bricks of a slice can be numbered in 31 bits.
pub fn fits(field: &Field) -> bool {
    let ([nx, ny, nz], bricks) = (field.grid().dims(), field.skip().distances().len());
    nx.min(ny).min(nz) >= 2 && nx * ny < 1 << 31 && bricks < 1 << 31
}

impl<'a, V: Pair> View<'a, V> {
    /// `voxels` are `field`'s, and the field [`fits`].
    pub fn new(field: &'a Field, voxels: &'a [V], table: &'a TransferTable, step_length: f64) -> Self {
        let dims = field.grid().dims();
        assert!(fits(field) && voxels.len() == dims.iter().product::<usize>());
        let (scale, offset) = field.unit_from_stored();
        Self {
            voxels,
            last: dims.map(|n| (n - 1) as f32),
            last_cell: dims.map(|n| n as i32 - 2),
            row: dims[0],
            slice: dims[0] * dims[1],
            scale: scale as f32,
            offset: offset as f32,
            bricks: field.skip().dims().map(|n| n as i32),
            distances: field.skip().distances(),
            field,
            table,
            step_length,
        }
    }

    /// Colour behind everything.
    pub fn background(&self) -> [f32; 3] {
        self.field.scene().background
    }

    /// The cells around a position, and where in them it lies.
    #[inline(always)]
    fn cell<L: Lanes>(&self, p: [L::F; 3]) -> ([L::I; 3], [L::F; 3]) {
        let x = axes!(a => p[a].max(L::F::splat(0.0)).min(L::F::splat(self.last[a])));
        let cell = axes!(a => x[a].to_int().min(L::I::splat(self.last_cell[a])));
        (cell, axes!(a => x[a] - L::F::from(cell[a])))
    }

    /// The trilinear value.
    #[inline(always)]
    fn sample<L: Lanes>(&self, p: [L::F; 3]) -> L::F {
        let (cell, w) = self.cell::<L>(p);
        let in_slice = (cell[1] * L::I::splat(self.row as i32) + cell[0]).to_array();
        let z = cell[2].to_array();
        let index: [usize; WIDTH] = std::array::from_fn(|l| z[l] as usize * self.slice + in_slice[l] as usize);
        let near = lerp::<L>(self.along_x::<L>(0, &index, w[0]), self.along_x::<L>(self.row, &index, w[0]), w[1]);
        let (slice, row) = (self.slice, self.slice + self.row);
        let far = lerp::<L>(self.along_x::<L>(slice, &index, w[0]), self.along_x::<L>(row, &index, w[0]), w[1]);
        lerp::<L>(near, far, w[2]) * L::F::splat(self.scale) + L::F::splat(self.offset)
    }

    /// Between the voxels at `start + index` and their right neighbours; `start` is 0, a row, a slice, or both.
    #[inline(always)]
    fn along_x<L: Lanes>(&self, start: usize, index: &[usize; WIDTH], w: L::F) -> L::F {
        // SAFETY: cells are at most dims - 2 on every axis, so with the row, slice, or both added, and one more, an index
        // is that of a voxel.
        #[expect(unsafe_code, reason = "indices were clamped at once, in `cell`")]
        let (a, b) = unsafe { L::pairs(&self.voxels[start..], index) };
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
        let distance = L::I::from_array(number.to_array().map(|n| self.distances[n as usize].into()));
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
        let mut step = L::I::splat(0);
        let mut live = packet.steps.gt(step);
        while live.any() {
            let (distance, run) = self.run(packet, packet.position(step));
            let visible = live & distance.eq(L::I::splat(0));
            if visible.any() {
                let shared = L::I::select(visible, run, L::I::splat(i32::MAX));
                let mut left = shared.to_array().into_iter().min().unwrap_or(0);
                let mut active = visible;
                while left > 0 && active.any() {
                    let value = self.sample::<L>(packet.position(step));
                    let on = visit.visit(packet, step, value, active);
                    // Lanes that end here leave `live`, lanes not active now stay as they are.
                    live = live & (on | !active);
                    step = step + L::I::select(active, L::I::splat(1), L::I::splat(0));
                    active = active & on & packet.steps.gt(step);
                    left -= 1;
                }
            }
            step = step + L::I::select(visible, L::I::splat(0), run);
            live = live & packet.steps.gt(step);
        }
    }
}

/// From `a` to `b`.
#[inline(always)]
fn lerp<L: Lanes>(a: L::F, b: L::F, w: L::F) -> L::F {
    a + w * (b - a)
}

/// Eight rays, clipped to the box.
pub struct Packet<L: Lanes> {
    /// Samples of each ray; 0 for a ray that misses.
    pub steps: L::I,
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
    /// The rays of up to eight `pixels` of a picture of `width` x `height`.
    #[inline(always)]
    pub fn new<V: Pair>(view: &View<V>, camera: &Camera, [width, height]: [u32; 2], pixels: &[(u32, u32)]) -> Self {
        let mut steps = [0; WIDTH];
        let (mut last_length, mut last_at) = ([1.0; WIDTH], [0.0; WIDTH]);
        let (mut entry, mut delta) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3]);
        let (bounds, spacing) = (view.field.grid().bounds(), view.field.grid().spacing());
        for (l, &(i, j)) in pixels.iter().enumerate().take(WIDTH) {
            let ray = camera.pixel_ray(i, j, width, height);
            let Some((t_in, t_out)) = bounds.clip(&ray) else { continue };
            let n = vdi::steps(t_out - t_in, view.step_length);
            let rest = (t_out - t_in) / view.step_length - f64::from(n.saturating_sub(1));
            steps[l] = n as i32;
            last_length[l] = rest.min(1.0) as f32;
            last_at[l] = (f64::from(n.saturating_sub(1)) + 0.5 * rest.min(1.0)) as f32;
            let (start, d) = (view.field.index_from_world(ray.at(t_in)), ray.direction / spacing * view.step_length);
            for a in 0..3 {
                (entry[a][l], delta[a][l]) = (start[a] as f32, d[a] as f32);
            }
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
            steps,
            last: steps - L::I::splat(1),
            last_length,
            last_at: L::F::from_array(last_at),
            entry: axes!(a => L::F::from_array(entry[a])),
            delta,
            inverse,
            forward: axes!(a => zero.lt(inverse[a])),
        }
    }

    /// Where sample `step` lies, in units of sample points.
    #[inline(always)]
    fn position(&self, step: L::I) -> [L::F; 3] {
        // The middle of the last step comes before that of a whole one.
        let at = (L::F::from(step) + L::F::splat(0.5)).min(self.last_at);
        axes!(a => self.entry[a] + at * self.delta[a])
    }
}
