//! Empty-space map: for every brick of 4 x 4 x 4 cells, its distance in bricks to the nearest visible one.
//!
//! Interpolation stays within the least and greatest voxel that a brick's cells touch, so a brick whose range the transfer
//! function leaves transparent is empty. Distances are Chebyshev's: all bricks nearer than d on every axis are empty.

use super::stored::Scalar;
use rayon::prelude::*;

/// Cells per side of a brick.
pub(crate) const BRICK: usize = 4;
/// Largest distance stored, bricks.
pub(crate) const FARTHEST: u8 = 15;

/// Distances to the nearest visible brick, x fastest.
#[derive(Debug)]
pub struct EmptySpaceMap {
    /// The first brick, in the whole grid's: bricks are those of the whole grid, also where a part of it is stored.
    first: [usize; 3],
    dims: [usize; 3],
    distances: Vec<u8>,
}

impl EmptySpaceMap {
    /// The map of `voxels`, `points` per axis from point `start` of a grid on, where `shows(lo, hi)` tells whether any value from `lo` to `hi` is visible. With `beside`,
    /// neighbors of visible bricks count as visible too.
    pub fn new<V: Scalar>(
        (start, points): ([usize; 3], [usize; 3]),
        voxels: &[V],
        beside: bool,
        shows: impl Fn(f32, f32) -> bool + Sync,
    ) -> Self {
        // Cells are one fewer than voxels.
        let first = start.map(|s| s / BRICK);
        let dims = std::array::from_fn(|a| (start[a] + (points[a] - 1).max(1)).div_ceil(BRICK) - first[a]);
        let visible = visible((start, points), dims, voxels, shows);
        let mut distances = distances(dims, visible);
        if beside {
            distances.iter_mut().for_each(|d| *d = d.saturating_sub(1));
        }
        Self { first, dims, distances }
    }

    /// The first brick, in the whole grid's.
    pub fn first(&self) -> [usize; 3] {
        self.first
    }
    /// Number of bricks per axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }
    /// Distance from each brick to the nearest visible one, in bricks; 0 for a visible brick, at most [`FARTHEST`].
    pub fn distances(&self) -> &[u8] {
        &self.distances
    }
    /// True if the brick around `index` (units of sample points, inside the grid) may show something.
    #[inline]
    pub fn is_visible(&self, index: glam::DVec3) -> bool {
        let brick = |a: usize| (index[a].max(0.0) as usize / BRICK).saturating_sub(self.first[a]).min(self.dims[a] - 1);
        self.distances[(brick(2) * self.dims[1] + brick(1)) * self.dims[0] + brick(0)] == 0
    }
}

/// 1 for every brick that may be visible, else 0.
fn visible<V: Scalar>(
    (start, [nx, ny, nz]): ([usize; 3], [usize; 3]),
    [bx, by, bz]: [usize; 3],
    voxels: &[V],
    shows: impl Fn(f32, f32) -> bool + Sync,
) -> Vec<u8> {
    // The points that the cells of brick `n` touch on axis `a`, of `count`.
    let touched = |a: usize, n: usize, count: usize| {
        let begin = ((start[a] / BRICK + n) * BRICK).saturating_sub(start[a]);
        begin..count.min(((start[a] / BRICK + n + 1) * BRICK + 1).saturating_sub(start[a]))
    };
    let mut bricks = vec![0; bx * by * bz];
    let init = || (vec![0.0_f32; nx], vec![0.0_f32; nx]);
    bricks.par_chunks_mut(bx).enumerate().for_each_init(init, |(lows, highs), (row, out)| {
        let (ys, zs) = (touched(1, row % by, ny), touched(2, row / by, nz));
        lows.fill(f32::INFINITY);
        highs.fill(f32::NEG_INFINITY);
        for (k, j) in zs.flat_map(|k| ys.clone().map(move |j| (k, j))) {
            let start = (k * ny + j) * nx;
            for ((lo, hi), v) in lows.iter_mut().zip(highs.iter_mut()).zip(&voxels[start..start + nx]) {
                // NaN fails both comparisons.
                let v = v.narrow();
                *lo = if v < *lo { v } else { *lo };
                *hi = if v > *hi { v } else { *hi };
            }
        }
        for (b, brick) in out.iter_mut().enumerate() {
            let touched = touched(0, b, nx);
            let lo = lows[touched.clone()].iter().copied().fold(f32::INFINITY, f32::min);
            let hi = highs[touched].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            // A brick without a finite value is empty.
            *brick = u8::from(lo <= hi && shows(lo, hi));
        }
    });
    bricks
}

/// Dilates the visible set by one brick in all directions repeatedly; a brick's distance is the number of dilations that it
/// takes to reach it.
fn distances(dims: [usize; 3], visible: Vec<u8>) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let mut distances = vec![0; visible.len()];
    let (mut reached, mut next) = (visible, vec![0; distances.len()]);
    for _ in 0..FARTHEST {
        let left = distances.par_iter_mut().zip(&reached).map(|(d, r)| {
            *d += 1 - r;
            usize::from(1 - r)
        });
        if left.sum::<usize>() == 0 {
            break;
        }
        next.par_chunks_mut(nx).zip(reached.par_chunks(nx)).for_each(|(out, row)| {
            or(out, [row]);
            or(&mut out[1..], [row]);
            or(out, [&row[1..]]);
        });
        // `next` is grown along x; grow along y into `reached`, along z back.
        let neighbors = |n: usize, len: usize| n.saturating_sub(1)..len.min(n + 2);
        reached.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let (y, z) = (row % ny, row / ny);
            or(out, neighbors(y, ny).map(|j| &next[(z * ny + j) * nx..][..nx]));
        });
        next.par_chunks_mut(nx * ny).enumerate().for_each(|(z, out)| {
            or(out, neighbors(z, nz).map(|k| &reached[k * nx * ny..][..nx * ny]));
        });
        std::mem::swap(&mut reached, &mut next);
    }
    distances
}

fn or<'a>(out: &mut [u8], sources: impl IntoIterator<Item = &'a [u8]>) {
    for source in sources {
        out.iter_mut().zip(source).for_each(|(o, s)| *o |= s);
    }
}
