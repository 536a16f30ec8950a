//! Ray marching, eight rays at a time; counterpart of `reference/march.rs`.
//!
//! Lanes advance independently: those in empty bricks jump to the first sample beyond, those in visible bricks take the
//! samples up to the nearest brick boundary.

use super::own_cells::OwnCells;
use super::rays::{RayPacket, axes};
use crate::Field;
use crate::volume::occupancy::BRICK;
use crate::volume::stored::StoredVoxels;
use crate::volume::transfer_lut::TransferLut;
use half::f16;
use lamina_compute::simd::{Lanes, Pair, SimdF32, SimdI32, SimdMask, WIDTH};

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
pub(super) struct VolumeSampler<'a> {
    corners: VoxelCorners<'a>,
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

/// The voxels from the first one on, from the second row, the second slice, and the second row of the second slice. Kernels
/// branch on the type at run time: one kernel for all types is as fast as one for each, and compiles in a third of the time.
enum VoxelCorners<'a> {
    U8([&'a [u8]; 4]),
    U16([&'a [u16]; 4]),
    F16([&'a [f16]; 4]),
    F32([&'a [f32]; 4]),
}

impl<'a> VoxelCorners<'a> {
    fn new(voxels: &'a StoredVoxels, dims: [usize; 3]) -> Self {
        match voxels {
            StoredVoxels::U8(v) => Self::U8(corners(v, dims)),
            StoredVoxels::U16(v) => Self::U16(corners(v, dims)),
            StoredVoxels::F16(v) => Self::F16(corners(v, dims)),
            StoredVoxels::F32(v) => Self::F32(corners(v, dims)),
        }
    }
}

fn corners<V>(voxels: &[V], [nx, ny, nz]: [usize; 3]) -> [&[V]; 4] {
    assert!(voxels.len() == nx * ny * nz);
    [0, 1, ny, ny + 1].map(|row| &voxels[row * nx..])
}

impl<'a> VolumeSampler<'a> {
    /// A sampler of `field`, which must [fit](fits).
    pub(super) fn new(field: &'a Field, table: &'a TransferLut) -> Self {
        let (scale, offset) = field.unit_from_stored();
        let rows = table.bins() as f64;
        let offset = (offset * rows + f64::from(table.below)) as f32;
        let corners = VoxelCorners::new(field.stored(), field.grid_part().dims());
        Self::scaled(field, corners, table, [(scale * rows) as f32, offset])
    }

    /// A sampler of other voxels, in units of the kernels, on the grid of `field`, which must [fit](fits).
    pub(super) fn of_units(field: &'a Field, voxels: &'a [f32], table: &'a TransferLut) -> Self {
        Self::scaled(field, VoxelCorners::F32(corners(voxels, field.grid_part().dims())), table, [1.0, 0.0])
    }

    /// Samples are `scale` times those of the voxels plus `offset`.
    fn scaled(field: &'a Field, corners: VoxelCorners<'a>, table: &'a TransferLut, [scale, offset]: [f32; 2]) -> Self {
        let (part, dims) = (field.grid_part(), field.grid_part().dims());
        let (start, bricks) = (part.start(), field.empty_space());
        assert!(fits(field));
        Self {
            corners,
            first: start.map(|s| s as f32),
            last: std::array::from_fn(|a| ((start[a] + dims[a] - 1) as f32).next_down()),
            huge: dims.iter().product::<usize>() >= 1 << 31,
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
        match &self.corners {
            VoxelCorners::U8(corners) => self.sample_of::<L, u8>(corners, p),
            VoxelCorners::U16(corners) => self.sample_of::<L, u16>(corners, p),
            VoxelCorners::F16(corners) => self.sample_of::<L, f16>(corners, p),
            VoxelCorners::F32(corners) => self.sample_of::<L, f32>(corners, p),
        }
    }

    /// [`Self::sample`] at the steps from `step` on, one each of `at`.
    #[inline(always)]
    fn sample_run<L: Lanes>(&self, packet: &RayPacket<L>, step: L::I, at: &mut [L::F]) {
        match &self.corners {
            VoxelCorners::U8(corners) => self.sample_run_of::<L, u8>(corners, packet, step, at),
            VoxelCorners::U16(corners) => self.sample_run_of::<L, u16>(corners, packet, step, at),
            VoxelCorners::F16(corners) => self.sample_run_of::<L, f16>(corners, packet, step, at),
            VoxelCorners::F32(corners) => self.sample_run_of::<L, f32>(corners, packet, step, at),
        }
    }

    #[inline(always)]
    fn sample_run_of<L: Lanes, V: Pair>(
        &self,
        corners: &[&[V]; 4],
        packet: &RayPacket<L>,
        step: L::I,
        at: &mut [L::F],
    ) {
        for (k, at) in at.iter_mut().enumerate() {
            *at = self.sample_of::<L, V>(corners, packet.position(step + L::I::splat(k as i32)));
        }
    }

    #[inline(always)]
    fn sample_of<L: Lanes, V: Pair>(&self, corners: &[&[V]; 4], p: [L::F; 3]) -> L::F {
        let (cell, w) = self.cell::<L>(p);
        let in_slice = cell[1] * L::I::splat(self.row as i32) + cell[0];
        let index = if self.huge {
            let (z, in_slice) = (cell[2].to_indices(), in_slice.to_indices());
            std::array::from_fn(|l| z[l] * self.slice + in_slice[l] - self.before)
        } else {
            (cell[2] * L::I::splat(self.slice as i32) + in_slice - L::I::splat(self.before as i32)).to_indices()
        };
        let mut edges = [L::F::splat(0.0); 4];
        for (edge, voxels) in edges.iter_mut().zip(corners) {
            // SAFETY: positions are clamped below the last sample point, so cells are at most dims - 2 on every axis, and an
            // index plus a row, a slice, or both, plus one, is that of a voxel.
            #[expect(unsafe_code, reason = "indices were clamped at once, in `cell`")]
            let (a, b) = unsafe { L::pairs(voxels, &index) };
            *edge = lerp::<L>(a, b, w[0]);
        }
        let near = lerp::<L>(edges[0], edges[1], w[1]);
        let far = lerp::<L>(edges[2], edges[3], w[1]);
        lerp::<L>(near, far, w[2]) * L::F::splat(self.scale) + L::F::splat(self.offset)
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
        let packet = &match &self.own {
            None => *packet,
            Some(own) => packet.within(own),
        };
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
                self.sample_run(packet, step, &mut at[..count]);
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
