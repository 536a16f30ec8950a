//! Weights of the prediction that suit a volume: least squares over a sample of a class.
use super::grid::Class;
use super::multigrid::{Field, Level};
use super::predict::{Features, Row, SCALE, WEIGHTS, cubic, weights};

/// Points of a sample at which weights are worth their bytes.
const ENOUGH: usize = 200;
/// Points of a sample, about.
const SAMPLE: usize = 30_000;

/// Sums of products over a sample: the normal equations.
#[derive(Debug, Default)]
struct Sums {
    /// The lower triangle.
    terms: [[f64; WEIGHTS]; WEIGHTS],
    right: [f64; WEIGHTS],
    count: usize,
}

impl Sums {
    #[inline(always)]
    fn add<const K: usize>(&mut self, step: f32, f: &Features, wanted: f32) {
        let n = weights(K);
        let error = f64::from(wanted - f.base);
        // Large errors count less: what they cost grows with their logarithm, not their square.
        let weight = 1.0 / (error * error + f64::from(step) * f64::from(step));
        for i in 0..n {
            let term = f64::from(f.terms[i]) * weight;
            self.right[i] += term * error;
            (0..=i).for_each(|j| self.terms[i][j] += term * f64::from(f.terms[j]));
        }
        self.count += usize::from(f.bend > 0.01 * step);
    }
}

/// Weights of `class` in 1 / SCALE by what is `wanted`, and shown, at a point; `None` where the sample is too small to
/// tell.
pub fn fit(
    field: &Field,
    level: &Level,
    class: Class,
    wanted: impl Fn([usize; 3]) -> Option<f32>,
) -> Option<[i8; WEIGHTS]> {
    let sums = match class.odds() {
        1 => sample::<1>(field, level, class, wanted),
        2 => sample::<2>(field, level, class, wanted),
        _ => sample::<3>(field, level, class, wanted),
    };
    if sums.count < ENOUGH { None } else { solve(sums.terms, sums.right, class.odds()) }
}

fn sample<const K: usize>(
    field: &Field,
    level: &Level,
    class: Class,
    wanted: impl Fn([usize; 3]) -> Option<f32>,
) -> Sums {
    let grid = field.lattice.part(class.odd);
    // An odd number, so that the rows are not all of one plane.
    let every = (grid.count() / SAMPLE) | 1;
    let (mut sums, mut row) = (Sums::default(), Row::default());
    for (y, z) in grid.rows().step_by(every) {
        row.look::<false>(field, class, y, z);
        row.features::<K>(|x, features, _| {
            if let Some(wanted) = wanted([x, y, z]) {
                sums.add::<K>(level.step, features, wanted);
            }
        });
    }
    sums
}

/// The solution of the normal equations, drawn a little towards cubic interpolation.
fn solve(mut a: [[f64; WEIGHTS]; WEIGHTS], mut b: [f64; WEIGHTS], odds: usize) -> Option<[i8; WEIGHTS]> {
    let (n, scale) = (weights(odds), f64::from(SCALE));
    (0..n).for_each(|i| (0..i).for_each(|j| a[j][i] = a[i][j]));
    let trace: f64 = (0..n).map(|i| a[i][i]).sum();
    for i in 0..n {
        let pull = 1e-3 * trace / n as f64 + 1e-9;
        a[i][i] += pull;
        b[i] += pull * f64::from(cubic(odds)[i]) / scale;
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
