//! Where rays may skip: for every brick of 4 x 4 x 4 cells, how many bricks away the nearest one is that shows something.
//!
//! Interpolation stays within the least and greatest voxel that a brick's cells touch, so a brick whose range the transfer
//! function leaves transparent is empty. Distances are Chebyshev's: all bricks nearer than d on every axis are empty.

use half::f16;
use lamina_model::Grid;
use rayon::prelude::*;

/// Cells per side of a brick.
pub const BRICK: usize = 4;
/// The greatest distance stored, bricks.
pub const FARTHEST: u8 = 15;

/// Distances, brick by brick, x fastest.
#[derive(Debug)]
pub struct SkipMap {
    dims: [usize; 3],
    distances: Vec<u8>,
}

/// A scalar that voxels are stored as; both conversions are exact.
pub trait Scalar: Copy + Send + Sync + Into<f32> + Into<f64> {
    /// In double precision.
    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }
    /// In single precision.
    #[inline(always)]
    fn narrow(self) -> f32 {
        self.into()
    }
}

impl Scalar for u8 {}
impl Scalar for u16 {}
impl Scalar for f16 {}
impl Scalar for f32 {}

impl SkipMap {
    /// The map of `voxels` on `grid`, where `shows(lo, hi)` says whether anything from `lo` to `hi` is visible. With
    /// `beside`, bricks beside a visible one count as visible too.
    pub fn new<V: Scalar>(grid: &Grid, voxels: &[V], beside: bool, shows: impl Fn(f32, f32) -> bool + Sync) -> Self {
        // Cells are one fewer than voxels.
        let dims = grid.dims().map(|d| (d - 1).max(1).div_ceil(BRICK));
        let visible = visible(grid, dims, voxels, shows);
        let mut distances = distances(dims, visible);
        if beside {
            distances.iter_mut().for_each(|d| *d = d.saturating_sub(1));
        }
        Self { dims, distances }
    }

    /// Bricks per axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }
    /// Bricks from each brick to the nearest visible one, 0 if itself is; [`FARTHEST`] means that or more.
    pub fn distances(&self) -> &[u8] {
        &self.distances
    }
    /// True if the brick around `index` (units of sample points, inside the grid) may show something.
    #[inline]
    pub fn is_visible(&self, index: glam::DVec3) -> bool {
        let brick = |x: f64, n: usize| (x.max(0.0) as usize / BRICK).min(n - 1);
        let [nx, ny, nz] = self.dims;
        self.distances[(brick(index.z, nz) * ny + brick(index.y, ny)) * nx + brick(index.x, nx)] == 0
    }
}

/// 1 for every brick that may show something, else 0.
fn visible<V: Scalar>(
    grid: &Grid,
    [bx, by, bz]: [usize; 3],
    voxels: &[V],
    shows: impl Fn(f32, f32) -> bool + Sync,
) -> Vec<u8> {
    let [nx, ny, nz] = grid.dims();
    let mut bricks = vec![0; bx * by * bz];
    let init = || (vec![0.0_f32; nx], vec![0.0_f32; nx]);
    bricks.par_chunks_mut(bx).enumerate().for_each_init(init, |(lows, highs), (row, out)| {
        let (y, z) = (row % by * BRICK, row / by * BRICK);
        lows.fill(f32::INFINITY);
        highs.fill(f32::NEG_INFINITY);
        for (k, j) in (z..nz.min(z + BRICK + 1)).flat_map(|k| (y..ny.min(y + BRICK + 1)).map(move |j| (k, j))) {
            let start = (k * ny + j) * nx;
            for ((lo, hi), v) in lows.iter_mut().zip(highs.iter_mut()).zip(&voxels[start..start + nx]) {
                // NaN changes neither.
                let v = v.narrow();
                *lo = if v < *lo { v } else { *lo };
                *hi = if v > *hi { v } else { *hi };
            }
        }
        for (b, brick) in out.iter_mut().enumerate() {
            let touched = b * BRICK..nx.min((b + 1) * BRICK + 1);
            let lo = lows[touched.clone()].iter().copied().fold(f32::INFINITY, f32::min);
            let hi = highs[touched].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            // A range without a finite value stays empty, and shows nothing.
            *brick = u8::from(lo <= hi && shows(lo, hi));
        }
    });
    bricks
}

/// Grows the visible set by one brick in all directions again and again; the distance is how often it takes.
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
        let neighbours = |n: usize, len: usize| n.saturating_sub(1)..len.min(n + 2);
        reached.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let (y, z) = (row % ny, row / ny);
            or(out, neighbours(y, ny).map(|j| &next[(z * ny + j) * nx..][..nx]));
        });
        next.par_chunks_mut(nx * ny).enumerate().for_each(|(z, out)| {
            or(out, neighbours(z, nz).map(|k| &reached[k * nx * ny..][..nx * ny]));
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
