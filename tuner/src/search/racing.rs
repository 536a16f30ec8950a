//! Finds the grid's best parameters with a few trials.
//!
//! Models of size, time and quality ([`super::models`]) say what each candidate may be worth under the contract; the one
//! expected to improve most on the best found is measured next (expected improvement: Jones, Schonlau and Welch, Efficient
//! Global Optimization of Expensive Black-Box Functions, 1998), until none is expected to improve by more than some
//! hundredths of a decibel. Where sizes matter, those of a dozen gammas come from one march at the lowest resolution, which
//! costs least. Where generation has to be fast, what may be too slow is timed first, the best of what may be fast enough before
//! all else: what breaks that limit is not encoded. Quality is first measured on a quarter of the sampled pixels; only contenders that this
//! cannot tell apart get them all.

use super::gauss::{Place, Process, place};
use super::models::{Price, Quality};
use super::promise::{Hopes, Promise};
use super::timed::Timed;
use super::timings::Timings;
use crate::Contract;
use crate::interval::{difference_db, half_width_db};
use crate::trial::{Trial, TrialError};
use crate::tune::{Row, Study};
use crate::utility::Utility;
use lamina_model::{GenerationParams, Invalid, decibels};
use tokio::time::Instant;

/// The most trials of one representation.
const MOST_TRIALS: usize = 24;
/// The most trials while nothing is hoped for any more, but to come nearer to the limits.
const MOST_NEARER: usize = 10;
/// Gammas of the march at the lowest resolution.
const MARCH: usize = 12;
/// How much larger an improvement has to be where trials are dear, at most.
const DEAREST: f64 = 5.0;
/// The least probability that is worth a trial.
const HOPE: f64 = 0.005;

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Its trials; the best of them, if any keeps the contract.
    pub study: Study,
    /// Expected improvement of the candidate most worth trying next, in the utility's unit: dB, kB, ms.
    pub left: f64,
    /// The best probability that some candidate keeps the contract, where none was found to.
    pub hope: f64,
    /// The time was over before it had come to its end: costs are those on the pixels that all were measured on, and `left` is
    /// NaN.
    pub cut: bool,
}

/// Searches `candidates`, one representation after the other in the order they come in: what the first ones gave is what the
/// next have to beat. Within one they differ in resolution and gamma only. What is `in_use` is measured before all others, if
/// its representation is among them. No trial is begun that would probably end after `until`; where that is given the
/// representation in use comes first.
///
/// # Errors
/// If a node stops answering, or nothing can be measured.
pub async fn search(
    trial: &mut impl Trial,
    contract: &Contract,
    candidates: &[GenerationParams],
    in_use: Option<&GenerationParams>,
    until: Option<Instant>,
    mut progress: impl FnMut(&Row) + Send,
) -> Result<Found, TrialError> {
    let mut study = Study { step: trial.step(), rows: Vec::new(), best: None };
    let (mut hope, mut promised) = (0.0_f64, Vec::new());
    let batches = trial.batches() as usize;
    let mut trial = Timed::new(trial, until);
    let alike = |a: &GenerationParams, b: &GenerationParams| a.representation() == b.representation();
    let mut races: Vec<Race> = candidates.chunk_by(alike).map(|some| Race::new(contract, some, batches)).collect();
    if let Some(params) = in_use
        && let Some(race) = races.iter().position(|race| alike(params, &race.candidates[0]))
    {
        races[race].measure(&mut trial, params, &mut progress).await?;
        if until.is_some() {
            races[..=race].rotate_right(1);
        }
    }
    for mut race in races {
        race.to_beat = study.best.map(|n| study.rows[n].cost);
        let (rows, next) = race.run(&mut trial, &mut progress).await?;
        rows.into_iter().for_each(|row| study.add(row));
        hope = hope.max(next.feasible);
        promised.extend(study.best.map(|n| study.rows[n].cost - next.improvement));
    }
    if trial.cut {
        return Ok(Found { study: study.on_common_pixels(contract), left: f64::NAN, hope, cut: true });
    }
    // What is still promised, beside the best of all.
    let left = study.best.map_or(f64::NAN, |n| {
        let cost = study.rows[n].cost;
        promised.iter().map(|promise| (cost - promise).max(0.0)).fold(0.0, f64::max)
    });
    Ok(Found { study, left, hope, cut: false })
}

impl Promise {
    /// With something in hand: if it is expected to get noticeably better; else if there is hope, or for some trials that of
    /// coming nearer by a hundredth.
    fn worth_trying(&self, race: &Race) -> bool {
        match race.least_cost() {
            Some(least) => self.params.is_some_and(|p| self.improvement > race.tolerance(&p, least)),
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
    timings: Timings,
    refused: Vec<GenerationParams>,
    hopes: Hopes<'a>,
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
            timings: Timings::new(contract, &candidates[0]),
            refused: Vec::new(),
            hopes: Hopes::new(contract),
            batches,
            to_beat: None,
        }
    }

