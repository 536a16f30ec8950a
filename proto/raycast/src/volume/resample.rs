//! Resampling along the axes of a grid: each new point is a weighted sum of consecutive old ones, separably per axis.

use super::stored::Scalar;
use rayon::prelude::*;
use std::ops::Range;

/// For each new point along an axis, its first source point and the weights from there on.
pub(super) type Taps = Vec<(usize, Vec<f32>)>;

/// Keys' kernel, a = -1/2.
pub(super) fn keys(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// A kernel without negative weights: linear interpolation.
pub(super) fn tent(x: f64) -> f64 {
    (1.0 - x.abs()).max(0.0)
}

/// For each of `to` points along an axis of `from` points, its first source point and the weights from there on. Beyond an end,
/// values are extrapolated by point reflection at the end, so that ramps stay exact.
pub(super) fn weights(from: usize, to: usize, kernel: impl Fn(f64) -> f64) -> Taps {
    if from == to {
        return (0..to).map(|i| (i, vec![1.0])).collect();
    }
    let (stretch, end) = ((from - 1) as f64 / (to.max(2) - 1) as f64, from as i64 - 1);
    let of = |i: usize| {
        let at = i as f64 * stretch;
        let reached = (at - 2.0 * stretch).ceil() as i64..=(at + 2.0 * stretch).floor() as i64;
        let raw: Vec<(i64, f64)> = reached.map(|k| (k, kernel((k as f64 - at) / stretch))).collect();
        let sum: f64 = raw.iter().map(|(_, w)| w).sum();
        let mut whole = vec![0.0; from];
        for (k, w) in raw {
            let nearest = k.clamp(0, end);
            if k == nearest {
                whole[k as usize] += w / sum;
            } else {
                whole[nearest as usize] += 2.0 * w / sum;
                whole[(2 * nearest - k).clamp(0, end) as usize] -= w / sum;
            }
        }
        let first = whole.iter().position(|w| *w != 0.0).unwrap_or(0);
        let last = whole.iter().rposition(|w| *w != 0.0).unwrap_or(0);
        (first, whole[first..=last].iter().map(|w| *w as f32).collect())
    };
    (0..to).map(of).collect()
}

/// Those of `taps` that reach source points of `own`, with the weights of these alone, the points counted from its start; and which
/// new points they are of.
pub(super) fn within(taps: &Taps, own: &Range<usize>) -> (Range<usize>, Taps) {
    let shared = |(first, weights): &(usize, Vec<f32>)| {
        let (from, to) = (own.start.max(*first), own.end.min(first + weights.len()));
        (from < to).then(|| (from - own.start, weights[from - first..to - first].to_vec()))
    };
    let first = taps.iter().position(|tap| shared(tap).is_some()).unwrap_or(0);
    let found: Taps = taps[first..].iter().map_while(shared).collect();
    (first..first + found.len(), found)
}

/// Rows filtered at once.
const ROWS: usize = 8;

/// Reduces `voxels`, a grid of `dims`, by the taps of its axes, and maps scalars by `unit`.
pub(super) fn shrink<V: Scalar>(
    voxels: &[V],
    unit: impl Fn(V) -> f32 + Sync,
    dims: [usize; 3],
    taps: &[Taps; 3],
) -> Vec<f32> {
    shrink_along_z(shrink_slices(voxels, unit, dims, taps), dims[2], taps)
}

/// Reduces x and y of `voxels`, a grid of `dims`, by `taps`, and maps scalars by `unit`. Works slice by slice,
/// so that the volume is read once and only the reduced one is written.
fn shrink_slices<V: Scalar>(
    voxels: &[V],
    unit: impl Fn(V) -> f32 + Sync,
    [nx, ny, nz]: [usize; 3],
    [along_x, along_y, _]: &[Taps; 3],
) -> Vec<f32> {
    let (fx, fy) = (along_x.len(), along_y.len());
    let mut out = vec![0.0; fx * fy * nz];
    let init = || (vec![[0.0; ROWS]; nx], vec![0.0; fx * ny]);
    let slices = out.par_chunks_exact_mut(fx * fy).zip(voxels.par_chunks_exact(nx * ny));
    slices.for_each_init(init, |(across, narrow), (out, voxels)| {
        for (rows, narrow) in voxels.chunks(ROWS * nx).zip(narrow.chunks_mut(ROWS * fx)) {
            for (lane, row) in rows.chunks_exact(nx).enumerate() {
                across.iter_mut().zip(row).for_each(|(a, &v)| a[lane] = unit(v));
            }
            for (x, (first, weights)) in along_x.iter().enumerate() {
                let mut sums = [0.0; ROWS];
                for (column, w) in across[*first..].iter().zip(weights) {
                    sums.iter_mut().zip(column).for_each(|(s, v)| *s += w * v);
                }
                narrow[x..].iter_mut().step_by(fx).zip(sums).for_each(|(n, s)| *n = s);
            }
        }
        for (out, (first, weights)) in out.chunks_exact_mut(fx).zip(along_y) {
            weighted_sum(out, &narrow[first * fx..], weights);
        }
    });
    out
}

/// Reduces z of `values`, `nz` slices whose x and y are reduced already.
fn shrink_along_z(values: Vec<f32>, nz: usize, [along_x, along_y, along_z]: &[Taps; 3]) -> Vec<f32> {
    if along_z.len() == nz && along_z.iter().enumerate().all(|(z, (first, w))| *first == z && *w == [1.0]) {
        return values;
    }
    let slice = along_x.len() * along_y.len();
    let mut out = vec![0.0; slice * along_z.len()];
    out.par_chunks_exact_mut(slice).zip(along_z).for_each(|(out, (first, weights))| {
        weighted_sum(out, &values[first * slice..], weights);
    });
    out
}

/// Weighted sum of the consecutive runs of `values`, each as long as `out`.
fn weighted_sum(out: &mut [f32], values: &[f32], weights: &[f32]) {
    out.fill(0.0);
    for (values, w) in values.chunks_exact(out.len()).zip(weights) {
        out.iter_mut().zip(values).for_each(|(o, v)| *o += w * v);
    }
}
