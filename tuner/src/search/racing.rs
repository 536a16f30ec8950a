//! Finds the grid's best parameters with a few trials.
//!
//! Models of size, time and quality ([`super::models`]) say what each candidate may be worth under the contract; the one
//! expected to improve most on the best found is measured next (expected improvement: Jones, Schonlau and Welch, Efficient
//! Global Optimization of Expensive Black-Box Functions, 1998), until none is expected to improve by more than a
//! fiftieth of a decibel. Sizes of a dozen gammas come from one march at the lowest resolution, which costs least. Quality
//! is first measured on a quarter of the sampled pixels; only contenders that this cannot tell apart get them all.

use super::gauss::{Place, Prediction, Process, place};
use super::models::{Price, Quality};
use crate::Contract;
use crate::interval::{difference_db, half_width_db};
use crate::trial::{Measured, Trial, TrialError};
use crate::tune::{Row, Study};
use crate::utility::Utility;
use lamina_model::{GenerationParams, Invalid, decibels};

/// The most trials of one representation.
const MOST_TRIALS: usize = 24;
/// The most trials while nothing is hoped for any more, but to come nearer to the limits.
const MOST_NEARER: usize = 10;
/// Gammas of the march at the lowest resolution.
const MARCH: usize = 12;
/// The least probability that is worth a trial.
const HOPE: f64 = 0.005;
/// Samples of what a candidate may give.
const DRAWS: usize = 48;

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Its trials; the best of them, if any keeps the contract.
    pub study: Study,
    /// Expected improvement of the candidate most worth trying next, in the utility's unit: dB, kB, ms.
    pub left: f64,
    /// The best probability that some candidate keeps the contract, where none was found to.
    pub hope: f64,
}

/// Searches `candidates`, one representation after the other in the order they come in: what the first ones gave is what the
/// next have to beat. Within one they differ in resolution and gamma only. What is `in_use` is measured in any case, if its
/// representation is among them.
///
/// # Errors
/// If a node stops answering, or nothing can be measured.
pub async fn search(
    trial: &mut impl Trial,
    contract: &Contract,
    candidates: &[GenerationParams],
    in_use: Option<&GenerationParams>,
    mut progress: impl FnMut(&Row) + Send,
) -> Result<Found, TrialError> {
    let mut study = Study { step: trial.step(), rows: Vec::new(), best: None };
    let (mut hope, mut promised) = (0.0_f64, Vec::new());
    let alike = |a: &GenerationParams, b: &GenerationParams| a.representation() == b.representation();
    for some in candidates.chunk_by(alike) {
        let mut race = Race::new(contract, some, trial.batches() as usize);
        race.to_beat = study.best.map(|n| study.rows[n].cost);
        let in_use = in_use.filter(|p| alike(p, &some[0]));
        let (rows, next) = race.run(trial, in_use, &mut progress).await?;
        rows.into_iter().for_each(|row| study.add(row));
        hope = hope.max(next.feasible);
        promised.extend(study.best.map(|n| study.rows[n].cost - next.improvement));
    }
    // What is still promised, beside the best of all.
    let left = study.best.map_or(f64::NAN, |n| {
        let cost = study.rows[n].cost;
        promised.iter().map(|promise| (cost - promise).max(0.0)).fold(0.0, f64::max)
    });
    Ok(Found { study, left, hope })
}

/// The candidate most worth trying.
#[derive(Default)]
struct Promise {
    params: Option<GenerationParams>,
    /// By how much it is expected to improve on the best.
    improvement: f64,
    /// How likely it is to keep the contract; where nothing was found to, how likely anything is.
    feasible: f64,
    /// By how much it is expected to come nearer to the limits ([`Row::distance`]).
    nearer: f64,
}

impl Promise {
    /// With something in hand: if it is expected to get noticeably better; else if there is hope, or for some trials that of
    /// coming nearer by a hundredth.
    fn worth_trying(&self, race: &Race) -> bool {
        match race.least_cost() {
            Some(least) => self.improvement > race.tolerance(least),
            None => self.feasible > HOPE || (race.tried.len() < MOST_NEARER && self.nearer > 0.01),
        }
    }
}

struct Race<'a> {
    contract: &'a Contract,
    utility: Utility,
    candidates: &'a [GenerationParams],
    /// Sizes from the march.
    marched: Vec<(Place, f64)>,
    tried: Vec<Row>,
    refused: Vec<GenerationParams>,
    draws: Vec<[f64; 3]>,
    /// Batches that there are.
    batches: usize,
    /// Cost of the best that other candidates gave.
    to_beat: Option<f64>,
}

