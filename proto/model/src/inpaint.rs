//! Inpainting: values for missing sample points that continue smoothly from those around them.
//!
//! Pull and push over a pyramid of halved grids (S. Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4): a coarser point is
//! the mean of its known children; an unknown point takes its parent's value, then is relaxed towards the mean of its neighbors.

/// Rounds of relaxation on each grid.
const ROUNDS: usize = 2;

/// Replaces NaN in `values`, a grid of `dims` points (x fastest); 0 where nothing is known.
///
/// # Panics
/// If `dims` do not multiply to the number of values.
pub fn inpaint(values: &mut [f32], dims: [usize; 3]) {
    assert_eq!(dims.iter().product::<usize>(), values.len(), "a grid has as many values as points");
    let known: Vec<bool> = values.iter().map(|v| !v.is_nan()).collect();
    if known.iter().all(|&k| k) {
        return;
    }
    let fewer = dims.map(|n| n.div_ceil(2));
    let mut coarser = halved(values, dims, fewer);
    if coarser.len() < values.len() {
        inpaint(&mut coarser, fewer);
    }
    let at = |[x, y, z]: [usize; 3], [nx, ny, _]: [usize; 3]| (z * ny + y) * nx + x;
    let unknown = || points(dims).zip(&known).filter(|(_, known)| !**known).map(|(p, _)| p);
    for p in unknown() {
        let parent = if values.len() == 1 { 0.0 } else { coarser[at(p.map(|c| c / 2), fewer)] };
        values[at(p, dims)] = parent;
    }
    let strides = [1, dims[0], dims[0] * dims[1]];
    for _ in 0..ROUNDS {
        for p in unknown() {
            let here = at(p, dims);
            let (mut sum, mut count) = (0.0, 0.0);
            for axis in 0..3 {
                if p[axis] > 0 {
                    (sum, count) = (sum + values[here - strides[axis]], count + 1.0);
                }
                if p[axis] + 1 < dims[axis] {
                    (sum, count) = (sum + values[here + strides[axis]], count + 1.0);
                }
            }
            if count > 0.0 {
                values[here] = sum / count;
            }
        }
    }
}

/// Indices of all points, x fastest.
fn points([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
}

/// The grid of `fewer`, half as many points a side: means of what is known, NaN where nothing is.
fn halved(values: &[f32], dims: [usize; 3], fewer: [usize; 3]) -> Vec<f32> {
    let count = fewer.iter().product();
    let (mut sums, mut counts) = (vec![0.0_f32; count], vec![0_u8; count]);
    for ([x, y, z], value) in points(dims).zip(values).filter(|(_, v)| !v.is_nan()) {
        let parent = ((z / 2) * fewer[1] + y / 2) * fewer[0] + x / 2;
        sums[parent] += value;
        counts[parent] += 1;
    }
    // 0 / 0 is NaN.
    sums.iter().zip(&counts).map(|(sum, &n)| sum / f32::from(n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_stay_and_a_hole_in_a_ramp_is_near_the_ramp() {
        let dims = [17, 12, 9];
        let ramp = |[x, y, z]: [usize; 3]| 0.1 * x as f32 + 0.02 * y as f32 - 0.05 * z as f32;
        let hole = |[x, y, z]: [usize; 3]| (6..10).contains(&x) && (4..8).contains(&y) && (3..7).contains(&z);
        let mut values: Vec<f32> = points(dims).map(|p| if hole(p) { f32::NAN } else { ramp(p) }).collect();
        inpaint(&mut values, dims);
        for (p, v) in points(dims).zip(&values) {
            let off = (v - ramp(p)).abs();
            assert!(if hole(p) { off < 0.15 } else { off == 0.0 }, "{p:?}: {v} for {}", ramp(p));
        }
    }

    #[test]
    fn a_constant_is_continued_and_nothing_becomes_nothing() {
        for dims in [[1, 1, 1], [5, 1, 1], [2, 3, 4], [33, 2, 7]] {
            let count = dims.iter().product();
            let mut values = vec![f32::NAN; count];
            inpaint(&mut values, dims);
            assert_eq!(values, vec![0.0; count]);
            let mut values = vec![f32::NAN; count];
            values[count / 2] = 0.75;
            inpaint(&mut values, dims);
            assert_eq!(values, vec![0.75; count], "{dims:?}");
        }
    }
}
