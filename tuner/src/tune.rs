//! Algorithm 1 of the paper, in its line order.

use crate::Contract;
use crate::evaluator::{Batches, Evaluator, Measurement, TrialError};
use lamina_model::{GenerationParams, Representation};

/// One row of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// What was tried.
    pub params: GenerationParams,
    /// What it gave.
    pub measured: Measurement,
    /// alpha under the contract in force.
    pub cost: f64,
}

impl Trial {
    /// How far it is from keeping all limits; 0 or less keeps them.
    pub fn distance(&self, contract: &Contract) -> f64 {
        let cost = &self.measured.cost;
        let ms = contract.time_of(cost);
        contract.distance_of(cost.size_bytes as f64, ms, self.measured.quality.psnr_db())
    }
}

/// All trials of one step, and the best of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The step measured.
    pub step: u64,
    /// Every trial, in the order tried.
    pub rows: Vec<Trial>,
    /// Index of the row with the least cost; `None` if no trial keeps the contract.
    pub best: Option<usize>,
}

/// Candidates asked for at once, so that several viz-nodes have work.
const AT_ONCE: usize = 8;

/// Measures every candidate and keeps the one of least cost; the earlier one among equals.
///
/// ```
/// use lamina_model::{Cost, GenerationParams, Invalid, Quality, ViewError};
/// use lamina_tuner::evaluator::{Batches, Evaluator, Measurement, TrialError};
/// use lamina_tuner::{Contract, tune::tune};
/// use std::time::Duration;
///
/// /// A made-up step: bytes grow with the rays, and the error falls with them.
/// struct Model;
///
/// impl Evaluator for Model {
///     fn step(&self) -> u64 { 0 }
///     fn batches(&self) -> u32 { 1 }
///     fn longest_side(&self) -> u32 { 0 }
///     async fn sizes(&mut self, _: &GenerationParams, gammas: &[f64]) -> Result<Vec<Cost>, TrialError> {
///         Ok(vec![Cost::default(); gammas.len()])
///     }
///     async fn time(&mut self, _: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
///         Ok(Ok(Duration::from_millis(1)))
///     }
///     async fn evaluate(
///         &mut self, all: &[GenerationParams], _: Batches,
///     ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
///         let one = |p: &GenerationParams| {
///             let rays = f64::from(p.resolution()).powi(2);
///             let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![1.0 / rays], ssim: None }] };
///             Ok(Measurement { cost: Cost { size_bytes: rays as u64, ..Cost::default() }, quality })
///         };
///         Ok(all.iter().map(one).collect())
///     }
/// }
///
/// # #[tokio::main(flavor = "current_thread")]
/// # async fn main() -> Result<(), TrialError> {
/// let candidates = [64, 128, 256].map(|r| GenerationParams::vdi(r, 0.02).unwrap());
/// let study = tune(&mut Model, &Contract::size(20_000), &candidates, |_| {}).await?;
/// assert_eq!(study.rows[study.best.unwrap()].params.resolution(), 128, "256^2 bytes are too many");
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If a node stops answering; a candidate that cannot be measured is left out.
#[doc(alias = "Algorithm 1")]
pub async fn tune(
    evaluator: &mut impl Evaluator,
    contract: &Contract,
    candidates: &[GenerationParams],
    mut progress: impl FnMut(&Trial) + Send,
) -> Result<Study, TrialError> {
    let mut study = Study { step: evaluator.step(), rows: Vec::new(), best: None };
    for some in candidates.chunks(AT_ONCE) {
        // R, sigma, tau, and I with q over all test views: one measurement each.
        for (params, outcome) in some.iter().zip(evaluator.evaluate(some, Batches::All).await?) {
            match outcome {
                Ok(measured) => {
                    let row = Trial { params: *params, cost: contract.cost(&measured), measured };
                    progress(&row);
                    study.add(row);
                }
                Err(reason) => tracing::warn!(%reason, "candidate left out"),
            }
        }
    }
    Ok(study)
}

/// The most parameters of a ladder.
const LONGEST_LADDER: usize = 8;
/// How much steeper than the chosen ones those are that were not measured. Each rung costs a generation; the first are short
/// all the same, because most series grow by little from step to step. The last takes off some 70 %.
const STEEPER: [f64; 6] = [0.3, 0.8, 1.5, 2.5, 4.0, 5.5];
/// By which factors r and gamma change where that is 1, as the best parameters do when a limit gets tighter: those of VDIs
/// along with each other, those of volumes by the bound alone.
fn steeper(representation: Representation) -> (f64, f64) {
    match representation {
        Representation::Vdi => (0.92, 1.12),
        Representation::Volume => (1.0, 1.35),
    }
}
/// A gamma of 0 would not grow.
const LEAST_GAMMA: f64 = 1e-3;

