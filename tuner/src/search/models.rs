//! What is known of sigma, tau and q before anything is measured, and how measurements bend it.
//!
//! Size and time grow as a power of r, and fall with gamma along a curve that is nearly the same for every r. Squared error
//! has two causes that add up: too few rays, which falls as a power of r, and merging, which grows as a power of gamma. So
//! one measurement at another resolution says much about all gammas there.

use super::gauss::{Place, Prior, Process, backward, bending, factor, forward, smooth};
use lamina_model::Representation;

/// The logarithm of a size or time.
pub struct Price {
    centre: Place,
    /// Value at `centre`, roughly.
    height: f64,
    /// Power of r, and its standard deviation.
    power: f64,
    doubt: f64,
    /// Standard deviation of what each r has of its own.
    rough: f64,
    noise: f64,
}

impl Price {
    /// Sizes: near r^1.8, because neighbouring rays, or points, compress well together; how well points do is less sure.
    pub fn of_sizes(representation: Representation, places: Vec<Place>, ln_bytes: &[f64]) -> Process<Self> {
        let doubt = if representation == Representation::Volume { 0.5 } else { PRICE[1] };
        Self::through(places, ln_bytes, (1.8, doubt), ROUGH, 0.003)
    }

    /// Times: near r^1.75, because a share does not depend on r; clocks are noisy.
    pub fn of_times(places: Vec<Place>, ln_secs: &[f64]) -> Process<Self> {
        Self::through(places, ln_secs, (1.75, PRICE[1]), 0.0, 0.1)
    }

    fn through(
        places: Vec<Place>,
        values: &[f64],
        (power, doubt): (f64, f64),
        rough: f64,
        noise: f64,
    ) -> Process<Self> {
        let n = places.len() as f64;
        let centre = [0, 1].map(|k| places.iter().map(|p| p[k]).sum::<f64>() / n);
        let height = values.iter().sum::<f64>() / n;
        Process::new(Self { centre, height, power, doubt, rough, noise }, places, values)
    }
}

/// Standard deviations: of the height, of the power of r, of the slope in ln gamma, of what is no plane.
const PRICE: [f64; 4] = [2.0, 0.15, 1.0, 0.27];
/// How the rays happen to fall on the voxels makes neighbouring resolutions differ by 1 or 2 % in size.
const ROUGH: f64 = 0.015;
/// Over this much in ln r.
const ROUGH_LENGTH: f64 = 0.06;

impl Prior for Price {
    fn mean(&self, at: &Place) -> f64 {
        self.height + self.power * (at[0] - self.centre[0])
    }

    fn covariance(&self, a: &Place, b: &Place) -> f64 {
        let slope = |k: usize| {
            let doubt = if k == 0 { self.doubt } else { PRICE[k + 1] };
            doubt.powi(2) * (a[k] - self.centre[k]) * (b[k] - self.centre[k])
        };
        let curve = smooth((a[0] - b[0]) / 2.0) * bending((a[1] - b[1]) / 0.6);
        let rough = (-(a[0] - b[0]).abs() / ROUGH_LENGTH).exp() * smooth((a[1] - b[1]) / 2.0);
        PRICE[0].powi(2) + slope(0) + slope(1) + PRICE[3].powi(2) * curve + self.rough.powi(2) * rough
    }

    fn noise(&self) -> f64 {
        self.noise
    }
}

/// q in decibels: -10 log10(A + B), A = exp(a0 + a1 (ln r - ..)) for too few rays, B = exp(b0 + b1 (ln gamma - ..)) for merging.
pub struct Quality {
    /// (a0, a1, b0, b1), the likeliest.
    fitted: [f64; 4],
    /// What was expected of them, relative to `fitted`.
    expected: [f64; 4],
}

/// Where a0 and b0 are read: r = 245, gamma = 0.027.
const ORIGIN: Place = [5.5, -3.5];
/// Powers expected of r and gamma.
const POWERS: [f64; 2] = [-2.5, 1.5];
/// Standard deviations of (a0, a1, b0, b1).
const DOUBT: [f64; 4] = [4.0, 0.6, 4.0, 0.6];
/// Standard deviation of what is not of that form, decibels; over how much in ln r and in ln gamma it changes; and that of one
/// resolution beside its neighbours and of a measurement.
const REST_DB: f64 = 0.8;
const REST_LENGTHS: Place = [0.8, 0.5];
const NOISE_DB: f64 = 0.1;
/// Decibels per unit of ln(squared error).
const DB: f64 = -10.0 / std::f64::consts::LN_10;

