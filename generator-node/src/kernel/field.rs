//! A volume made ready for sampling: every voxel mapped into the transfer function's range.
//!
//! The field drawn is the mapped one, interpolated trilinearly between sample points: under a logarithmic range that is
//! the logarithm of the data, so that a steep front keeps its decades. Voxels that are not finite are NaN here, and any
//! sample whose cell touches one is empty.

use glam::DVec3;
use lamina_model::{Grid, ScalarRange, TransferFunction, Volume, for_voxels};
use rayon::prelude::*;

/// Mapped voxels on their grid.
#[derive(Debug, Clone)]
pub struct Field {
    grid: Grid,
    values: Vec<f32>,
    empty_voxels: u64,
    /// Least and greatest finite value in each block of cells.
    blocks: Vec<[f32; 2]>,
}

/// Cells per side of a block.
const BLOCK: usize = 4;

/// Blocks per axis: cells are one fewer than voxels.
fn block_dims(grid: &Grid) -> [usize; 3] {
    grid.dims().map(|d| (d - 1).max(1).div_ceil(BLOCK))
}

/// Which blocks of cells show nothing under a transfer function.
pub struct Occupancy {
    dims: [usize; 3],
    visible: Vec<bool>,
}

impl Occupancy {
    /// True if the block around `index` (units of sample points, inside the grid) may show something.
    #[inline]
    pub fn is_visible(&self, index: DVec3) -> bool {
        let block = |x: f64, n: usize| (x.max(0.0) as usize / BLOCK).min(n - 1);
        let [nx, ny, nz] = self.dims;
        self.visible[(block(index.z, nz) * ny + block(index.y, ny)) * nx + block(index.x, nx)]
    }
}

impl Field {
    /// Maps every voxel of `volume` through `range`.
    #[expect(clippy::useless_conversion, reason = "one body for all voxel types, f64 among them")]
    pub fn new(volume: &Volume, range: &ScalarRange) -> Self {
        let values: Vec<f32> =
            for_voxels!(volume.voxels(), v => v.par_iter().map(|&x| range.unit_from_value(x.into())).collect());
        let empty_voxels = values.par_iter().filter(|v| v.is_nan()).count() as u64;
        let grid = *volume.grid();
        let blocks = block_ranges(&grid, &values);
        Self { grid, values, empty_voxels, blocks }
    }

    /// Which blocks `transfer` shows: a sample in any other is transparent, since interpolation stays within the block's
    /// range.
    pub fn occupancy(&self, transfer: &TransferFunction) -> Occupancy {
        // An empty range (no finite value) is never visible.
        let shows = |&[lo, hi]: &[f32; 2]| lo <= hi && !transfer.is_transparent(lo, hi);
        Occupancy { dims: block_dims(&self.grid), visible: self.blocks.par_iter().map(shows).collect() }
    }

    /// Where the voxels lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Voxels that are NaN or infinite in the data, drawn as empty.
    pub fn empty_voxels(&self) -> u64 {
        self.empty_voxels
    }

    /// `point` of the world in units of sample points.
    pub fn index_from_world(&self, point: DVec3) -> DVec3 {
        (point - self.grid.origin()) / self.grid.spacing()
    }

    /// The trilinear value at `index` (units of sample points), which is clamped into the grid.
    #[inline]
    pub fn sample(&self, index: DVec3) -> f32 {
        let dims = self.grid.dims();
        let mut base = 0;
        let mut stride = 1;
        let mut next = [0; 3];
        let mut w = [0.0_f32; 3];
        for axis in 0..3 {
            let last = dims[axis] - 1;
            let x = index[axis].clamp(0.0, last as f64);
            let cell = (x as usize).min(last.saturating_sub(1));
            w[axis] = (x - cell as f64) as f32;
            base += cell * stride;
            next[axis] = if last > 0 { stride } else { 0 };
            stride *= dims[axis];
        }
        let v = |i: usize| self.values[i];
        let lerp = |a: f32, b: f32, w: f32| a + w * (b - a);
        let along_x = |i: usize| lerp(v(i), v(i + next[0]), w[0]);
        let along_y = |i: usize| lerp(along_x(i), along_x(i + next[1]), w[1]);
        lerp(along_y(base), along_y(base + next[2]), w[2])
    }
}

