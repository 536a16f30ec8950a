//! The field drawn, in double precision: the position in the transfer function's range, from the volume's own voxels.
//!
//! As in the product the position is what is interpolated, so that under a logarithmic range it is the logarithm, and a
//! sample whose neighbors hold a voxel that is not finite is NaN: empty.

use glam::DVec3;
use lamina_model::{Grid, Invalid, ScalarRange, Scale, Volume, Voxels, for_voxels};
use rayon::prelude::*;

/// How a value between sample points is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Interpolation {
    /// The nearest sample point's.
    Nearest,
    /// Linear along each axis: what the product draws.
    Trilinear,
    /// Catmull-Rom along each axis: through the sample points, with a continuous slope.
    Tricubic,
}

/// Voxels under a range, to be sampled anywhere.
pub(super) struct Scalars {
    grid: Grid,
    voxels: Voxels,
    lo: f64,
    per_range: f64,
}

impl Scalars {
    /// The voxels of `volume` under `range`.
    pub(super) fn new(volume: Volume, range: &ScalarRange) -> Self {
        let grid = *volume.grid();
        let (lo, hi) = (range.lo(), range.hi());
        if range.scale() == Scale::Linear {
            return Self { grid, voxels: volume.into_parts().1, lo, per_range: 1.0 / (hi - lo) };
        }
        let unit = |i: usize| match volume.voxels().get(i) {
            v if !v.is_finite() => f64::NAN,
            v if v <= 0.0 => -1.0,
            v => ((v / lo).ln() / (hi / lo).ln()).max(-1.0),
        };
        let mapped = (0..volume.voxels().len()).into_par_iter().map(unit).collect();
        Self { grid, voxels: Voxels::F64(mapped), lo: 0.0, per_range: 1.0 }
    }

    /// Every `every`-th sample point of each axis.
    ///
    /// # Errors
    /// Never for `every` of 1 or more.
    pub(super) fn thinned(&self, every: usize) -> Result<Self, Invalid> {
        let dims = self.grid.dims();
        let fewer = dims.map(|d| d.div_ceil(every));
        let grid = Grid::new(fewer, self.grid.spacing() * every as f64, self.grid.origin())?;
        let at = |n: usize| {
            let (x, y, z) = (n % fewer[0], n / fewer[0] % fewer[1], n / fewer[0] / fewer[1]);
            self.voxels.get(every * (x + dims[0] * (y + dims[1] * z)))
        };
        let voxels = Voxels::F64((0..grid.voxels()).into_par_iter().map(at).collect());
        Ok(Self { grid, voxels, ..*self })
    }

    /// Where the sample points lie.
    pub(super) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The position in the range at `index` (units of sample points), which is clamped into the grid.
    #[inline]
    pub(super) fn at(&self, index: DVec3, how: Interpolation) -> f64 {
        let dims = self.grid.dims();
        let value = match how {
            Interpolation::Nearest => {
                let taps = [0, 1, 2].map(|a| [(clamped(index[a], dims[a]).round() as usize, 1.0)]);
                for_voxels!(&self.voxels, v => gather(v, dims, &taps))
            }
            Interpolation::Trilinear => {
                let taps = [0, 1, 2].map(|a| linear_taps(index[a], dims[a]));
                for_voxels!(&self.voxels, v => gather(v, dims, &taps))
            }
            Interpolation::Tricubic => {
                let taps = [0, 1, 2].map(|a| cubic_taps(index[a], dims[a]));
                for_voxels!(&self.voxels, v => gather(v, dims, &taps))
            }
        };
        if value.is_finite() { (value - self.lo) * self.per_range } else { f64::NAN }
    }
}

fn clamped(x: f64, count: usize) -> f64 {
    x.clamp(0.0, (count - 1) as f64)
}

/// The sample point below `x` and how far beyond it `x` lies.
fn cell(x: f64, count: usize) -> (usize, f64) {
    let x = clamped(x, count);
    let below = (x as usize).min(count.saturating_sub(2));
    (below, x - below as f64)
}

