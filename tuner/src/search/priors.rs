//! What is known of sigma, tau and q before anything is measured, and how measurements bend it.
//!
//! Size and time grow as a power of r, and fall with gamma along a curve that is nearly the same for every r. Squared error
//! has two causes that add up: too few rays, which falls as a power of r, and merging, which grows as a power of gamma. So
//! one measurement at another resolution says much about all gammas there.

use super::gaussian_process::{
    GaussianProcess, Observation, ParamPoint, Prior, backward, factor, forward, matern52, squared_exponential,
};
use lamina_model::Representation;

/// The logarithm of a size or time.
#[derive(Debug)]
pub struct CostPrior {
    center: ParamPoint,
    /// Value at `center`, roughly.
    height: f64,
    /// Power of r, and its standard deviation.
    power: f64,
    doubt: f64,
    /// Standard deviation of what each r has of its own.
    rough: f64,
    noise: f64,
}

impl CostPrior {
    /// Sizes: near r^1.8, because neighboring rays compress well together; points do still better, how much is less sure.
    pub fn of_sizes(representation: Representation, ln_bytes: &[Observation]) -> GaussianProcess<Self> {
        let power = if representation == Representation::Volume { (1.7, 0.5) } else { (1.8, PRICE[1]) };
        Self::through(ln_bytes, power, ROUGH, 0.003)
    }

    /// Times: near r^1.75, because a share does not depend on r; clocks are noisy.
    pub fn of_times(ln_ms: &[Observation]) -> GaussianProcess<Self> {
        Self::through(ln_ms, (1.75, PRICE[1]), 0.0, 0.1)
    }

    fn through(known: &[Observation], (power, doubt): (f64, f64), rough: f64, noise: f64) -> GaussianProcess<Self> {
        let mean = |of: &dyn Fn(&Observation) -> f64| known.iter().map(of).sum::<f64>() / known.len() as f64;
        let center = [mean(&|o| o.at[0]), mean(&|o| o.at[1])];
        GaussianProcess::new(Self { center, height: mean(&|o| o.value), power, doubt, rough, noise }, known)
    }
}

/// Standard deviations: of the height, of the power of r, of the slope in ln gamma, of what is no plane.
const PRICE: [f64; 4] = [2.0, 0.15, 1.0, 0.27];
/// How the rays happen to fall on the voxels makes neighboring resolutions differ by 1 or 2 % in size.
const ROUGH: f64 = 0.015;
/// Over this much in ln r.
const ROUGH_LENGTH: f64 = 0.06;
/// By how much an earlier step's sizes and times differ from this one's: all of them, and each beside that.
const STEP_OFFSET: f64 = 0.3;
const STEP_REMAINDER: f64 = 0.05;

impl Prior for CostPrior {
    fn mean(&self, at: &ParamPoint) -> f64 {
        self.height + self.power * (at[0] - self.center[0])
    }

    fn covariance(&self, a: &ParamPoint, b: &ParamPoint) -> f64 {
        let slope = |k: usize| {
            let doubt = if k == 0 { self.doubt } else { PRICE[k + 1] };
            doubt.powi(2) * (a[k] - self.center[k]) * (b[k] - self.center[k])
        };
        let curve = squared_exponential((a[0] - b[0]) / 2.0) * matern52((a[1] - b[1]) / 0.6);
        let rough = (-(a[0] - b[0]).abs() / ROUGH_LENGTH).exp() * squared_exponential((a[1] - b[1]) / 2.0);
        PRICE[0].powi(2) + slope(0) + slope(1) + PRICE[3].powi(2) * curve + self.rough.powi(2) * rough
    }

    fn noise(&self) -> f64 {
        self.noise
    }

    fn step_offset(&self) -> f64 {
        STEP_OFFSET
    }

    fn step_remainder(&self) -> f64 {
        STEP_REMAINDER
    }
}

/// Size and length scales of a remainder.
#[derive(Debug, Clone, Copy)]
struct Remainder {
    db: f64,
    lengths: ParamPoint,
}

/// q in decibels: -10 log10(A + B), A = exp(a0 + a1 x(r)) for too few rays or points, B = exp(b0 + b1 (ln gamma - ..)) for
/// merging or coding. Of rays x = ln r - ..; a volume with all points of the data has no error of the first kind, so that
/// there A falls as (r / all)^a1 - 1.
pub(super) struct QualityPrior {
    /// Logarithm of all points on the longest side; `None` for VDIs.
    ln_all: Option<f64>,
    rest: Remainder,
    /// (a0, a1, b0, b1), the likeliest.
    fitted: [f64; 4],
    /// What was expected of them, relative to `fitted`.
    expected: [f64; 4],
}

