//! Surrogate models of size, time and quality over the candidates of one representation, through all that is known of them.

use super::bayesian::BayesianSearch;
use super::gaussian_process::{GaussianProcess, Observation, Prediction, param_point};
use super::priors::{CostPrior, QualityPrior};
use crate::tune::Trial;
use lamina_model::GenerationParams;

/// What nothing tells yet is anything: logarithm of 10 kB or ms at 245 rays, and its standard deviation.
const UNKNOWN: Prediction = Prediction { mean: 9.0, deviation: 3.0 };

/// The three models.
pub(super) struct Surrogates {
    sizes: Option<GaussianProcess<CostPrior>>,
    times: Option<GaussianProcess<CostPrior>>,
    qualities: GaussianProcess<QualityPrior>,
}

impl Surrogates {
    /// Logarithms of bytes and milliseconds, and decibels.
    pub(super) fn predict(&self, params: &GenerationParams) -> [Prediction; 3] {
        let at = param_point(params);
        let cost = |known: &Option<GaussianProcess<CostPrior>>| {
            let unknown = || Prediction { mean: UNKNOWN.mean + 1.75 * (at[0] - 5.5) - 0.3 * at[1], ..UNKNOWN };
            known.as_ref().map_or_else(unknown, |known| known.predict(&at))
        };
        [cost(&self.sizes), cost(&self.times), self.qualities.predict(&at)]
    }

    /// True if something was timed.
    pub(super) fn know_times(&self) -> bool {
        self.times.is_some()
    }

    /// True if the size of something is known.
    pub(super) fn know_sizes(&self) -> bool {
        self.sizes.is_some()
    }
}

impl BayesianSearch<'_> {
    /// The models as of now.
    pub(super) fn surrogates(&self) -> Surrogates {
        let size = |bytes: u64| (bytes.max(1) as f64).ln();
        let carried = |r: &Trial, value: f64| Observation { at: param_point(&r.params), value, carried: true };
        let new = |params: &GenerationParams, value: f64| Observation::new(param_point(params), value);
        let ms = |r: &Trial| self.contract.time_of(&r.measured.cost);
        let mut sizes: Vec<Observation> = self.marched.iter().map(|(p, bytes)| new(p, size(*bytes))).collect();
        let tried = self.tried.iter().filter(|r| !self.marched.iter().any(|(p, _)| *p == r.params));
        sizes.extend(tried.map(|r| new(&r.params, size(r.measured.cost.size_bytes))));
        sizes.extend(self.carried.iter().map(|r| carried(r, size(r.measured.cost.size_bytes))));
        let mut times: Vec<Observation> = self.tried.iter().map(|r| new(&r.params, ms(r).max(1e-6).ln())).collect();
        times.extend(self.screening.all().map(|(at, ms)| Observation::new(at, ms.max(1e-6).ln())));
        times.extend(self.carried.iter().map(|r| carried(r, ms(r).max(1e-6).ln())));
        let mut qualities: Vec<Observation> = self.tried.iter().map(|r| new(&r.params, self.estimated_db(r))).collect();
        qualities.extend(self.carried.iter().map(|r| carried(r, r.measured.quality.psnr_db())));
        qualities.retain(|o| o.value.is_finite());
        let model = |known: Vec<Observation>, of: &dyn Fn(&[Observation]) -> GaussianProcess<CostPrior>| {
            (!known.is_empty()).then(|| of(&known))
        };
        Surrogates {
            sizes: model(sizes, &|known| CostPrior::of_sizes(self.representation, known)),
            times: model(times, &CostPrior::of_times),
            qualities: QualityPrior::through(self.representation, self.longest_side, &qualities),
        }
    }
}