impl Study {
    /// Adds a trial, which becomes the best if it costs less than all before.
    pub fn add(&mut self, row: Trial) {
        let least = self.best.map_or(f64::INFINITY, |n| self.rows[n].cost);
        if row.cost < least {
            self.best = Some(self.rows.len());
        }
        self.rows.push(row);
    }

    /// With costs on the first batches that all rows with a quality have: more pixels tell more of a row, but nothing of it
    /// beside another that lacks them. Whether a row keeps its limits is told by all that it has.
    #[must_use]
    pub fn on_common_pixels(self, contract: &Contract) -> Self {
        let batches = self.rows.iter().map(|r| r.measured.quality.batches()).filter(|&b| b > 0).min().unwrap_or(0);
        let mut common = Self { step: self.step, rows: Vec::with_capacity(self.rows.len()), best: None };
        for mut row in self.rows {
            if row.cost < f64::INFINITY {
                let Measurement { cost, quality } = &row.measured;
                let ms = contract.time_of(cost);
                row.cost = contract.utility().cost(cost.size_bytes, quality.first(batches).psnr_db(), ms);
            }
            common.add(row);
        }
        common
    }

    /// Parameters for steps on which `from` would be too large, by falling size: first from there on with larger and larger
    /// gamma (VDIs with ever fewer rays as well), then the best of each size measured, each at least 15 % smaller than the one before.
    pub fn ladder(&self, from: usize) -> Vec<GenerationParams> {
        let start = self.rows[from].params;
        let (fewer, coarser) = steeper(start.representation());
        let steeper = |much: &f64| {
            let resolution = (f64::from(start.resolution()) * fewer.powf(*much)).round().max(1.0) as u32;
            // Digits enough for a person to write down again.
            let gamma = format!("{:.3e}", start.gamma().max(LEAST_GAMMA) * coarser.powf(*much)).parse().ok()?;
            start.with_resolution(resolution).ok()?.with_gamma(gamma).ok()
        };
        let mut ladder: Vec<GenerationParams> = STEEPER.iter().filter_map(steeper).collect();
        let mut by_size: Vec<&Trial> = self.rows.iter().filter(|r| !r.measured.quality.psnr_db().is_nan()).collect();
        by_size.sort_by_key(|r| r.measured.cost.size_bytes);
        // Keep what no smaller one beats.
        let mut best_db = f64::NEG_INFINITY;
        by_size.retain(|r| {
            let better = r.measured.quality.psnr_db() > best_db;
            best_db = best_db.max(r.measured.quality.psnr_db());
            better
        });
        // Below what the first rungs reach.
        let mut below = 0.3 * self.rows[from].measured.cost.size_bytes as f64;
        for row in by_size.iter().rev() {
            let size = row.measured.cost.size_bytes as f64;
            if size <= below && ladder.len() < LONGEST_LADDER {
                ladder.push(row.params);
                below = 0.85 * size;
            }
        }
        ladder
    }

