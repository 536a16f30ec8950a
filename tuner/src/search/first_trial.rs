//! The first trial: the best under the contract by what most data give and by sizes predicted from one march.

use super::bayesian::BayesianSearch;
use super::deadline::Deadline;
use super::gaussian_process::{Prediction, param_point};
use super::surrogates::Surrogates;
use crate::evaluator::{Evaluator, TrialError};
use crate::tune::Trial;
use crate::utility::Utility;
use lamina_model::{GenerationParams, Representation};
use std::cmp::Ordering;

/// Gammas of a march of VDIs and of volumes.
const MARCH: usize = 12;
const VOLUME_MARCH: usize = 8;
/// Candidates looked at for a first one that keeps the limits on size and time.
const ATTEMPTS: usize = 3;
/// Share of a limit on size and on time that the first trial is to take, and decibels above a limit on quality.
const SIZE_SHARE: f64 = 0.9;
const TIME_SHARE: f64 = 0.8;
const MARGIN_DB: f64 = 1.0;
/// Standard deviations that make sure.
const SURE: f64 = 2.0;

impl BayesianSearch<'_> {
    /// Tries the best trial of an earlier step, or else the candidate that promises most: of what turns out to break a limit on
    /// size or time only that is measured, and another is looked for.
    pub(super) async fn first_trial(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        progress: &mut (impl FnMut(&Trial) + Send),
    ) -> Result<(), TrialError> {
        if let Some(params) = self.best_carried() {
            self.measure(trial, &params, progress).await?;
        }
        if self.contract.weighs_size() && self.marched.is_empty() {
            self.march(trial).await?;
        }
        // What may be ten times too large is not worth a long trial where something else serves.
        let unknown = self.contract.limits.size_bytes.is_some() && !self.surrogates().know_sizes();
        if self.to_beat.is_some() && (unknown || self.all_too_large()) {
            return Ok(());
        }
        for _ in 0..ATTEMPTS {
            if self.tried.iter().any(|r| r.cost < f64::INFINITY) {
                return Ok(());
            }
            let Some(params) = self.best_by_prior() else { break };
            if self.tried.iter().any(|r| r.params == params) {
                break;
            }
            if self.screening.want(&params, None) {
                self.time(trial, &params).await?;
                if self.screening.too_slow(&params) {
                    continue;
                }
            }
            self.measure_cost(trial, &params).await?;
            // Time for a quality is kept.
            if !trial.enough_for(3) {
                break;
            }
        }
        self.measure_best(trial, progress).await
    }

    /// Measures the quality of the best of what was only looked at so far. The models need some quality to begin with, even if
    /// nothing keeps the other limits.
    async fn measure_best(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        progress: &mut (impl FnMut(&Trial) + Send),
    ) -> Result<(), TrialError> {
        if let Some(fastest) = self.screening.fastest().filter(|_| self.tried.is_empty()) {
            self.measure_cost(trial, &fastest).await?;
        }
        let models = self.surrogates();
        let rank = |n: &usize| {
            let row = &self.tried[*n];
            (self.contract.excess(&row.measured.cost, f64::NAN).max(0.0), self.expected_cost(&models, &row.params).1)
        };
        let best = (0..self.tried.len()).min_by(|a, b| compare(rank(a), rank(b)));
        let Some(best) = best.filter(|_| self.tried.iter().all(|r| r.measured.quality.batches() == 0)) else {
            return Ok(());
        };
        let params = self.tried[best].params;
        // Its cost is known: one measurement is all that it takes.
        if trial.enough_for(1) {
            self.measure_quality(trial, best).await?;
        }
        let (best, others): (Vec<&Trial>, Vec<&Trial>) = self.tried.iter().partition(|r| r.params == params);
        others.into_iter().chain(best).for_each(progress);
        Ok(())
    }

    /// True if even the smallest candidate breaks the limit on size.
    fn all_too_large(&self) -> bool {
        let models = self.surrogates();
        let surely_above = |limit: f64| {
            let least = |p: &GenerationParams| {
                let size = models.predict(p)[0];
                size.mean - SURE * size.deviation
            };
            self.candidates.iter().all(|p| least(p) > limit.ln())
        };
        models.know_sizes() && self.contract.limits.size_bytes.is_some_and(|limit| surely_above(limit as f64))
    }

    /// Of an earlier step's trials the best under the contract.
    fn best_carried(&self) -> Option<GenerationParams> {
        let cost = |r: &Trial| self.contract.cost(&r.measured);
        let kept = self.carried.iter().filter(|r| cost(r) < f64::INFINITY);
        kept.min_by(|a, b| cost(a).total_cmp(&cost(b))).map(|r| r.params)
    }

    /// Sizes of some gammas at one resolution: of VDIs at the lowest, which costs least; of volumes nearer to the highest,
    /// because how their sizes grow with resolution is less sure.
    async fn march(&mut self, trial: &mut Deadline<'_, impl Evaluator>) -> Result<(), TrialError> {
        // Trials tell as much, only less of it.
        if !trial.enough_for(MARCH as u32 / 2) {
            return Ok(());
        }
        let mut resolutions: Vec<u32> = self.candidates.iter().map(GenerationParams::resolution).collect();
        resolutions.sort_unstable();
        resolutions.dedup();
        let (count, at) = match self.representation {
            Representation::Vdi => (MARCH, 0),
            // Seven resolutions to a factor of four: the fifth takes a quarter of what all points take.
            Representation::Volume => (VOLUME_MARCH, 2 * resolutions.len() / 3),
        };
        let Some(&resolution) = resolutions.get(at) else { return Ok(()) };
        let mut line: Vec<GenerationParams> =
            self.candidates.iter().filter(|p| p.resolution() == resolution).copied().collect();
        line.sort_by(|a, b| a.gamma().total_cmp(&b.gamma()));
        let Some((first, last)) = line.first().copied().zip(line.last().copied()) else { return Ok(()) };
        let (low, high) = (param_point(&first)[1], param_point(&last)[1]);
        let wanted = (0..count).map(|k| low + (high - low) * k as f64 / (count - 1) as f64);
        let off = |p: &GenerationParams, y: f64| (param_point(p)[1] - y).abs();
        let pick = |y: f64| line.iter().min_by(|a, b| off(a, y).total_cmp(&off(b, y))).copied();
        let mut picked: Vec<GenerationParams> = wanted.filter_map(pick).collect();
        picked.dedup();
        let gammas: Vec<f64> = picked.iter().map(GenerationParams::gamma).collect();
        match trial.inner().sizes(&first, &gammas).await {
            Ok(costs) => self.marched = picked.into_iter().zip(costs).map(|(p, c)| (p, c.size_bytes)).collect(),
            // What the trials themselves will say, candidate by candidate.
            Err(TrialError::Invalid(_)) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// The candidate that costs least of those expected to keep the contract with a margin, or else comes nearest to that. One
    /// whose cost is known, if it is about as good.
    fn best_by_prior(&self) -> Option<GenerationParams> {
        let models = self.surrogates();
        let measurable = |p: &&GenerationParams| self.is_new(p) && !self.screening.too_slow(p);
        // While times or sizes are unknown the first one is no extreme; nor where nothing limits what a VDI costs.
        let limits_time = self.contract.limits.time_ms.is_some() && !models.know_times();
        let limits_size = self.contract.limits.size_bytes.is_some() && !models.know_sizes();
        let unlimited = self.utility == Utility::Quality
            && self.representation == Representation::Vdi
            && self.contract.limits.size_bytes.is_none()
            && self.contract.limits.time_ms.is_none();
        let highest = self.candidates.iter().map(GenerationParams::resolution).max().unwrap_or(1);
        let middle = (f64::from(self.lowest()) * f64::from(highest)).sqrt();
        let moderate =
            |p: &&GenerationParams| !(limits_time || limits_size || unlimited) || f64::from(p.resolution()) <= middle;
        let rank = |p: &GenerationParams| self.expected_cost(&models, p);
        let untried = self.candidates.iter().filter(measurable).filter(moderate).map(|p| (rank(p), *p));
        let best = untried.min_by(|(a, _), (b, _)| compare(*a, *b));
        let kept = self.tried.iter().filter(|r| self.contract.excess(&r.measured.cost, f64::NAN) <= 0.0);
        let known = kept.map(|r| (rank(&r.params).1, r.params)).min_by(|a, b| a.0.total_cmp(&b.0));
        match (best, known) {
            (Some(((excess, cost), _)), Some((known, params)))
                if excess > 0.0 || cost > known - self.worth_another(known) =>
            {
                Some(params)
            }
            (None, Some((_, params))) | (Some((_, params)), _) => Some(params),
            (None, None) => None,
        }
    }

    /// By how much another candidate has to be expected to be better for its cost to be measured before any quality.
    fn worth_another(&self, cost: f64) -> f64 {
        match self.utility {
            Utility::Quality => 1.0,
            Utility::Size | Utility::Time | Utility::Expression(_) => 0.05 * cost.abs(),
        }
    }

    /// By how much the expected figures exceed the limits less their margins, and what they cost.
    fn expected_cost(&self, models: &Surrogates, params: &GenerationParams) -> (f64, f64) {
        let [size, time, q] = models.predict(params);
        let typical = |p: Prediction| p.mean.exp();
        // What is not known yet is not exceeded.
        let size_bytes = if models.know_sizes() { typical(size) / SIZE_SHARE } else { 0.0 };
        let ms = if models.know_times() { typical(time) / TIME_SHARE } else { 0.0 };
        let excess = self.expected.contract.distance_of(size_bytes, ms, q.mean - MARGIN_DB).max(0.0);
        (excess, self.utility.cost(typical(size) as u64, q.mean, typical(time)))
    }
}

/// By what exceeds the limits, then by cost.
fn compare(a: (f64, f64), b: (f64, f64)) -> Ordering {
    a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
}
