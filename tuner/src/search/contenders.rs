//! On how many pixels quality is measured: few at first, more where these cannot tell which of two trials is better, all of them
//! for the best.
//!
//! All trials are measured on the same pixels, batch by batch, so that their differences are known far better than their values.

use super::bayesian::BayesianSearch;
use super::deadline::Deadline;
use crate::evaluator::{Batches, Evaluator, TrialError};
use crate::interval::{difference_db, half_width_db};
use crate::tune::Trial;
use crate::utility::Utility;
use lamina_model::decibels;

/// Batches measured first: the fewest from which an interval follows.
const FIRST_BATCHES: usize = 2;
/// By which factor those of a contender grow.
const MORE: usize = 4;

impl BayesianSearch<'_> {
    /// Batches measured first.
    pub(super) fn first_batches(&self) -> usize {
        FIRST_BATCHES.min(self.batches)
    }

    /// Decibels of a trial on all pixels: where only some were measured, corrected by what those differ by in the trials that
    /// were measured on all, since pixels that are hard for one are hard for others.
    pub(super) fn estimated_db(&self, row: &Trial) -> f64 {
        let measured = row.measured.quality.batches();
        let db = row.measured.quality.psnr_db();
        if measured == 0 || measured >= self.batches {
            return db;
        }
        let off = |r: &Trial| {
            let all = r.measured.quality.batch_mse();
            let begin = all.iter().take(measured).sum::<f64>() / measured as f64;
            (all.len() == self.batches && begin > 0.0).then(|| decibels(r.measured.quality.mse()) - decibels(begin))
        };
        let known: Vec<f64> = self.tried.iter().filter_map(off).filter(|db| db.is_finite()).collect();
        if known.is_empty() { db } else { db + known.iter().sum::<f64>() / known.len() as f64 }
    }

    /// Costs by what is now known of the pixels.
    pub(super) fn update_costs(&mut self) {
        let cost = |r: &Trial| self.contract.cost_at(&r.measured, self.estimated_db(r));
        let costs: Vec<f64> = self.tried.iter().map(cost).collect();
        self.tried.iter_mut().zip(costs).for_each(|(row, cost)| row.cost = cost);
        self.expected.contract = self.contract.with_psnr_for_ssim(self.tried.iter().chain(&self.carried));
    }

    /// Measures contenders on more pixels, until nothing else may be the best or the time is over; true if something else may
    /// have become worth trying.
    pub(super) async fn settle(&mut self, trial: &mut Deadline<'_, impl Evaluator>) -> Result<bool, TrialError> {
        let mut settled = false;
        while let Some((next, batches)) = self.next_contender() {
            if !trial.enough() {
                return Ok(false);
            }
            settled = true;
            let params = self.tried[next].params;
            match trial.evaluate(&params, Batches::first(batches as u32)).await? {
                Ok(measured) => self.tried[next].measured = measured,
                Err(_) => drop(self.tried.remove(next)),
            }
            self.update_costs();
        }
        Ok(settled)
    }

    /// A trial that the pixels measured do not tell from the best, and how many batches it should have: first the best itself, all
    /// of them.
    fn next_contender(&self) -> Option<(usize, usize)> {
        let by_cost = |&a: &usize, &b: &usize| {
            let nearness = |n: usize| self.distance_of(&self.tried[n]);
            self.tried[a].cost.total_cmp(&self.tried[b].cost).then(nearness(a).total_cmp(&nearness(b)))
        };
        let measured = |n: &usize| self.tried[*n].measured.quality.batches() > 0;
        let best = (0..self.tried.len()).filter(measured).min_by(by_cost)?;
        let open = |n: usize| {
            let row = &self.tried[n];
            (1..self.batches).contains(&row.measured.quality.batches())
                && self.contract.excess(&row.measured.cost, f64::NAN) <= 0.0
        };
        if open(best) && self.to_beat.is_none_or(|least| self.may_cost_less(best, least)) {
            return Some((best, self.batches));
        }
        let next = (0..self.tried.len()).filter(|&n| n != best && open(n)).find(|&n| self.may_beat(n, best))?;
        Some((next, (MORE * self.tried[next].measured.quality.batches()).min(self.batches)))
    }

    /// True if the pixels seen so far leave it open that row `n` is better than row `best`.
    fn may_beat(&self, n: usize, best: usize) -> bool {
        let (a, b) = (&self.tried[n], &self.tried[best]);
        let quality = matches!(self.utility, Utility::Quality | Utility::Expression(_));
        self.limit_is_open(a) || (quality && difference_db(&a.measured.quality, &b.measured.quality).1 > 0.0)
    }

    /// True if the pixels seen so far leave it open that row `n` costs less than another representation's best.
    fn may_cost_less(&self, n: usize, least: f64) -> bool {
        let row = &self.tried[n];
        let quality = &row.measured.quality;
        let at_best = self.contract.cost_at(&row.measured, self.estimated_db(row) + half_width_db(quality).min(10.0));
        at_best < least
    }

    /// True if the pixels seen so far leave it open whether a row keeps a limit on quality.
    fn limit_is_open(&self, row: &Trial) -> bool {
        self.contract
            .limits
            .psnr_db
            .is_some_and(|least| (self.estimated_db(row) - least).abs() <= half_width_db(&row.measured.quality))
    }
}