impl<'a> Race<'a> {
    fn new(contract: &'a Contract, candidates: &'a [GenerationParams], batches: usize) -> Self {
        Self {
            contract,
            utility: contract.utility(),
            candidates,
            marched: Vec::new(),
            tried: Vec::new(),
            refused: Vec::new(),
            draws: draws(),
            batches,
            to_beat: None,
        }
    }

    /// All trials, and what would have been tried next.
    async fn run(
        mut self,
        trial: &mut impl Trial,
        in_use: Option<&GenerationParams>,
        progress: &mut (impl FnMut(&Row) + Send),
    ) -> Result<(Vec<Row>, Promise), TrialError> {
        self.march(trial).await?;
        if let Some(params) = in_use {
            self.measure(trial, params, progress).await?;
        }
        for params in self.first_trials() {
            self.measure(trial, &params, progress).await?;
        }
        let mut next = Promise::default();
        loop {
            while self.tried.len() < MOST_TRIALS.min(self.candidates.len()) {
                next = self.most_promising();
                let Some(params) = next.params.filter(|_| next.worth_trying(&self)) else { break };
                self.measure(trial, &params, progress).await?;
            }
            // All pixels may tell other than a quarter of them did: then something else may have become worth trying.
            if !self.settle(trial).await? {
                next.improvement = next.improvement.max(0.0);
                return Ok((self.tried, next));
            }
        }
    }

    fn lowest(&self) -> u32 {
        self.candidates.iter().map(GenerationParams::resolution).min().unwrap_or(1)
    }

