//! Filling a limit on size: neighboring candidates differ by a quarter in bytes, so that the best of them leaves some of the
//! limit unused. Between them the gamma is found whose bytes just keep it, by regula falsi in (ln gamma, ln bytes), where each
//! evaluation is one encoding without a measurement of quality.

use super::bayesian::BayesianSearch;
use super::deadline::Deadline;
use super::gaussian_process::Prediction;
use super::surrogates::Surrogates;
use crate::evaluator::{Evaluator, TrialError};
use crate::tune::Trial;
use crate::utility::Utility;
use lamina_model::GenerationParams;

/// Share of the limit that is enough, and the one aimed at.
const ENOUGH: f64 = 0.97;
const AIM: f64 = 0.985;
/// The most resolutions whose limit is filled.
const MOST_LINES: usize = 3;
/// How much smaller an improvement is looked for than among the candidates, as this ends the search.
const FINAL: f64 = 5.0;
/// The most evaluations for one.
const EVALUATIONS: usize = 5;
/// How sizes change along a line before two of its points are known: per unit of ln gamma, of ln r.
const SLOPES: [f64; 2] = [-0.8, 1.8];

/// A line of parameters along which size changes one way.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LogLine {
    /// Gammas at the resolution of these.
    Gammas(GenerationParams),
    /// Resolutions at the gamma of these.
    Resolutions(GenerationParams),
}

impl LogLine {
    /// The coordinate of `params` if they lie on it.
    fn position(&self, params: &GenerationParams) -> Option<f64> {
        match self {
            Self::Gammas(of) => (params.resolution() == of.resolution()).then(|| params.gamma().max(1e-12).ln()),
            Self::Resolutions(of) => (params.gamma() == of.gamma()).then(|| f64::from(params.resolution()).ln()),
        }
    }

    /// The parameters at a coordinate, a gamma with four digits.
    fn at(&self, x: f64) -> Option<GenerationParams> {
        match self {
            Self::Gammas(of) => of.with_gamma(format!("{:.3e}", x.exp()).parse().ok()?).ok(),
            Self::Resolutions(of) => of.with_resolution(x.exp().round().max(1.0) as u32).ok(),
        }
    }

    fn slope(&self) -> f64 {
        match self {
            Self::Gammas(_) => SLOPES[0],
            Self::Resolutions(_) => SLOPES[1],
        }
    }
}

/// A place on a line that should fill the limit.
struct Target {
    line: LogLine,
    /// Ends of the candidates' range.
    ends: (f64, f64),
    /// Where the models say that it is.
    guess: f64,
    /// Expected improvement, and the expected cost.
    improvement: f64,
    cost: f64,
}