impl Quality {
    /// Through decibels measured at some places, at least one.
    pub fn through(places: Vec<Place>, psnr_db: &[f64]) -> Process<Self> {
        let mean = psnr_db.iter().sum::<f64>() / psnr_db.len() as f64;
        // Both causes alike in the middle.
        let half = mean / DB - std::f64::consts::LN_2;
        let expected = [half, POWERS[0], half, POWERS[1]];
        let fitted = fit(&places, psnr_db, expected);
        let prior = Self { fitted, expected: std::array::from_fn(|k| expected[k] - fitted[k]) };
        Process::new(prior, places, psnr_db)
    }
}

/// q, and how it changes with each of (a0, a1, b0, b1).
fn decibels(theta: &[f64; 4], at: &Place) -> (f64, [f64; 4]) {
    let [x, y] = [at[0] - ORIGIN[0], at[1] - ORIGIN[1]];
    let (a, b) = ((theta[0] + theta[1] * x).exp(), (theta[2] + theta[3] * y).exp());
    let (a_share, b_share) = (a / (a + b), b / (a + b));
    (DB * (a + b).ln(), [DB * a_share, DB * a_share * x, DB * b_share, DB * b_share * y])
}

/// The likeliest parameters: Levenberg and Marquardt's method on the misfit and the prior's.
fn fit(places: &[Place], psnr_db: &[f64], expected: [f64; 4]) -> [f64; 4] {
    let misfit = |theta: &[f64; 4]| -> f64 {
        let data: f64 = places.iter().zip(psnr_db).map(|(p, q)| ((decibels(theta, p).0 - q) / REST_DB).powi(2)).sum();
        data + (0..4).map(|k| ((theta[k] - expected[k]) / DOUBT[k]).powi(2)).sum::<f64>()
    };
    let (mut theta, mut damping) = (expected, 1e-2);
    let mut least = misfit(&theta);
    for _ in 0..40 {
        let (mut hessian, mut gradient) = ([0.0; 16], [0.0; 4]);
        for (p, q) in places.iter().zip(psnr_db) {
            let (value, slopes) = decibels(&theta, p);
            for i in 0..4 {
                gradient[i] -= slopes[i] * (value - q) / REST_DB.powi(2);
                for j in 0..4 {
                    hessian[4 * i + j] += slopes[i] * slopes[j] / REST_DB.powi(2);
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

impl Prior for Quality {
    fn mean(&self, at: &Place) -> f64 {
        let (value, slopes) = decibels(&self.fitted, at);
        value + (0..4).map(|k| slopes[k] * self.expected[k]).sum::<f64>()
    }

    fn covariance(&self, a: &Place, b: &Place) -> f64 {
        let (sa, sb) = (decibels(&self.fitted, a).1, decibels(&self.fitted, b).1);
        let form: f64 = (0..4).map(|k| sa[k] * sb[k] * DOUBT[k].powi(2)).sum();
        let near = |k: usize| smooth((a[k] - b[k]) / REST_LENGTHS[k]);
        form + REST_DB.powi(2) * near(0) * near(1)
    }

    fn noise(&self) -> f64 {
        NOISE_DB
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(r: f64, gamma: f64) -> Place {
        [r.ln(), gamma.ln()]
    }

    #[test]
    fn a_few_trials_tell_the_quality_of_all_others() {
        // Made up: error 2e-4 (245 / r)^2.2 + 1e-4 (gamma / 0.03)^1.2.
        let q =
            |p: &Place| DB * (2e-4 * (-2.2 * (p[0] - ORIGIN[0])).exp() + 1e-4 * (1.2 * (p[1] - ORIGIN[1])).exp()).ln();
        let places = vec![at(160.0, 0.004), at(160.0, 0.05), at(256.0, 0.012), at(256.0, 0.1), at(384.0, 0.02)];
        let values: Vec<f64> = places.iter().map(q).collect();
        let model = Quality::through(places, &values);
        for p in [at(512.0, 0.01), at(320.0, 0.03), at(700.0, 0.2)] {
            let found = model.predict(&p);
            let off = (found.mean - q(&p)).abs();
            assert!(off < 0.7 && off < 3.0 * found.deviation, "{found:?}, but {}", q(&p));
        }
    }

    #[test]
    fn a_curve_in_gamma_at_one_resolution_holds_at_others() {
        let ln_bytes = |p: &Place| 3.0 + 1.75 * p[0] - 0.4 * (p[1] + 6.0) + 0.05 * (p[1] + 4.0).powi(2);
        let mut places: Vec<Place> = (0..12).map(|n| [160_f64.ln(), -5.5 + 0.4 * f64::from(n)]).collect();
        places.push(at(240.0, 0.01));
        let values: Vec<f64> = places.iter().map(ln_bytes).collect();
        let model = Price::of_sizes(Representation::Vdi, places, &values);
        for p in [at(240.0, 0.1), at(400.0, 0.02)] {
            let found = model.predict(&p);
            let off = (found.mean - ln_bytes(&p)).abs();
            assert!(off < 0.05 && off < 3.0 * found.deviation, "{found:?}, but {}", ln_bytes(&p));
        }
    }
}