    /// The candidate nearest to a resolution and gamma.
    fn nearest(&self, resolution: f64, gamma: f64) -> Option<GenerationParams> {
        let distance = |p: &GenerationParams| {
            let [x, y] = place(p);
            let to = place(&p.with_gamma(gamma).unwrap_or(*p));
            // Resolution first: gamma among those of the nearest one.
            10.0 * (x - resolution.ln()).abs() + (y - to[1]).abs()
        };
        self.candidates.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).copied()
    }

    async fn march(&mut self, trial: &mut impl Trial) -> Result<(), TrialError> {
        let lowest = self.lowest();
        let mut row: Vec<GenerationParams> =
            self.candidates.iter().filter(|p| p.resolution() == lowest).copied().collect();
        row.sort_by(|a, b| a.gamma().total_cmp(&b.gamma()));
        let Some((first, last)) = row.first().copied().zip(row.last().copied()) else { return Ok(()) };
        let (low, high) = (place(&first)[1], place(&last)[1]);
        let wanted = (0..MARCH).map(|k| low + (high - low) * k as f64 / (MARCH - 1) as f64);
        let off = |p: &GenerationParams, y: f64| (place(p)[1] - y).abs();
        let pick = |y: f64| row.iter().min_by(|a, b| off(a, y).total_cmp(&off(b, y))).copied();
        let mut picked: Vec<GenerationParams> = wanted.filter_map(pick).collect();
        picked.dedup();
        let gammas: Vec<f64> = picked.iter().map(GenerationParams::gamma).collect();
        let costs = match trial.sizes(&first, &gammas).await {
            Ok(costs) => costs,
            // What the trials themselves will say, candidate by candidate.
            Err(TrialError::Invalid(_)) => return Ok(()),
            Err(error) => return Err(error),
        };
        self.marched = picked.iter().zip(costs).map(|(p, c)| (place(p), (c.size_bytes.max(1) as f64).ln())).collect();
        Ok(())
    }

    /// Cheap ones that tell the models' parameters: little merging and much at the lowest resolution, little at half as many
    /// rays again.
    fn first_trials(&self) -> Vec<GenerationParams> {
        let lowest = f64::from(self.lowest());
        [(1.0, 0.0), (1.0, 0.05), (1.5, 0.009)].iter().filter_map(|(r, g)| self.nearest(r * lowest, *g)).collect()
    }

    async fn measure(
        &mut self,
        trial: &mut impl Trial,
        params: &GenerationParams,
        progress: &mut (impl FnMut(&Row) + Send),
    ) -> Result<(), TrialError> {
        if self.tried.iter().any(|r| r.params == *params) {
            return Ok(());
        }
        let mut measured = match one(trial, params, 0).await? {
            Ok(measured) => measured,
            Err(reason) => {
                tracing::warn!(%reason, "candidate left out");
                self.refused.push(*params);
                return Ok(());
            }
        };
        // Quality of what breaks another limit matters only while the model of quality knows little.
        let known = self.tried.iter().filter(|r| r.measured.quality.batches() > 0).count();
        if self.contract.excess(&measured.cost, f64::NAN) <= 0.0 || known < 6 {
            let first = self.first_batches() as u32;
            match one(trial, params, first).await? {
                Ok(more) => measured = more,
                // No viewer can show it.
                Err(reason) => {
                    tracing::warn!(%reason, "candidate left out");
                    self.refused.push(*params);
                    return Ok(());
                }
            }
        }
        let row = Row { params: *params, cost: self.contract.cost(&measured), measured };
        progress(&row);
        self.tried.push(row);
        Ok(())
    }

    fn least_cost(&self) -> Option<f64> {
        let least = self.tried.iter().map(|r| r.cost).chain(self.to_beat).fold(f64::INFINITY, f64::min);
        (least < f64::INFINITY).then_some(least)
    }

    /// An improvement too small to look for.
    fn tolerance(&self, least: f64) -> f64 {
        match self.utility {
            Utility::Quality => 0.02,
            Utility::Size | Utility::Time => 0.002 * least.abs().max(1e-9),
            Utility::Expression(_) => 0.0005 * least.abs().max(1e-9),
        }
    }

    fn models(&self) -> (Process<Price>, Process<Price>, Option<Process<Quality>>) {
        let at = |row: &Row| place(&row.params);
        let (mut places, mut sizes): (Vec<Place>, Vec<f64>) = self.marched.iter().copied().unzip();
        for row in self.tried.iter().filter(|r| !self.marched.iter().any(|(p, _)| *p == at(r))) {
            places.push(at(row));
            sizes.push((row.measured.cost.size_bytes.max(1) as f64).ln());
        }
        let time = |r: &Row| {
            let cost = &r.measured.cost;
            self.contract.time_of(cost.generation_time, cost.encode_time).max(1e-6).ln()
        };
        let times =
            Price::of_times(self.tried.iter().map(at).collect(), &self.tried.iter().map(time).collect::<Vec<_>>());
        let off = self.first_batches_off_db();
        let quality = |r: &Row| {
            let found = &r.measured.quality;
            let partly = found.batches() < self.batches;
            Some((at(r), found.psnr_db() + if partly { off } else { 0.0 })).filter(|(_, q)| q.is_finite())
        };
        let (seen, decibels): (Vec<Place>, Vec<f64>) = self.tried.iter().filter_map(quality).unzip();
        (
            Price::of_sizes(self.candidates[0].representation(), places, &sizes),
            times,
            (!seen.is_empty()).then(|| Quality::through(seen, &decibels)),
        )
    }

    /// By how many decibels the first batches are worse than all of them: the same pixels for every trial, so trials that
    /// were measured on all tell it for the others.
    fn first_batches_off_db(&self) -> f64 {
        let first = self.first_batches();
        let off = |r: &Row| {
            let all = r.measured.quality.batch_mse();
            let begin = all.iter().take(first).sum::<f64>() / first as f64;
            (all.len() == self.batches && begin > 0.0).then(|| decibels(r.measured.quality.mse()) - decibels(begin))
        };
        let known: Vec<f64> = self.tried.iter().filter_map(off).filter(|db| db.is_finite()).collect();
        if known.is_empty() { 0.0 } else { known.iter().sum::<f64>() / known.len() as f64 }
    }

    /// Batches measured first: a quarter.
    fn first_batches(&self) -> usize {
        (self.batches / 4).max(2).min(self.batches)
    }

    fn most_promising(&self) -> Promise {
        let none = Promise::default();
        if self.tried.is_empty() {
            return none;
        }
        let (sizes, times, qualities) = self.models();
        let Some(qualities) = qualities else { return none };
        let least = self.least_cost();
        let nearest = self.tried.iter().map(|r| r.distance(self.contract)).fold(f64::INFINITY, f64::min);
        let untried =
            self.candidates.iter().filter(|c| !self.refused.contains(c) && !self.tried.iter().any(|r| r.params == **c));
        let promise = |params: &GenerationParams| {
            let at = place(params);
            let of = [sizes.predict(&at), times.predict(&at), qualities.predict(&at)];
            Promise { params: Some(*params), ..self.expectation(&of, least, nearest) }
        };
        let promises: Vec<Promise> = untried.map(promise).collect();
        let hope = promises.iter().map(|p| p.feasible).fold(0.0, f64::max);
        // Without anything in hand, what is surest to keep the limits, and of those the best; without hope, what comes nearest.
        let order = |p: &Promise| match least {
            Some(_) => p.improvement,
            None if hope > HOPE && p.feasible == 0.0 => f64::NEG_INFINITY,
            None if hope > HOPE => (p.feasible * 20.0).round() * 1e6 + p.improvement,
            None => p.nearer,
        };
        let best = promises.into_iter().max_by(|a, b| order(a).total_cmp(&order(b))).unwrap_or(none);
        if least.is_none() { Promise { feasible: hope, ..best } } else { best }
    }

    /// Mean improvement on `least`, the share of draws that keep the contract, and by how much they are nearer to it than
    /// `nearest`.
    fn expectation(&self, of: &[Prediction; 3], least: Option<f64>, nearest: f64) -> Promise {
        let (mut improvement, mut feasible, mut nearer) = (0.0, 0.0, 0.0);
        for draw in &self.draws {
            let [size, time, q] = std::array::from_fn(|k| of[k].mean + of[k].deviation * draw[k]);
            let (bytes, ms) = (size.exp(), time.exp());
            let distance = self.contract.distance_of(bytes, ms, q);
            nearer += (nearest - distance).max(0.0);
            if distance <= 0.0 {
                feasible += 1.0;
                let cost = self.utility.cost(bytes as u64, q, ms);
                // Without a best, cheaper is better by itself; the offset keeps the order's sign.
                improvement += least.map_or(-cost, |least| (least - cost).max(0.0));
            }
        }
        let n = self.draws.len() as f64;
        Promise { params: None, improvement: improvement / n, feasible: feasible / n, nearer: nearer / n }
    }

    /// Measures contenders on all pixels, until nothing else may be the best; true if there were any.
    async fn settle(&mut self, trial: &mut impl Trial) -> Result<bool, TrialError> {
        let mut settled = false;
        loop {
            let Some(best) = (0..self.tried.len()).min_by(|&a, &b| self.tried[a].cost.total_cmp(&self.tried[b].cost))
            else {
                return Ok(settled);
            };
            let partly = |r: &Row| (1..self.batches).contains(&r.measured.quality.batches());
            let contends = |n: usize| {
                let row = &self.tried[n];
                partly(row)
                    && self.contract.excess(&row.measured.cost, f64::NAN) <= 0.0
                    && (n == best || self.may_beat(n, best))
            };
            let Some(next) = (0..self.tried.len()).find(|&n| contends(n)) else { return Ok(settled) };
            settled = true;
            let params = self.tried[next].params;
            match one(trial, &params, u32::MAX).await? {
                Ok(measured) => {
                    let row = &mut self.tried[next];
                    (row.cost, row.measured) = (self.contract.cost(&measured), measured);
                }
                Err(_) => drop(self.tried.remove(next)),
            }
        }
    }

    /// True if the pixels seen so far leave it open that row `n` is better than row `best`.
    fn may_beat(&self, n: usize, best: usize) -> bool {
        let (a, b) = (&self.tried[n], &self.tried[best]);
        let limited = self.contract.psnr_db.is_some_and(|least| {
            let off = (a.measured.quality.psnr_db() - least).abs();
            off <= half_width_db(&a.measured.quality)
        });
        let quality = matches!(self.utility, Utility::Quality | Utility::Expression(_));
        limited || (quality && difference_db(&a.measured.quality, &b.measured.quality).1 > 0.0)
    }
}

