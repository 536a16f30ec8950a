//! Trilinear interpolation between sample points, in double precision: the definition that the fast levels must match.

use super::stored::Scalar;
use glam::DVec3;

/// Trilinear interpolation of `values`, x fastest, at `index` (units of sample points), which is clamped into the grid.
#[inline]
pub(crate) fn trilinear<T: Scalar>(dims: [usize; 3], values: &[T], index: DVec3) -> f64 {
    let mut base = 0;
    let mut stride = 1;
    let mut next = [0; 3];
    let mut w = [0.0; 3];
    for axis in 0..3 {
        let last = dims[axis] - 1;
        let x = index[axis].clamp(0.0, last as f64);
        let cell = (x as usize).min(last.saturating_sub(1));
        w[axis] = x - cell as f64;
        base += cell * stride;
        next[axis] = if last > 0 { stride } else { 0 };
        stride *= dims[axis];
    }
    let lerp = |a: f64, b: f64, w: f64| a + w * (b - a);
    let along_x = |i: usize| lerp(values[i].wide(), values[i + next[0]].wide(), w[0]);
    let along_y = |i: usize| lerp(along_x(i), along_x(i + next[1]), w[1]);
    lerp(along_y(base), along_y(base + next[2]), w[2])
}