fn linear_taps(x: f64, count: usize) -> [(usize, f64); 2] {
    let (below, w) = cell(x, count);
    [(below, 1.0 - w), ((below + 1).min(count - 1), w)]
}

fn cubic_taps(x: f64, count: usize) -> [(usize, f64); 4] {
    let (below, w) = cell(x, count);
    let weights = [
        0.5 * w * (w * (2.0 - w) - 1.0),
        0.5 * (w * w * (3.0 * w - 5.0) + 2.0),
        0.5 * w * (w * (4.0 - 3.0 * w) + 1.0),
        0.5 * w * w * (w - 1.0),
    ];
    std::array::from_fn(|n| ((below + n).saturating_sub(1).min(count - 1), weights[n]))
}

/// The weighted sum of the sample points that the taps name.
#[inline]
fn gather<T: Copy + Into<f64>, const N: usize>(voxels: &[T], dims: [usize; 3], taps: &[[(usize, f64); N]; 3]) -> f64 {
    let mut sum = 0.0;
    for &(z, wz) in &taps[2] {
        for &(y, wy) in &taps[1] {
            let row = dims[0] * (y + dims[1] * z);
            let along_x: f64 = taps[0].iter().map(|&(x, wx)| wx * voxels[row + x].into()).sum();
            sum += wz * wy * along_x;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scalars(n: usize, f: impl Fn(f64) -> f64) -> Scalars {
        let grid = Grid::new([n, 3, 3], DVec3::ONE, DVec3::ZERO).unwrap();
        let voxels = (0..9 * n).map(|i| f((i % n) as f64)).collect();
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        Scalars::new(Volume::new(grid, Voxels::F64(voxels)).unwrap(), &range)
    }

    #[test]
    fn what_each_interpolation_reproduces_exactly() {
        let at = |f: fn(f64) -> f64, how| scalars(8, f).at(DVec3::new(3.3, 1.2, 0.7), how);
        assert_eq!(at(|x| 2.0 * x, Interpolation::Nearest), 6.0);
        assert!((at(|x| 2.0 * x, Interpolation::Trilinear) - 6.6).abs() < 1e-14);
        assert!((at(|x| x * x, Interpolation::Tricubic) - 3.3 * 3.3).abs() < 1e-13);
    }

    #[test]
    fn what_is_not_finite_is_empty_and_so_are_its_neighbors() {
        let hole = scalars(8, |x| if x == 4.0 { f64::INFINITY } else { 0.5 });
        assert!(hole.at(DVec3::new(3.1, 1.0, 1.0), Interpolation::Trilinear).is_nan());
        assert_eq!(hole.at(DVec3::new(2.9, 1.0, 1.0), Interpolation::Trilinear), 0.5);
        assert_eq!(hole.at(DVec3::new(-7.0, 99.0, 1.0), Interpolation::Tricubic), 0.5);
    }

    #[test]
    fn a_logarithmic_range_and_thinning() {
        let grid = Grid::new([5, 1, 1], DVec3::ONE, DVec3::ZERO).unwrap();
        let volume = Volume::new(grid, Voxels::F32(vec![0.01, 0.1, 1.0, -3.0, 100.0])).unwrap();
        let log = Scalars::new(volume, &ScalarRange::new(0.01, 100.0, Scale::Log10).unwrap());
        let at = |s: &Scalars, x: f64| s.at(DVec3::new(x, 0.0, 0.0), Interpolation::Trilinear);
        assert!((at(&log, 1.5) - 0.375).abs() < 1e-7 && (at(&log, 3.0) + 1.0).abs() < 1e-12);
        let half = log.thinned(2).unwrap();
        assert_eq!(half.grid().dims(), [3, 1, 1]);
        assert!((at(&half, 0.5) - 0.25).abs() < 1e-7 && (at(&half, 2.0) - 1.0).abs() < 1e-7);
    }
}
