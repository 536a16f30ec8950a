//! Gaussian processes over generation parameters: what measurements so far say about parameters not measured.
//!
//! A few dozen points: everything is dense and small (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
//! chapter 2; a mean with uncertain coefficients is covariance, section 2.7).

use lamina_model::GenerationParams;

/// Below this gamma hardly anything merges: one gamma is about as good as another.
const GAMMA_FLOOR: f64 = 0.003;

/// Parameters as a point: (ln r, ln gamma), the latter levelled off towards 0.
pub(super) type ParamPoint = [f64; 2];

/// The point of some parameters.
pub fn param_point(params: &GenerationParams) -> ParamPoint {
    [f64::from(params.resolution()).ln(), (params.gamma() + GAMMA_FLOOR).ln()]
}

/// A prediction of a value: mean and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Expected value.
    pub mean: f64,
    /// Standard deviation, noise of a measurement left out.
    pub deviation: f64,
}

/// What is expected of a quantity before it is measured anywhere.
pub trait Prior {
    /// Expected value at a point.
    fn mean(&self, at: &ParamPoint) -> f64;
    /// Covariance of the values at two points.
    fn covariance(&self, a: &ParamPoint, b: &ParamPoint) -> f64;
    /// Standard deviation of one measurement about the value.
    fn noise(&self) -> f64;
    /// Standard deviation of what all values of another step differ by.
    fn step_offset(&self) -> f64 {
        0.0
    }
    /// Standard deviation of what each value of another step differs by beside that.
    fn step_remainder(&self) -> f64 {
        0.0
    }
}

/// A value known at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Where.
    pub at: ParamPoint,
    /// The value.
    pub value: f64,
    /// It was measured on an earlier step, which may differ from this one.
    pub carried: bool,
}

impl Observation {
    /// A value measured on this step.
    pub fn new(at: ParamPoint, value: f64) -> Self {
        Self { at, value, carried: false }
    }
}

/// One quantity over all parameters.
#[derive(Debug)]
pub struct GaussianProcess<P> {
    prior: P,
    points: Vec<ParamPoint>,
    /// Lower triangle of the covariance's Cholesky factor, row by row.
    cholesky: Vec<f64>,
    weights: Vec<f64>,
}

impl<P: Prior> GaussianProcess<P> {
    /// Conditioned on `observations`. The values of an earlier step differ from this step's by an offset that all of them
    /// share, and each by a remainder of its own.
    pub fn new(prior: P, observations: &[Observation]) -> Self {
        let n = observations.len();
        let (offset, remainder) = (prior.step_offset(), prior.step_remainder());
        let mut cholesky = vec![0.0; n * n];
        for (i, a) in observations.iter().enumerate() {
            for (j, b) in observations[..=i].iter().enumerate() {
                let shared = if a.carried && b.carried { offset.powi(2) } else { 0.0 };
                cholesky[i * n + j] = prior.covariance(&a.at, &b.at) + shared;
            }
            let own = if a.carried { remainder.powi(2) } else { 0.0 };
            cholesky[i * n + i] += prior.noise().powi(2) + own;
        }
        factor(&mut cholesky, n);
        let rest: Vec<f64> = observations.iter().map(|o| o.value - prior.mean(&o.at)).collect();
        let weights = backward(&cholesky, forward(&cholesky, &rest));
        Self { prior, points: observations.iter().map(|o| o.at).collect(), cholesky, weights }
    }

    /// The value at a point.
    pub fn predict(&self, at: &ParamPoint) -> Prediction {
        let to: Vec<f64> = self.points.iter().map(|p| self.prior.covariance(p, at)).collect();
        let mean = self.prior.mean(at) + to.iter().zip(&self.weights).map(|(k, w)| k * w).sum::<f64>();
        let known: f64 = forward(&self.cholesky, &to).iter().map(|v| v * v).sum();
        let variance = self.prior.covariance(at, at) - known;
        Prediction { mean, deviation: variance.max(0.0).sqrt() }
    }
}

/// The squared exponential covariance, of a very smooth function, at distance `d` in units of its length scale.
pub(super) fn squared_exponential(d: f64) -> f64 {
    (-0.5 * d * d).exp()
}

/// The Matern 5/2 covariance: a function that bends more sharply.
pub(super) fn matern52(d: f64) -> f64 {
    let s = 5_f64.sqrt() * d.abs();
    (1.0 + s + s * s / 3.0) * (-s).exp()
}