impl BayesianSearch<'_> {
    /// True if a limit on size is filled after all else: where a better quality is what is wanted, or may be.
    pub(super) fn fills_limit(&self) -> bool {
        self.contract.limits.size_bytes.is_some() && matches!(self.utility, Utility::Quality | Utility::Expression(_))
    }

    /// Fills the limit at the resolutions that may be the best then.
    pub(super) async fn fill_limit(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        progress: &mut (impl FnMut(&Trial) + Send),
    ) -> Result<(), TrialError> {
        let Some(limit) = self.contract.limits.size_bytes.filter(|_| self.fills_limit()).map(|b| b as f64) else {
            return Ok(());
        };
        let mut done = Vec::new();
        while done.len() < MOST_LINES && !self.tried.is_empty() {
            let Some(target) = self.next_target(limit, &done) else { break };
            done.push(target.line);
            let first_new = self.tried.len();
            let fullest = self.walk(trial, &target, limit).await?.map(|n| self.tried[n].params);
            self.tried[first_new..].iter().filter(|r| Some(r.params) != fullest).for_each(&mut *progress);
            if let Some(n) = self.tried.iter().position(|r| Some(r.params) == fullest) {
                if trial.enough() {
                    self.measure_quality(trial, n).await?;
                }
                self.tried.get(n).into_iter().for_each(&mut *progress);
                self.settle(trial).await?;
            }
        }
        Ok(())
    }

    /// The line whose filling is expected to improve most; if none is expected to improve noticeably, that of the best row, as
    /// long as it does at all.
    fn next_target(&self, limit: f64, done: &[LogLine]) -> Option<Target> {
        let models = self.surrogates();
        let least = self.least_cost()?;
        let best = self.tried.iter().find(|r| r.cost == least);
        let mut targets: Vec<Target> = self
            .lines()
            .into_iter()
            .filter(|l| !done.contains(l))
            .filter_map(|l| self.target(l, &models, limit))
            .collect();
        targets.sort_by(|a, b| b.improvement.total_cmp(&a.improvement));
        let filled = best.is_some_and(|r| r.measured.cost.size_bytes as f64 >= ENOUGH * limit);
        let wanted = |t: &Target| {
            let params = t.line.at(t.guess);
            // Another representation's best is beaten on the average, not by hope: each evaluation is an encoding.
            let noticeable = params.is_some_and(|p| t.improvement > self.tolerance(&p, least) / FINAL)
                && (best.is_some() || t.cost < least);
            let of_best = !filled && t.cost < least && best.is_some_and(|r| t.line.position(&r.params).is_some());
            noticeable || of_best
        };
        targets.into_iter().find(wanted)
    }

    /// Gammas at every resolution of the candidates and of the rows that keep the contract; resolutions at the least gamma.
    fn lines(&self) -> Vec<LogLine> {
        let kept = self.tried.iter().filter(|r| r.cost < f64::INFINITY).map(|r| r.params);
        let mut all: Vec<GenerationParams> = self.candidates.iter().copied().chain(kept).collect();
        all.sort_by(|a, b| a.resolution().cmp(&b.resolution()).then(a.gamma().total_cmp(&b.gamma())));
        let finest = all.iter().min_by(|a, b| a.gamma().total_cmp(&b.gamma())).copied();
        all.dedup_by_key(|p| p.resolution());
        all.into_iter().map(LogLine::Gammas).chain(finest.map(LogLine::Resolutions)).collect()
    }

    /// Where the models say that a line fills the limit; `None` if that is not within the candidates' range, or it is filled.
    fn target(&self, line: LogLine, models: &Surrogates, limit: f64) -> Option<Target> {
        let coordinate = |p: &GenerationParams| match line {
            LogLine::Gammas(_) => p.gamma().max(1e-12).ln(),
            LogLine::Resolutions(_) => f64::from(p.resolution()).ln(),
        };
        let values = || self.candidates.iter().map(coordinate);
        let ends = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let full = |r: &Trial| (ENOUGH * limit..=limit).contains(&(r.measured.cost.size_bytes as f64));
        if self.tried.iter().any(|r| line.position(&r.params).is_some() && r.cost < f64::INFINITY && full(r)) {
            return None;
        }
        let aim = (AIM * limit).ln();
        let over = |x: f64| line.at(x).map(|p| models.predict(&p)[0].mean - aim);
        let (mut low, mut high) = ends;
        let rises = over(high)? > over(low)?;
        // Beyond either end sizes do not reach the limit, or are all above it. A resolution at the finest gamma is another line.
        if over(low)?.signum() == over(high)?.signum() {
            return None;
        }
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if (over(middle)? > 0.0) == rises { high = middle } else { low = middle }
        }
        let guess = 0.5 * (low + high);
        let [_, time, q] = models.predict(&line.at(guess)?);
        let of = [Prediction { mean: aim, deviation: 0.0 }, time, q];
        let improvement = self.expected.expectation(&of, self.least_cost(), 0.0).improvement;
        let cost = self.utility.cost(aim.exp() as u64, q.mean, time.mean.exp());
        Some(Target { line, ends, guess, improvement, cost })
    }

    /// Follows a line to where it fills the limit. The row that uses most of it, if it is a new one whose quality is worth
    /// measuring.
    async fn walk(
        &mut self,
        trial: &mut Deadline<'_, impl Evaluator>,
        target: &Target,
        limit: f64,
    ) -> Result<Option<usize>, TrialError> {
        let aim = (AIM * limit).ln();
        let position = |p: &GenerationParams| target.line.position(p);
        let marched = self.marched.iter().filter_map(|(p, bytes)| Some((position(p)?, *bytes)));
        let tried = self.tried.iter().filter_map(|r| Some((position(&r.params)?, r.measured.cost.size_bytes)));
        let mut known: Vec<(f64, f64)> =
            marched.chain(tried).map(|(x, bytes)| (x, (bytes as f64).ln() - aim)).collect();
        let (mut x, first_new) = (target.guess, self.tried.len());
        for _ in 0..EVALUATIONS {
            let Some(params) = target.line.at(x.clamp(target.ends.0, target.ends.1)) else { break };
            let Some(n) = self.measure_cost(trial, &params).await? else { break };
            let bytes = self.tried[n].measured.cost.size_bytes as f64;
            if (ENOUGH * limit..=limit).contains(&bytes) {
                break;
            }
            known.push((position(&params).unwrap_or(x), bytes.ln() - aim));
            x = next_position(&known, target.line.slope());
        }
        let within = |n: &usize| self.contract.excess(&self.tried[*n].measured.cost, f64::NAN) <= 0.0;
        let bytes = |n: usize| self.tried[n].measured.cost.size_bytes;
        let fullest = (first_new..self.tried.len()).filter(within).max_by_key(|&n| bytes(n));
        let before = self.tried[..first_new].iter().filter(|r| position(&r.params).is_some() && r.cost < f64::INFINITY);
        let least_cost = self.least_cost();
        let best_before = before.filter(|r| Some(r.cost) == least_cost).map(|r| r.measured.cost.size_bytes).max();
        Ok(fullest.filter(|&n| best_before.is_none_or(|before| bytes(n) > before)))
    }
}