    /// All trials, and what would be tried next.
    async fn run(
        mut self,
        trial: &mut Timed<'_, impl Trial>,
        progress: &mut (impl FnMut(&Row) + Send),
    ) -> Result<(Vec<Row>, Promise), TrialError> {
        if self.contract.weighs_size() {
            self.march(trial).await?;
        }
        for params in self.first_trials() {
            if self.timings.want(&params, None) {
                self.time(trial, &params).await?;
            }
            if !self.timings.too_slow(&params) {
                self.measure(trial, &params, progress).await?;
            }
        }
        // Models need something to begin with.
        if let Some(fastest) = self.timings.fastest().filter(|_| self.tried.is_empty()) {
            self.measure(trial, &fastest, progress).await?;
        }
        loop {
            let mut next = self.most_promising();
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

    async fn march(&mut self, trial: &mut Timed<'_, impl Trial>) -> Result<(), TrialError> {
        // Trials tell as much, only less of it.
        if !trial.enough_for(MARCH as u32 / 2) {
            return Ok(());
        }
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
        trial: &mut Timed<'_, impl Trial>,
        params: &GenerationParams,
        progress: &mut (impl FnMut(&Row) + Send),
    ) -> Result<(), TrialError> {
        if !self.is_new(params) || !trial.enough() {
            return Ok(());
        }
        let mut measured = match trial.measure(params, 0).await? {
            Ok(measured) => measured,
            Err(reason) => {
                self.leave_out(params, &reason);
                return Ok(());
            }
        };
        // Quality of what breaks another limit matters only while the model of quality knows little.
        let known = self.tried.iter().filter(|r| r.measured.quality.batches() > 0).count();
        if self.contract.excess(&measured.cost, f64::NAN) <= 0.0 || known < 4 {
            let first = self.first_batches() as u32;
            match trial.measure(params, first).await? {
                Ok(more) => measured = more,
                // No viewer can show it.
                Err(reason) => {
                    self.leave_out(params, &reason);
                    return Ok(());
                }
            }
        }
        let row = Row { params: *params, cost: self.contract.cost(&measured), measured };
        progress(&row);
        self.tried.push(row);
        Ok(())
    }

    /// Times generation alone. With nothing in hand even what is too slow is measured: it may come nearest to the contract.
    async fn time(&mut self, trial: &mut Timed<'_, impl Trial>, params: &GenerationParams) -> Result<(), TrialError> {
        if self.least_cost().is_none() || !self.is_new(params) || !trial.enough() {
            return Ok(());
        }
        match trial.time(params).await? {
            Ok(time) => self.timings.add(params, time),
            Err(reason) => self.leave_out(params, &reason),
        }
        Ok(())
    }

    /// True if nothing was measured of it yet, nor refused.
    fn is_new(&self, params: &GenerationParams) -> bool {
        !self.refused.contains(params) && self.tried.iter().all(|r| r.params != *params)
    }

    fn leave_out(&mut self, params: &GenerationParams, reason: &Invalid) {
        tracing::warn!(%reason, "candidate left out");
        self.refused.push(*params);
    }

    fn least_cost(&self) -> Option<f64> {
        let least = self.tried.iter().map(|r| r.cost).chain(self.to_beat).fold(f64::INFINITY, f64::min);
        (least < f64::INFINITY).then_some(least)
    }

    /// An improvement too small to look for: a larger one where trials are dear.
    fn tolerance(&self, params: &GenerationParams, least: f64) -> f64 {
        let dearer = f64::from(params.resolution()) / f64::from(self.lowest());
        dearer.min(DEAREST)
            * match self.utility {
                Utility::Quality => 0.01,
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
        let timed =
            |r: &Row| (at(r), self.contract.time_of(r.measured.cost.generation_time, r.measured.cost.encode_time));
        let (timed_at, times): (Vec<Place>, Vec<f64>) =
            self.tried.iter().map(timed).chain(self.timings.all()).map(|(at, ms)| (at, ms.max(1e-6).ln())).unzip();
        let off = self.first_batches_off_db();
        let quality = |r: &Row| {
            let found = &r.measured.quality;
            let partly = found.batches() < self.batches;
            Some((at(r), found.psnr_db() + if partly { off } else { 0.0 })).filter(|(_, q)| q.is_finite())
        };
        let (seen, decibels): (Vec<Place>, Vec<f64>) = self.tried.iter().filter_map(quality).unzip();
        (
            Price::of_sizes(self.candidates[0].representation(), places, &sizes),
            Price::of_times(timed_at, &times),
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
        let untried = self.candidates.iter().filter(|c| self.is_new(c));
        let promise = |params: &GenerationParams| {
            let at = place(params);
            let mut of = [sizes.predict(&at), times.predict(&at), qualities.predict(&at)];
            let in_doubt = least.is_some() && self.timings.want(params, Some(of[1]));
            if least.is_some() {
                of[1] = self.timings.expected(params, of[1])?;
            }
            Some(Promise { params: Some(*params), in_doubt, ..self.hopes.expectation(&of, least, nearest) })
        };
        let promises: Vec<Promise> = untried.filter_map(promise).collect();
        let hope = promises.iter().map(|p| p.feasible).fold(0.0, f64::max);
        // Without anything in hand, what is surest to keep the limits, and of those the best; without hope, what comes nearest.
        let worth = |p: &Promise| match least {
            Some(_) => p.improvement,
            None if hope > HOPE && p.feasible == 0.0 => f64::NEG_INFINITY,
            None if hope > HOPE => (p.feasible * 20.0).round() * 1e6 + p.improvement,
            None => p.nearer,
        };
        // A large one that is not worth what its trial costs does not hide another that is.
        let order = |a: &Promise, b: &Promise| {
            a.worth_trying(self).cmp(&b.worth_trying(self)).then(worth(a).total_cmp(&worth(b)))
        };
        let best = promises.into_iter().max_by(order).unwrap_or(none);
        if least.is_none() { Promise { feasible: hope, ..best } } else { best }
    }

    /// Measures contenders on all pixels, until nothing else may be the best or the time is over; true if something else may
    /// have become worth trying.
    async fn settle(&mut self, trial: &mut Timed<'_, impl Trial>) -> Result<bool, TrialError> {
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
            if !trial.enough() {
                return Ok(false);
            }
            settled = true;
            let params = self.tried[next].params;
            match trial.measure(&params, u32::MAX).await? {
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