/// Least and greatest finite value of the voxels that the cells of each block touch.
fn block_ranges(grid: &Grid, values: &[f32]) -> Vec<[f32; 2]> {
    let ([nx, ny, nz], [bx, by, bz]) = (grid.dims(), block_dims(grid));
    let range = |b: usize| {
        let (x, y, z) = (b % bx * BLOCK, b / bx % by * BLOCK, b / (bx * by) * BLOCK);
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for (k, j) in (z..nz.min(z + BLOCK + 1)).flat_map(|k| (y..ny.min(y + BLOCK + 1)).map(move |j| (k, j))) {
            let row = (k * ny + j) * nx;
            for &v in &values[row + x..row + nx.min(x + BLOCK + 1)] {
                // NaN changes neither.
                range = [range[0].min(v), range[1].max(v)];
            }
        }
        range
    };
    (0..bx * by * bz).into_par_iter().with_min_len(64).map(range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{ControlPoint, Scale, Voxels};

    fn field(dims: [usize; 3], f: impl Fn(usize, usize, usize) -> f32) -> Field {
        let mut v = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                v.extend((0..dims[0]).map(|x| f(x, y, z)));
            }
        }
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        Field::new(&Volume::new(grid, Voxels::F32(v)).unwrap(), &range)
    }

    #[test]
    fn a_trilinear_function_is_reproduced_and_clamped_at_the_faces() {
        let f = field([4, 3, 5], |x, y, z| {
            (x as f32) * 0.1 + (y as f32) * 0.2 - (z as f32) * 0.05 + (x * y * z) as f32 * 0.01
        });
        let exact = |p: DVec3| p.x * 0.1 + p.y * 0.2 - p.z * 0.05 + p.x * p.y * p.z * 0.01;
        for p in [DVec3::new(1.3, 0.7, 2.9), DVec3::new(3.0, 2.0, 4.0), DVec3::ZERO, DVec3::new(0.0, 1.5, 3.999)] {
            assert!((f64::from(f.sample(p)) - exact(p)).abs() < 1e-6);
        }
        assert_eq!(f.sample(DVec3::new(-5.0, 9.0, 7.0)), f.sample(DVec3::new(0.0, 2.0, 4.0)));
    }

    #[test]
    fn what_is_not_finite_is_counted_and_empties_the_cells_around_it() {
        let f = field([3, 3, 3], |x, y, z| if (x, y, z) == (0, 0, 0) { f32::INFINITY } else { 0.5 });
        assert_eq!(f.empty_voxels(), 1);
        assert!(f.sample(DVec3::splat(0.5)).is_nan());
        assert_eq!(f.sample(DVec3::splat(1.5)), 0.5);
    }

    #[test]
    fn no_block_that_shows_something_is_called_empty() {
        let f = field([11, 6, 9], |x, y, z| if (x, y, z) == (4, 5, 8) { 1.0 } else { 0.0 });
        let points = [(0.5, 0.0), (1.0, 1.0)].map(|(at, opacity)| ControlPoint { at, color: [1.0; 3], opacity });
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let transfer = TransferFunction::new(range, None, points.to_vec()).unwrap();
        let occupancy = f.occupancy(&transfer);
        let mut hidden = 0;
        for n in 0..11 * 6 * 9 * 8 {
            let p = DVec3::new((n % 22) as f64, (n / 22 % 12) as f64, (n / 264) as f64) * 0.5;
            let shows = transfer.at(f.sample(p)).1 > 0.0;
            assert!(!shows || occupancy.is_visible(p), "{p}");
            hidden += usize::from(!occupancy.is_visible(p));
        }
        assert!(hidden > 1000);
    }

    #[test]
    fn one_voxel_is_constant_everywhere() {
        assert_eq!(field([1, 1, 1], |_, _, _| 0.25).sample(DVec3::new(0.3, -0.4, 9.0)), 0.25);
    }
}