/// Where a0 (of VDIs) and b0 are read: r = 245, gamma = 0.027.
const ORIGIN: ParamPoint = [5.5, -3.5];
/// (a0, a1, b0, b1) expected before anything is measured: of VDIs, an error of 1e-4 by either cause; of volumes, an error of 5e-4
/// at half the points on a side, and one that grows as the square of the bound.
const VDI_ERRORS: [f64; 4] = [-9.2, -2.5, -9.2, 1.5];
const VOLUME_ERRORS: [f64; 4] = [-9.1, -2.5, -11.0, 2.0];
/// Share of the error at a few points that is left with all of them.
const ALL_POINTS: f64 = 1e-3;
/// Standard deviations of (a0, a1, b0, b1).
const DOUBT: [f64; 4] = [2.5, 0.6, 2.5, 0.6];
/// What is not of that form: its standard deviation, decibels, and over how much in ln r and in ln gamma it changes. In volumes
/// errors of coding blur the more the more points there are.
const VDI_REST: Remainder = Remainder { db: 0.8, lengths: [0.8, 0.5] };
const VOLUME_REST: Remainder = Remainder { db: 1.2, lengths: [0.5, 0.5] };
/// Standard deviation of a measurement.
const NOISE_DB: f64 = 0.1;
/// By how many decibels an earlier step's quality differs from this one's: all of it, and each beside that.
const STEP_OFFSET_DB: f64 = 2.0;
const STEP_REMAINDER_DB: f64 = 0.5;
/// Decibels per unit of ln(squared error).
const DB: f64 = -10.0 / std::f64::consts::LN_10;

impl QualityPrior {
    /// Of a representation of data with so many sample points on the longest side, through decibels measured; before there are
    /// any, what most data give.
    pub(super) fn through(
        representation: Representation,
        longest_side: u32,
        psnr_db: &[Observation],
    ) -> GaussianProcess<Self> {
        let (mut expected, rest, ln_all) = match representation {
            Representation::Vdi => (VDI_ERRORS, VDI_REST, None),
            Representation::Volume => (VOLUME_ERRORS, VOLUME_REST, Some(f64::from(longest_side.max(2)).ln())),
        };
        let mut prior = Self { ln_all, rest, fitted: expected, expected: [0.0; 4] };
        if !psnr_db.is_empty() {
            // Both causes alike are larger or smaller on this data.
            let off = |o: &Observation| (o.value - prior.decibels(&expected, &o.at).0) / DB;
            let level = psnr_db.iter().map(off).sum::<f64>() / psnr_db.len() as f64;
            (expected[0], expected[2]) = (expected[0] + level, expected[2] + level);
            prior.fitted = prior.fit(psnr_db, expected);
        }
        prior.expected = std::array::from_fn(|k| expected[k] - prior.fitted[k]);
        GaussianProcess::new(prior, psnr_db)
    }

    /// q, and how it changes with each of (a0, a1, b0, b1).
    fn decibels(&self, theta: &[f64; 4], at: &ParamPoint) -> (f64, [f64; 4]) {
        let x = match self.ln_all {
            None => at[0] - ORIGIN[0],
            Some(all) => ((-VOLUME_ERRORS[1] * (all - at[0])).exp_m1().max(0.0) + ALL_POINTS).ln() / VOLUME_ERRORS[1],
        };
        let y = at[1] - ORIGIN[1];
        let (a, b) = ((theta[0] + theta[1] * x).exp(), (theta[2] + theta[3] * y).exp());
        let (a_share, b_share) = (a / (a + b), b / (a + b));
        (DB * (a + b).ln(), [DB * a_share, DB * a_share * x, DB * b_share, DB * b_share * y])
    }

