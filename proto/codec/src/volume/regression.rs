//! Least-squares fit of a class's prediction weights to a sample of its points.
use super::grid::{Lattice, PointClass};
use super::multigrid::WEIGHTS;
use super::multigrid::{LevelParams, MultigridField};
use super::predict::{PredictionRow, PredictionTerms, SCALE, cubic, weights};

/// Fewest informative points of a sample at which fitted weights save more bytes than they cost.
const MIN_SAMPLE: usize = 200;
/// Approximate points of a sample.
const TARGET_SAMPLE: usize = 30_000;

/// Normal equations of the least-squares problem.
#[derive(Debug, Default)]
struct NormalEquations {
    /// Matrix; the lower triangle only.
    terms: [[f64; WEIGHTS]; WEIGHTS],
    right: [f64; WEIGHTS],
    count: usize,
}

impl NormalEquations {
    #[inline(always)]
    fn add<const K: usize>(&mut self, step: f32, f: &PredictionTerms, wanted: f32) {
        let n = weights(K);
        let error = f64::from(wanted - f.base);
        // Weight large errors less: the bytes they cost grow with their logarithm, not their square.
        let weight = 1.0 / (error * error + f64::from(step) * f64::from(step));
        for i in 0..n {
            let term = f64::from(f.terms[i]) * weight;
            self.right[i] += term * error;
            (0..=i).for_each(|j| self.terms[i][j] += term * f64::from(f.terms[j]));
        }
        self.count += usize::from(f.bend > 0.01 * step);
    }
}

/// Fitted weights of `class` in 1 / SCALE; `None` if the sample is too small. `wanted` gives the value of a point, or `None`
/// where it is invisible.
pub(super) fn fit(
    field: &MultigridField,
    level: &LevelParams,
    class: PointClass,
    wanted: impl Fn([usize; 3]) -> Option<f32>,
) -> Option<[i8; WEIGHTS]> {
    let sums = match class.odd_axes() {
        1 => sample::<1>(field, level, class, wanted),
        2 => sample::<2>(field, level, class, wanted),
        _ => sample::<3>(field, level, class, wanted),
    };
    if sums.count < MIN_SAMPLE { None } else { solve(sums.terms, sums.right, class.odd_axes()) }
}

/// Rows of a class that are measured for its weights: some [`TARGET_SAMPLE`] points.
pub(super) fn sampled_rows(grid: Lattice) -> impl Iterator<Item = (usize, usize)> {
    // An odd stride, so that the sampled rows are not all of one plane.
    grid.rows().step_by((grid.count() / TARGET_SAMPLE) | 1)
}

fn sample<const K: usize>(
    field: &MultigridField,
    level: &LevelParams,
    class: PointClass,
    wanted: impl Fn([usize; 3]) -> Option<f32>,
) -> NormalEquations {
    let (mut sums, mut row) = (NormalEquations::default(), PredictionRow::default());
    for (y, z) in sampled_rows(field.lattice.part(class.odd)) {
        row.compute_means::<false>(field, class, y, z);
        row.features::<K>(|x, features, _| {
            if let Some(wanted) = wanted([x, y, z]) {
                sums.add::<K>(level.step, features, wanted);
            }
        });
    }
    sums
}

/// Solution of the normal equations, regularized towards cubic interpolation.
fn solve(mut a: [[f64; WEIGHTS]; WEIGHTS], mut b: [f64; WEIGHTS], odd_axes: usize) -> Option<[i8; WEIGHTS]> {
    let (n, scale) = (weights(odd_axes), f64::from(SCALE));
    (0..n).for_each(|i| (0..i).for_each(|j| a[j][i] = a[i][j]));
    let trace: f64 = (0..n).map(|i| a[i][i]).sum();
    for i in 0..n {
        let pull = 1e-3 * trace / n as f64 + 1e-9;
        a[i][i] += pull;
        b[i] += pull * f64::from(cubic(odd_axes)[i]) / scale;
    }
    for i in 0..n {
        for j in i + 1..n {
            let factor = a[j][i] / a[i][i];
            (i..n).for_each(|k| a[j][k] -= factor * a[i][k]);
            b[j] -= factor * b[i];
        }
    }
    let mut x = [0.0; WEIGHTS];
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| a[i][k] * x[k]).sum();
        x[i] = (b[i] - known) / a[i][i];
    }
    x.iter().all(|x| x.is_finite()).then(|| x.map(|x| (x * scale).round().clamp(-127.0, 127.0) as i8))
}