/// Cholesky's factor of the symmetric matrix whose lower triangle is given, in at. A pivot that rounding made negative
/// becomes tiny: that point then adds nothing.
pub(super) fn factor(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
            let rest = a[i * n + j] - dot;
            a[i * n + j] = if i == j { rest.max(1e-12).sqrt() } else { rest / a[j * n + j] };
        }
    }
}

/// Solves L x = b.
pub(super) fn forward(l: &[f64], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut x: Vec<f64> = Vec::with_capacity(n);
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x.push((b[i] - dot) / l[i * n + i]);
    }
    x
}

/// Solves L^T x = b.
pub(super) fn backward(l: &[f64], mut x: Vec<f64>) -> Vec<f64> {
    let n = x.len();
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Wavy;
    impl Prior for Wavy {
        fn mean(&self, _: &ParamPoint) -> f64 {
            1.0
        }
        fn covariance(&self, a: &ParamPoint, b: &ParamPoint) -> f64 {
            squared_exponential(a[0] - b[0]) * matern52(a[1] - b[1])
        }
        fn noise(&self) -> f64 {
            1e-4
        }
        fn step_offset(&self) -> f64 {
            2.0
        }
        fn step_remainder(&self) -> f64 {
            0.1
        }
    }

    #[test]
    fn points_are_met_and_doubt_grows_away_from_them() {
        let points: Vec<ParamPoint> = (0..16).map(|n| [0.4 * f64::from(n % 4), 0.4 * f64::from(n / 4)]).collect();
        let wave = |p: &ParamPoint| 1.0 + (1.3 * p[0]).sin() * (0.8 * p[1]).cos();
        let observed: Vec<Observation> = points.iter().map(|p| Observation::new(*p, wave(p))).collect();
        let fit = GaussianProcess::new(Wavy, &observed);
        for p in &points {
            assert!((fit.predict(p).mean - wave(p)).abs() < 1e-3 && fit.predict(p).deviation < 1e-3);
        }
        let between = fit.predict(&[0.6, 0.6]);
        assert!((between.mean - wave(&[0.6, 0.6])).abs() < 0.02 && between.deviation < 0.1, "{between:?}");
        let far = fit.predict(&[9.0, 9.0]);
        assert!((far.mean - 1.0).abs() < 1e-3 && (far.deviation - 1.0).abs() < 1e-3, "{far:?}");
    }

    #[test]
    fn one_point_halves_the_doubt_as_bayes_says() {
        // Prior N(1, 1), one measurement 3 with noise 1e-4: at covariance c, mean 1 + 2 c, variance 1 - c^2.
        let fit = GaussianProcess::new(Wavy, &[Observation::new([0.0, 0.0], 3.0)]);
        let c = squared_exponential(1.0);
        let at = fit.predict(&[1.0, 0.0]);
        assert!((at.mean - (1.0 + 2.0 * c)).abs() < 1e-6 && (at.deviation - (1.0 - c * c).sqrt()).abs() < 1e-6);
    }

    #[test]
    fn one_measurement_tells_by_how_much_an_earlier_step_differs() {
        // The field is the same but for an offset of 2 on the earlier step: measured there at eight points, here at one.
        let wave = |p: &ParamPoint| 1.0 + (0.7 * p[0]).sin();
        let line: Vec<ParamPoint> = (0..8).map(|n| [0.3 * f64::from(n), 0.0]).collect();
        let mut known: Vec<Observation> =
            line.iter().map(|p| Observation { at: *p, value: wave(p) + 2.0, carried: true }).collect();
        let before = GaussianProcess::new(Wavy, &known).predict(&line[7]);
        assert!(before.deviation > 0.5, "an earlier step alone leaves much open: {before:?}");
        known.push(Observation::new(line[0], wave(&line[0])));
        let after = GaussianProcess::new(Wavy, &known).predict(&line[7]);
        assert!((after.mean - wave(&line[7])).abs() < 0.2 && after.deviation < 0.3, "{after:?}");
    }

    #[test]
    fn triangles_solve_what_they_factor() {
        let mut a = [4.0, 0.0, 0.0, 2.0, 5.0, 0.0, -2.0, 1.0, 6.0];
        factor(&mut a, 3);
        let x = backward(&a, forward(&a, &[0.0, 23.0, 26.0]));
        // [4 2 -2; 2 5 1; -2 1 6] x = b has x = (-2/11, 54/11 - ..): checked by multiplying back.
        let back =
            [4.0 * x[0] + 2.0 * x[1] - 2.0 * x[2], 2.0 * x[0] + 5.0 * x[1] + x[2], -2.0 * x[0] + x[1] + 6.0 * x[2]];
        assert!(back.iter().zip([0.0, 23.0, 26.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
    }
}
