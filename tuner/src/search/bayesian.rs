//! Bayesian optimization over one representation: finds the best parameters with a few trials.
//!
//! Surrogate models of size, time and quality ([`super::surrogates`]) say what each candidate may be worth under the contract; the
//! one of the greatest expected improvement is measured next ([`super::acquisition`]), until none is expected to improve by more
//! than some hundredths of a decibel. Where sizes matter, those of some gammas come from one march. The first trial is already the
//! best by what most data give ([`super::first_trial`]). Where generation has to be fast, what may be too slow is timed first, the
//! best of what may be fast enough before all else: what breaks that limit is not encoded. Quality is first measured on few of
//! the sampled pixels ([`super::contenders`]). At the end parameters between the candidates fill a limit on size
//! ([`super::limit_filling`]).

use super::acquisition::{Acquisition, ExpectedImprovement};
use super::candidates::Resolved;
use super::deadline::Deadline;
use super::time_screening::TimeScreening;
use crate::Contract;
use crate::evaluator::{Batches, Evaluator, TrialError};
use crate::tune::Trial;
use crate::utility::Utility;
use lamina_model::{GenerationParams, Invalid, Representation};

/// The most trials of one representation.
const MOST_TRIALS: usize = 24;
/// The most trials while nothing is hoped for any more, but to come nearer to the limits.
const MOST_NEARER: usize = 10;
/// How much larger an improvement has to be where trials are dear, at most.
const DEAREST: f64 = 5.0;
/// How much larger an improvement among the candidates has to be where filling the limit goes on between them.
const BEFORE_FILLING: f64 = 10.0;
/// The least probability that is worth a trial.
const HOPE: f64 = 0.005;
/// Trials whose quality is measured even if they break another limit: the model of quality knows little.
const LITTLE_KNOWN: usize = 2;

impl Acquisition {
    /// With something in hand: if it is expected to get noticeably better; else if there is hope, or for some trials that of
    /// coming nearer by a hundredth.
    fn worth_trying(&self, search: &BayesianSearch) -> bool {
        match search.least_cost() {
            Some(least) => self.params.is_some_and(|p| {
                let coarser = if search.fills_limit() { BEFORE_FILLING } else { 1.0 };
                self.improvement > coarser * search.tolerance(&p, least)
            }),
            None => self.feasible > HOPE || (search.tried.len() < MOST_NEARER && self.nearer > 0.01),
        }
    }
}

/// A search among the candidates of one representation.
pub(super) struct BayesianSearch<'a> {
    pub(super) contract: &'a Contract,
    pub(super) utility: Utility,
    pub(super) representation: Representation,
    pub(super) candidates: Vec<GenerationParams>,
    /// Sizes from marches, bytes.
    pub(super) marched: Vec<(GenerationParams, u64)>,
    pub(super) tried: Vec<Trial>,
    /// Trials of an earlier step.
    pub(super) carried: Vec<Trial>,
    pub(super) screening: TimeScreening,
    refused: Vec<GenerationParams>,
    pub(super) expected: ExpectedImprovement,
    /// Batches that there are.
    pub(super) batches: usize,
    /// Sample points on the longest side of the data.
    pub(super) longest_side: u32,
    /// Cost of the best that other candidates gave.
    pub(super) to_beat: Option<f64>,
}

impl<'a> BayesianSearch<'a> {
    /// Without candidates yet. Of the trials of an earlier step it takes those of its representation.
    pub(super) fn new(
        contract: &'a Contract,
        representation: Representation,
        batches: usize,
        longest_side: u32,
        carried: &[Trial],
    ) -> Self {
        let of_these = carried.iter().filter(|r| r.params.representation() == representation);
        let carried: Vec<Trial> = of_these.cloned().collect();
        Self {
            contract,
            utility: contract.utility(),
            representation,
            candidates: Vec::new(),
            marched: Vec::new(),
            tried: Vec::new(),
            expected: ExpectedImprovement::new(contract.with_psnr_for_ssim(carried.iter())),
            carried,
            screening: TimeScreening::new(contract, representation),
            refused: Vec::new(),
            batches,
            longest_side,
            to_beat: None,
        }
    }

    /// Takes candidates, with what finding them has measured.
    pub(super) fn take(&mut self, resolved: Resolved) {
        self.candidates = resolved.candidates;
        self.marched.extend(resolved.known.into_iter().map(|(params, cost)| (params, cost.size_bytes)));
    }

    /// All trials, and what would be tried next.
    pub(super) async fn run(
        mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        progress: &mut (impl FnMut(&Trial) + Send),
    ) -> Result<(Vec<Trial>, Acquisition), TrialError> {
        self.first_trial(trial, progress).await?;
        let mut next;
        loop {
            next = self.most_promising();
            while self.tried.len() < MOST_TRIALS.min(self.candidates.len()) {
                let Some(params) = next.params.filter(|_| next.worth_trying(&self)) else { break };
                if !trial.enough() {
                    break;
                }
                if next.in_doubt {
                    self.time(trial, &params).await?;
                } else {
                    self.measure(trial, &params, progress).await?;
                }
                next = self.most_promising();
            }
            // More pixels may tell other than the first ones did: then something else may have become worth trying.
            if !self.settle(trial).await? {
                break;
            }
        }
        let before = self.least_cost();
        self.fill_limit(trial, progress).await?;
        let gained = before.zip(self.least_cost()).map_or(0.0, |(before, least)| before - least);
        next.improvement = (next.improvement - gained).max(0.0);
        Ok((self.tried, next))
    }