/// The next position at which a function that falls or rises all along may be 0, of (position, value) known: between the nearest
/// ones on either side of 0 on the straight line through them, but not next to either; where all lie on one side, beyond them on the
/// line through the nearest two, as long as that is not much steeper or flatter than `slope`.
fn next_position(known: &[(f64, f64)], slope: f64) -> f64 {
    let mut by_distance = known.to_vec();
    by_distance.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let nearest = |above: bool| by_distance.iter().find(|(_, y)| (*y >= 0.0) == above).copied();
    match (nearest(true), nearest(false)) {
        (Some(above), Some(below)) => {
            // A jump of the size leaves one end where it is: then the interval shrinks all the same.
            let share = (above.1 / (above.1 - below.1)).clamp(0.1, 0.9);
            above.0 + share * (below.0 - above.0)
        }
        (Some((x, y)), None) | (None, Some((x, y))) => {
            let measured = by_distance.get(1).map(|next| (next.1 - y) / (next.0 - x)).filter(|s| s.is_finite());
            let relative = measured.map_or(1.0, |measured| (measured / slope).clamp(0.25, 4.0));
            x - y / (slope * relative)
        }
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_positions_find_the_zero_of_a_curve() {
        // Falling and bent, 0 at x = -0.7; one point known, far away.
        let y = |x: f64| -(x + 0.7) - 0.3 * (x + 0.7).powi(3);
        let mut known = vec![(-2.0, y(-2.0))];
        for _ in 0..6 {
            let x = next_position(&known, SLOPES[0]);
            known.push((x, y(x)));
        }
        assert!(known.iter().any(|(_, y)| y.abs() < 0.015), "{known:?}");
        // The zero of a straight line is found at once.
        assert!((next_position(&[(0.0, 1.0), (1.0, -1.0)], -9.0) - 0.5).abs() < 1e-12);
        assert!((next_position(&[(2.0, 0.5)], -0.5) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn gammas_are_written_with_four_digits() {
        let line = LogLine::Gammas(GenerationParams::vdi(128, 0.1).unwrap());
        let params = line.at((0.012_345_678_f64).ln()).unwrap();
        assert_eq!((params.resolution(), params.gamma()), (128, 0.01235));
        assert_eq!(line.position(&GenerationParams::vdi(64, 0.1).unwrap()), None);
    }
}
