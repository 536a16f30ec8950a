//! Generation timed by itself, where a contract limits it. That takes a fraction of a whole trial, most of which is coding and
//! drawing: so candidates that may break the limit are timed first, and those that do are not encoded.

use super::gaussian_process::{ParamPoint, Prediction, param_point};
use crate::Contract;
use lamina_model::{GenerationParams, Representation};
use std::time::Duration;

/// The most candidates timed.
const MOST: usize = 24;
/// Standard deviations below the mean that one value in a hundred lies.
const ONE_IN_HUNDRED: f64 = 2.3;

/// Generation times taken by themselves, and the limit they have to keep.
pub(super) struct TimeScreening {
    limit_ms: Option<f64>,
    known: Vec<(GenerationParams, f64)>,
}

impl TimeScreening {
    /// None yet, of candidates that are all of one representation.
    pub(super) fn new(contract: &Contract, representation: Representation) -> Self {
        Self { limit_ms: contract.generation_limit_ms(representation), known: Vec::new() }
    }

    /// True if `params` should be timed before they are measured: where a model predicts the logarithm of their milliseconds, if
    /// it leaves it open that they break the limit.
    pub(super) fn want(&self, params: &GenerationParams, predicted: Option<Prediction>) -> bool {
        let surely_fast = |limit: f64| predicted.is_some_and(|p| p.mean + ONE_IN_HUNDRED * p.deviation <= limit.ln());
        self.can_be_timed(params) && self.limit_ms.is_some_and(|limit| !surely_fast(limit))
    }

    fn can_be_timed(&self, params: &GenerationParams) -> bool {
        self.known.len() < MOST && self.of(params).is_none()
    }

    /// Takes in how long generation with `params` took.
    pub(super) fn add(&mut self, params: &GenerationParams, time: Duration) {
        self.known.push((*params, 1e3 * time.as_secs_f64()));
    }

    /// True if `params` were timed and break the limit.
    pub(super) fn too_slow(&self, params: &GenerationParams) -> bool {
        self.of(params).zip(self.limit_ms).is_some_and(|(ms, limit_ms)| ms > limit_ms)
    }

    /// The logarithm of milliseconds to go by where `predicted` is what a model says; `None` for what is too slow. As timing
    /// costs little, what can still be timed counts as fast enough if it may be, so that the best of those is timed first.
    pub(super) fn expected(&self, params: &GenerationParams, predicted: Prediction) -> Option<Prediction> {
        let Some(limit) = self.limit_ms.map(f64::ln) else { return Some(predicted) };
        let exactly = |mean| Prediction { mean, deviation: 0.0 };
        if let Some(ms) = self.of(params) {
            return Some(exactly(ms.ln())).filter(|at| at.mean <= limit);
        }
        if !self.can_be_timed(params) {
            return Some(predicted);
        }
        let may_be = predicted.mean - ONE_IN_HUNDRED * predicted.deviation <= limit;
        // A hair below the limit, which the exponential of its logarithm may exceed.
        may_be.then(|| exactly(predicted.mean.min(limit - 1e-9)))
    }

    /// The fastest of those timed.
    pub(super) fn fastest(&self) -> Option<GenerationParams> {
        self.known.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(params, _)| *params)
    }

    /// Where they were taken, and milliseconds.
    pub(super) fn all(&self) -> impl Iterator<Item = (ParamPoint, f64)> {
        self.known.iter().map(|(params, ms)| (param_point(params), *ms))
    }

    fn of(&self, params: &GenerationParams) -> Option<f64> {
        self.known.iter().find(|(known, _)| known == params).map(|(_, ms)| *ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(r: u32) -> GenerationParams {
        GenerationParams::vdi(r, 0.02).unwrap()
    }

    #[test]
    fn what_may_be_fast_enough_counts_as_fast_until_it_is_timed() {
        let limited: Contract = "time <= 20ms".parse().unwrap();
        let mut screening = TimeScreening::new(&limited, Representation::Vdi);
        let expected = |screening: &TimeScreening, r, ms: f64, deviation| {
            let found = screening.expected(&params(r), Prediction { mean: ms.ln(), deviation })?;
            assert_eq!(found.deviation, 0.0);
            Some(found.mean.exp())
        };
        let near = |found: Option<f64>, ms: f64| found.is_some_and(|f| (f - ms).abs() < 1e-6 && f <= 20.0);
        let predicts = |ms: f64, deviation| Some(Prediction { mean: ms.ln(), deviation });
        assert!(screening.want(&params(100), None) && !screening.too_slow(&params(100)));
        assert!(
            screening.want(&params(100), predicts(17.0, 0.1)) && !screening.want(&params(100), predicts(15.0, 0.1))
        );
        assert!(near(expected(&screening, 100, 15.0, 0.3), 15.0));
        assert!(near(expected(&screening, 100, 24.0, 0.1), 20.0), "a chance of one in thirty");
        assert_eq!(expected(&screening, 100, 26.0, 0.1), None, "of one in two hundred");
        screening.add(&params(100), Duration::from_millis(19));
        screening.add(&params(110), Duration::from_millis(21));
        assert!(!screening.want(&params(100), None) && !screening.want(&params(110), None));
        assert_eq!(screening.fastest(), Some(params(100)));
        assert!(near(expected(&screening, 100, 26.0, 0.1), 19.0) && !screening.too_slow(&params(100)));
        assert!(expected(&screening, 110, 15.0, 0.3).is_none() && screening.too_slow(&params(110)));
        for r in 200..222 {
            screening.add(&params(r), Duration::from_millis(50));
        }
        let predicted = Prediction { mean: 9.0, deviation: 0.3 };
        assert!(
            !screening.want(&params(300), None) && screening.expected(&params(300), predicted) == Some(predicted),
            "enough"
        );
        assert!(screening.too_slow(&params(200)) && screening.expected(&params(200), predicted).is_none());
    }

    #[test]
    fn nothing_is_timed_where_generation_alone_is_not_limited() {
        let volume = GenerationParams::volume(64, 0.02).unwrap();
        for (contract, params) in
            [("size <= 20kB", params(64)), ("time+encoding <= 20ms", params(64)), ("time <= 20ms", volume)]
        {
            let screening = TimeScreening::new(&contract.parse().unwrap(), params.representation());
            let predicted = Prediction { mean: 9.0, deviation: 0.1 };
            assert!(
                !screening.want(&params, None) && screening.expected(&params, predicted) == Some(predicted),
                "{contract}"
            );
        }
    }
}