    /// Measures some parameters; quality only of what keeps the other limits, unless nothing is known of it yet.
    pub(super) async fn measure(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        params: &GenerationParams,
        progress: &mut (impl FnMut(&Trial) + Send),
    ) -> Result<(), TrialError> {
        let Some(n) = self.measure_cost(trial, params).await? else { return Ok(()) };
        let known = self.tried.iter().filter(|r| r.measured.quality.batches() > 0).count();
        if self.contract.excess(&self.tried[n].measured.cost, f64::NAN) <= 0.0 || known < LITTLE_KNOWN {
            self.measure_quality(trial, n).await?;
        }
        self.tried.get(n).into_iter().for_each(progress);
        Ok(())
    }

    /// Adds a row with the cost of `params` alone; `None` if that was not possible, or was done before.
    pub(super) async fn measure_cost(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        params: &GenerationParams,
    ) -> Result<Option<usize>, TrialError> {
        if !self.is_new(params) || !trial.enough() {
            return Ok(None);
        }
        match trial.evaluate(params, Batches::None).await? {
            Ok(measured) => {
                self.tried.push(Trial { params: *params, cost: f64::INFINITY, measured });
                Ok(Some(self.tried.len() - 1))
            }
            Err(reason) => {
                self.leave_out(params, &reason);
                Ok(None)
            }
        }
    }

    /// Measures the quality of row `n` on the first pixels; removes it if no viewer can show it.
    pub(super) async fn measure_quality(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        n: usize,
    ) -> Result<(), TrialError> {
        let params = self.tried[n].params;
        match trial.evaluate(&params, Batches::first(self.first_batches() as u32)).await? {
            Ok(measured) => {
                self.contract.check_ssim(&measured.quality)?;
                self.tried[n].measured = measured;
            }
            Err(reason) => {
                self.leave_out(&params, &reason);
                self.tried.remove(n);
            }
        }
        self.update_costs();
        Ok(())
    }

    /// Times generation alone.
    pub(super) async fn time(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        params: &GenerationParams,
    ) -> Result<(), TrialError> {
        if !self.is_new(params) || !trial.enough() {
            return Ok(());
        }
        match trial.time(params).await? {
            Ok(time) => self.screening.add(params, time),
            Err(reason) => self.leave_out(params, &reason),
        }
        Ok(())
    }

    /// True if nothing was measured of it yet, nor refused.
    pub(super) fn is_new(&self, params: &GenerationParams) -> bool {
        !self.refused.contains(params) && self.tried.iter().all(|r| r.params != *params)
    }

    fn leave_out(&mut self, params: &GenerationParams, reason: &Invalid) {
        tracing::warn!(%reason, "candidate left out");
        self.refused.push(*params);
    }

    pub(super) fn least_cost(&self) -> Option<f64> {
        let least = self.tried.iter().map(|r| r.cost).chain(self.to_beat).fold(f64::INFINITY, f64::min);
        (least < f64::INFINITY).then_some(least)
    }

    /// How far a row is from keeping all limits.
    pub(super) fn distance_of(&self, row: &Trial) -> f64 {
        let cost = &row.measured.cost;
        let ms = self.contract.time_of(cost);
        self.expected.contract.distance_of(cost.size_bytes as f64, ms, self.estimated_db(row))
    }

    /// The least resolution of the candidates.
    pub(super) fn lowest(&self) -> u32 {
        self.candidates.iter().map(GenerationParams::resolution).min().unwrap_or(1)
    }

    /// An improvement too small to look for: a larger one where trials are dear.
    pub(super) fn tolerance(&self, params: &GenerationParams, least: f64) -> f64 {
        let dearer = f64::from(params.resolution()) / f64::from(self.lowest());
        dearer.min(DEAREST)
            * match self.utility {
                Utility::Quality => 0.01,
                Utility::Size | Utility::Time => 0.002 * least.abs().max(1e-9),
                Utility::Expression(_) => 0.0005 * least.abs().max(1e-9),
            }
    }

    fn most_promising(&self) -> Acquisition {
        let none = Acquisition::default();
        if self.tried.is_empty() {
            return none;
        }
        let models = self.surrogates();
        let least = self.least_cost();
        let nearest = self.tried.iter().map(|r| self.distance_of(r)).fold(f64::INFINITY, f64::min);
        let untried = self.candidates.iter().filter(|c| self.is_new(c));
        let expected = |params: &GenerationParams| {
            let mut of = models.predict(params);
            let in_doubt = least.is_some() && self.screening.want(params, Some(of[1]));
            if least.is_some() {
                of[1] = self.screening.expected(params, of[1])?;
            }
            Some(Acquisition { params: Some(*params), in_doubt, ..self.expected.expectation(&of, least, nearest) })
        };
        let all: Vec<Acquisition> = untried.filter_map(expected).collect();
        let hope = all.iter().map(|p| p.feasible).fold(0.0, f64::max);
        // Without anything in hand, what is surest to keep the limits, and of those the best; without hope, what comes nearest.
        let worth = |p: &Acquisition| match least {
            Some(_) => p.improvement,
            None if hope > HOPE && p.feasible == 0.0 => f64::NEG_INFINITY,
            None if hope > HOPE => (p.feasible * 20.0).round() * 1e6 + p.improvement,
            None => p.nearer,
        };
        // A large one that is not worth what its trial costs does not hide another that is.
        let order = |a: &Acquisition, b: &Acquisition| {
            a.worth_trying(self).cmp(&b.worth_trying(self)).then(worth(a).total_cmp(&worth(b)))
        };
        let best = all.into_iter().max_by(order).unwrap_or(none);
        if least.is_none() { Acquisition { feasible: hope, ..best } } else { best }
    }
}