async fn one(
    trial: &mut impl Trial,
    params: &GenerationParams,
    batches: u32,
) -> Result<Result<Measured, Invalid>, TrialError> {
    let answer = trial.measure(&[*params], batches).await?.pop();
    Ok(answer.unwrap_or_else(|| Err(Invalid::new("trial", "gave no answer"))))
}

/// Points that fill three dimensions evenly, as standard normal deviates: Halton's sequence in bases 2, 3 and 5.
fn draws() -> Vec<[f64; 3]> {
    let radical_inverse = |mut n: usize, base: usize| {
        let (mut digit, mut value) = (1.0, 0.0);
        while n > 0 {
            digit /= base as f64;
            value += digit * (n % base) as f64;
            n /= base;
        }
        value
    };
    (1..=DRAWS).map(|n| [2, 3, 5].map(|base| normal_quantile(radical_inverse(n, base)))).collect()
}

/// The standard normal quantile of `p` in 0..1, within 4.5e-4 (Abramowitz and Stegun 26.2.23).
fn normal_quantile(p: f64) -> f64 {
    let tail = p.min(1.0 - p);
    let t = (-2.0 * tail.ln()).sqrt();
    let z =
        t - (2.515_517 + t * (0.802_853 + t * 0.010_328)) / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    if p < 0.5 { -z } else { z }
}