    /// The likeliest parameters: Levenberg and Marquardt's method on the misfit and the prior's.
    fn fit(&self, psnr_db: &[Observation], expected: [f64; 4]) -> [f64; 4] {
        let variance = |o: &Observation| {
            self.rest.db.powi(2) + if o.carried { STEP_OFFSET_DB.powi(2) + STEP_REMAINDER_DB.powi(2) } else { 0.0 }
        };
        let misfit = |theta: &[f64; 4]| -> f64 {
            let data: f64 =
                psnr_db.iter().map(|o| (self.decibels(theta, &o.at).0 - o.value).powi(2) / variance(o)).sum();
            data + (0..4).map(|k| ((theta[k] - expected[k]) / DOUBT[k]).powi(2)).sum::<f64>()
        };
        let (mut theta, mut damping) = (expected, 1e-2);
        let mut least = misfit(&theta);
        for _ in 0..40 {
            let (mut hessian, mut gradient) = ([0.0; 16], [0.0; 4]);
            for o in psnr_db {
                let (value, slopes) = self.decibels(&theta, &o.at);
                for i in 0..4 {
                    gradient[i] -= slopes[i] * (value - o.value) / variance(o);
                    for j in 0..4 {
                        hessian[4 * i + j] += slopes[i] * slopes[j] / variance(o);
                    }
                }
            }
            for k in 0..4 {
                gradient[k] -= (theta[k] - expected[k]) / DOUBT[k].powi(2);
                hessian[5 * k] = (hessian[5 * k] + DOUBT[k].powi(-2)) * (1.0 + damping);
            }
            factor(&mut hessian, 4);
            let step = backward(&hessian, forward(&hessian, &gradient));
            let tried = std::array::from_fn(|k| theta[k] + step[k]);
            let found = misfit(&tried);
            if found < least {
                (theta, least, damping) = (tried, found, damping / 3.0);
            } else {
                damping *= 5.0;
            }
        }
        theta
    }
}

impl Prior for QualityPrior {
    fn mean(&self, at: &ParamPoint) -> f64 {
        let (value, slopes) = self.decibels(&self.fitted, at);
        value + (0..4).map(|k| slopes[k] * self.expected[k]).sum::<f64>()
    }

    fn covariance(&self, a: &ParamPoint, b: &ParamPoint) -> f64 {
        let (sa, sb) = (self.decibels(&self.fitted, a).1, self.decibels(&self.fitted, b).1);
        let form: f64 = (0..4).map(|k| sa[k] * sb[k] * DOUBT[k].powi(2)).sum();
        let near = |k: usize| squared_exponential((a[k] - b[k]) / self.rest.lengths[k]);
        form + self.rest.db.powi(2) * near(0) * near(1)
    }

    fn noise(&self) -> f64 {
        NOISE_DB
    }

    fn step_offset(&self) -> f64 {
        STEP_OFFSET_DB
    }

    fn step_remainder(&self) -> f64 {
        STEP_REMAINDER_DB
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(r: f64, gamma: f64) -> ParamPoint {
        [r.ln(), gamma.ln()]
    }

    #[test]
    fn a_few_trials_tell_the_quality_of_all_others() {
        // Made up: error 2e-4 (245 / r)^2.2 + 1e-4 (gamma / 0.03)^1.2.
        let q = |p: &ParamPoint| {
            DB * (2e-4 * (-2.2 * (p[0] - ORIGIN[0])).exp() + 1e-4 * (1.2 * (p[1] - ORIGIN[1])).exp()).ln()
        };
        let points = [at(160.0, 0.004), at(160.0, 0.05), at(256.0, 0.012), at(256.0, 0.1), at(384.0, 0.02)];
        let known: Vec<Observation> = points.iter().map(|p| Observation::new(*p, q(p))).collect();
        let model = QualityPrior::through(Representation::Vdi, 0, &known);
        for p in [at(512.0, 0.01), at(320.0, 0.03), at(700.0, 0.2)] {
            let found = model.predict(&p);
            let off = (found.mean - q(&p)).abs();
            assert!(off < 0.7 && off < 3.0 * found.deviation, "{found:?}, but {}", q(&p));
        }
    }

    #[test]
    fn a_curve_in_gamma_at_one_resolution_holds_at_others() {
        let ln_bytes = |p: &ParamPoint| 3.0 + 1.75 * p[0] - 0.4 * (p[1] + 6.0) + 0.05 * (p[1] + 4.0).powi(2);
        let mut points: Vec<ParamPoint> = (0..12).map(|n| [160_f64.ln(), -5.5 + 0.4 * f64::from(n)]).collect();
        points.push(at(240.0, 0.01));
        let known: Vec<Observation> = points.iter().map(|p| Observation::new(*p, ln_bytes(p))).collect();
        let model = CostPrior::of_sizes(Representation::Vdi, &known);
        for p in [at(240.0, 0.1), at(400.0, 0.02)] {
            let found = model.predict(&p);
            let off = (found.mean - ln_bytes(&p)).abs();
            assert!(off < 0.05 && off < 3.0 * found.deviation, "{found:?}, but {}", ln_bytes(&p));
        }
    }
}
