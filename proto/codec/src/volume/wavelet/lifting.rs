//! The wavelet transform by lifting (W. Sweldens, "The Lifting Scheme: A Construction of Second Generation Wavelets", SIAM J.
//! Math. Anal. 29, 1998), with mirrored ends, along one axis after the other. Coefficients lie where the values were: low
//! ones first along each axis.
//!
//! Operations and their order are fixed, so that all machines decode the same values.

/// Weights of the four lifting steps; odd points take the first and the third.
const STEPS: [f32; 4] = [-1.586_134_3, -0.052_980_12, 0.882_911_1, 0.443_506_85];
/// Factor of the low coefficients after lifting, and divisor of the high ones: a constant grows by the root of 2.
const SCALE: f32 = 1.149_604_4;
/// Shortest side that is halved.
const SHORTEST: usize = 8;
/// The most levels.
const MOST_LEVELS: usize = 6;
/// Rows along x that are transformed together.
const ROWS: usize = 16;

/// Sides of the box that each level transforms, and of the low coefficients that the last one leaves.
pub(super) fn extents(dims: [usize; 3]) -> Vec<[usize; 3]> {
    let halved =
        |d: &[usize; 3]| Some(d.map(|n| if n >= SHORTEST { n.div_ceil(2) } else { n })).filter(|next| next != d);
    std::iter::successors(Some(dims), halved).take(MOST_LEVELS + 1).collect()
}

/// Transforms `values` of `dims` in place.
pub(super) fn forward(values: &mut [f32], dims: [usize; 3], levels: &[[usize; 3]]) {
    for pair in levels.windows(2) {
        for axis in (0..3).filter(|&axis| pair[0][axis] != pair[1][axis]) {
            along(values, dims, pair[0], axis, forward_lines);
        }
    }
}

/// The inverse of [`forward`].
pub(super) fn inverse(values: &mut [f32], dims: [usize; 3], levels: &[[usize; 3]]) {
    for pair in levels.windows(2).rev() {
        for axis in (0..3).rev().filter(|&axis| pair[0][axis] != pair[1][axis]) {
            along(values, dims, pair[0], axis, inverse_lines);
        }
    }
}

/// Applies `transform` to all lines along `axis` of a box. It is given many lines at a time, point by point, and their number.
fn along(
    values: &mut [f32],
    dims: [usize; 3],
    sides: [usize; 3],
    axis: usize,
    transform: fn(&mut Vec<f32>, &mut Vec<f32>, usize),
) {
    let strides = [1, dims[0], dims[0] * dims[1]];
    let (mut lines, mut spare) = (Vec::new(), Vec::new());
    if axis == 0 {
        // Transpose a few rows.
        for z in 0..sides[2] {
            for first in (0..sides[1]).step_by(ROWS) {
                let rows = ROWS.min(sides[1] - first);
                let row = |y: usize| z * strides[2] + (first + y) * strides[1];
                lines.resize(sides[0] * rows, 0.0);
                for y in 0..rows {
                    for (to, &value) in lines[y..].iter_mut().step_by(rows).zip(&values[row(y)..row(y) + sides[0]]) {
                        *to = value;
                    }
                }
                transform(&mut lines, &mut spare, rows);
                for y in 0..rows {
                    for (to, &value) in
                        values[row(y)..row(y) + sides[0]].iter_mut().zip(lines[y..].iter().step_by(rows))
                    {
                        *to = value;
                    }
                }
            }
        }
        return;
    }
    let (count, other) = (sides[0], 3 - axis);
    for k in 0..sides[other] {
        let row = |i: usize| k * strides[other] + i * strides[axis];
        lines.clear();
        (0..sides[axis]).for_each(|i| lines.extend_from_slice(&values[row(i)..row(i) + count]));
        transform(&mut lines, &mut spare, count);
        for (i, line) in lines.chunks_exact(count).enumerate() {
            values[row(i)..row(i) + count].copy_from_slice(line);
        }
    }
}