    /// The row that comes nearest to keeping all limits, for when none does.
    pub fn nearest(&self, contract: &Contract) -> Option<usize> {
        let distance = |n: usize| self.rows[n].distance(contract);
        (0..self.rows.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::SearchGrid;
    use lamina_model::Cost;
    use lamina_model::{Invalid, Quality, ViewError};
    use std::time::Duration;

    /// A made-up response: sigma = r^2 (0.3 - gamma), q = 10 log10(r^2) - 100 gamma, tau = r microseconds.
    struct Formula;

    impl Evaluator for Formula {
        fn step(&self) -> u64 {
            7
        }
        fn batches(&self) -> u32 {
            1
        }
        fn longest_side(&self) -> u32 {
            64
        }
        async fn sizes(&mut self, _: &GenerationParams, _: &[f64]) -> Result<Vec<Cost>, TrialError> {
            Ok(Vec::new())
        }
        async fn time(&mut self, p: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
            Ok(Ok(Duration::from_micros(p.resolution().into())))
        }
        async fn evaluate(
            &mut self,
            all: &[GenerationParams],
            _: Batches,
        ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
            let one = |p: &GenerationParams| {
                if p.resolution() == 256 {
                    return Err(Invalid::new("vdi", "made up"));
                }
                let r = f64::from(p.resolution());
                let cost = Cost {
                    size_bytes: (r * r * (0.3 - p.gamma())) as u64,
                    generation: Duration::from_micros(r as u64),
                    ..Cost::default()
                };
                let mse = 10_f64.powf(-(20.0 * r.log10() - 100.0 * p.gamma()) / 10.0);
                let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse], ssim: None }] };
                Ok(Measurement { cost, quality })
            };
            Ok(all.iter().map(one).collect())
        }
    }

    async fn study(contract: Contract) -> Study {
        let candidates = SearchGrid::paper().candidates(&GenerationParams::vdi(1, 0.0).unwrap()).unwrap();
        tune(&mut Formula, &contract, &candidates, |_| {}).await.unwrap()
    }

    #[tokio::test]
    async fn the_winner_is_the_best_under_the_limit_by_exhaustion() {
        let limit_bytes = 60_000;
        let s = study(Contract::size(limit_bytes)).await;
        assert_eq!(s.rows.len(), 1300 - 65, "what cannot be measured is left out");
        let best = &s.rows[s.best.unwrap()];
        assert!(best.measured.cost.size_bytes <= limit_bytes);
        for row in s.rows.iter().filter(|r| r.measured.cost.size_bytes <= limit_bytes) {
            assert!(row.measured.quality.psnr_db() <= best.measured.quality.psnr_db());
        }
        // Quality grows with r here alone, so a time limit of 300 us is r = 288, the least gamma.
        let s = study(Contract::time(0.3)).await;
        let best = s.rows[s.best.unwrap()].params;
        assert_eq!((best.resolution(), best.gamma()), (288, 0.001));
    }

    #[tokio::test]
    async fn a_limit_nothing_meets_has_no_winner_but_a_nearest() {
        let contract = Contract::size(10);
        let s = study(contract.clone()).await;
        assert_eq!(s.best, None);
        let nearest = s.rows[s.nearest(&contract).unwrap()].params;
        assert_eq!((nearest.resolution(), nearest.gamma()), (160, 0.257));
    }

    #[tokio::test]
    async fn the_ladder_falls_in_size_and_is_never_beaten_by_something_smaller() {
        let s = study(Contract::size(60_000)).await;
        let ladder = s.ladder(s.best.unwrap());
        assert!(ladder.len() > STEEPER.len() && ladder.len() <= LONGEST_LADDER);
        let best = s.rows[s.best.unwrap()].params;
        for (k, p) in ladder[..STEEPER.len()].iter().enumerate() {
            assert!(p.resolution() < best.resolution() && p.gamma() > best.gamma(), "rung {k}");
            assert_eq!(
                p.with_resolution(best.resolution()).unwrap().with_gamma(best.gamma()).unwrap(),
                best,
                "all else"
            );
        }
        let rung = |p: &GenerationParams| s.rows.iter().find(|r| r.params == *p).unwrap().measured.indicators();
        let mut last = rung(&best);
        for p in &ladder[STEEPER.len()..] {
            let this = rung(p);
            assert!(this.size_bytes as f64 <= 0.85 * last.size_bytes as f64);
            assert!(
                s.rows
                    .iter()
                    .map(|r| r.measured.indicators())
                    .all(|o| o.size_bytes > this.size_bytes || o.psnr_db <= this.psnr_db)
            );
            last = this;
        }
    }

    #[test]
    fn rows_are_compared_on_the_pixels_that_all_have_and_limits_kept_on_all_of_each() {
        let contract: Contract = "psnr >= 30dB, maximise psnr".parse().unwrap();
        let row = |gamma: f64, batch_mse: &[f64]| {
            let quality =
                Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: batch_mse.to_vec(), ssim: None }] };
            let measured = Measurement { cost: Cost::default(), quality };
            let cost = contract.cost(&measured);
            Trial { params: GenerationParams::vdi(64, gamma).unwrap(), measured, cost }
        };
        // Easier pixels come first, on which the first row keeps a limit that it breaks on all; the second one is settled, the
        // third is better where both were measured.
        let rows = [row(0.1, &[1e-4, 1e-4, 1e-2, 1e-2]), row(0.2, &[4e-4, 4e-4, 4e-5, 4e-5]), row(0.3, &[3e-4, 3e-4])];
        let mut study = Study { step: 0, rows: Vec::new(), best: None };
        rows.into_iter().for_each(|row| study.add(row));
        assert_eq!(study.best, Some(1));
        let common = study.on_common_pixels(&contract);
        assert_eq!((common.best, common.rows[0].cost), (Some(2), f64::INFINITY));
    }
}