/// `weight` times the sum of both neighbors is added to each odd, or each even, point of `count` lines.
fn lift(lines: &mut [f32], count: usize, weight: f32, odd: bool) {
    let points = lines.len() / count;
    for i in (usize::from(odd)..points).step_by(2) {
        let (before, rest) = lines.split_at_mut(i * count);
        let (here, after) = rest.split_at_mut(count);
        let next = if i + 1 < points { &after[..count] } else { &before[(i - 1) * count..] };
        let previous = if i > 0 { &before[(i - 1) * count..] } else { next };
        for ((value, a), b) in here.iter_mut().zip(previous).zip(next) {
            *value += weight * (a + b);
        }
    }
}

fn forward_lines(lines: &mut Vec<f32>, sorted: &mut Vec<f32>, count: usize) {
    for (n, weight) in STEPS.into_iter().enumerate() {
        lift(lines, count, weight, n % 2 == 0);
    }
    sorted.clear();
    for point in lines.chunks_exact(count).step_by(2) {
        sorted.extend(point.iter().map(|v| v * SCALE));
    }
    for point in lines.chunks_exact(count).skip(1).step_by(2) {
        sorted.extend(point.iter().map(|v| v / SCALE));
    }
    std::mem::swap(lines, sorted);
}

fn inverse_lines(lines: &mut Vec<f32>, merged: &mut Vec<f32>, count: usize) {
    let low = (lines.len() / count).div_ceil(2) * count;
    let (low, high) = lines.split_at(low);
    merged.clear();
    let mut high = high.chunks_exact(count);
    for point in low.chunks_exact(count) {
        merged.extend(point.iter().map(|v| v / SCALE));
        merged.extend(high.next().unwrap_or_default().iter().map(|v| v * SCALE));
    }
    for (n, weight) in STEPS.into_iter().enumerate().rev() {
        lift(merged, count, -weight, n % 2 == 0);
    }
    std::mem::swap(lines, merged);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_gives_the_values_back_and_energy_is_nearly_kept() {
        let mut dice = fastrand::Rng::with_seed(1);
        for dims in [[33, 20, 9], [8, 1, 1], [7, 7, 7], [1, 64, 100]] {
            let levels = extents(dims);
            let values: Vec<f32> = (0..dims.iter().product()).map(|_| dice.f32() - 0.5).collect();
            let mut changed = values.clone();
            forward(&mut changed, dims, &levels);
            let energy = |v: &[f32]| v.iter().map(|v| f64::from(v * v)).sum::<f64>();
            let kept = energy(&changed) / energy(&values);
            // The basis is biorthogonal: 9/7 filters of noise keep their energy within some percent an axis.
            assert!((0.8..1.3).contains(&kept), "{dims:?}: {kept}");
            inverse(&mut changed, dims, &levels);
            let worst = changed.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-5, "{dims:?}: {worst}");
        }
    }

    #[test]
    fn polynomials_of_third_degree_leave_no_high_coefficients() {
        // The high-pass filter of 9/7 has four vanishing moments; the mirrored ends are no polynomial.
        let n = 64;
        let mut values: Vec<f32> = (0..n).map(|i| (i as f32 / 64.0 - 0.4).powi(3)).collect();
        forward(&mut values, [n, 1, 1], &[[n, 1, 1], [n / 2, 1, 1]]);
        assert!(values[n / 2 + 2..n - 3].iter().all(|v| v.abs() < 1e-6), "{:?}", &values[n / 2..]);
        assert!(values[..n / 2].iter().any(|v| v.abs() > 0.1));
    }

    #[test]
    fn sides_are_halved_until_they_are_short() {
        assert_eq!(extents([125, 25, 1]), [[125, 25, 1], [63, 13, 1], [32, 7, 1], [16, 7, 1], [8, 7, 1], [4, 7, 1]]);
        assert_eq!(extents([7, 3, 1]), [[7, 3, 1]]);
        assert_eq!(extents([1 << 20, 8, 8]).len(), 7);
    }
}
