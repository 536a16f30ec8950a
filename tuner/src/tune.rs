//! Algorithm 1 of the paper, in its line order.

use crate::trial::{Measured, Trial, TrialError};
use crate::utility::Utility;
use lamina_model::GenerationParams;

/// One row of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What was tried.
    pub params: GenerationParams,
    /// What it gave.
    pub measured: Measured,
    /// alpha under the utility in force.
    pub cost: f64,
}

/// All trials of one step, and the best of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Study {
    /// The step measured.
    pub step: u64,
    /// Every trial, in the order tried.
    pub rows: Vec<Row>,
    /// Index of the row with the least cost; `None` if no trial keeps the limit.
    pub best: Option<usize>,
}

/// Measures every candidate and keeps the one of least cost; the earlier one among equals.
///
/// # Errors
/// If a node stops answering; a candidate that cannot be measured is left out.
#[doc(alias = "Algorithm 1")]
pub async fn tune(
    trial: &mut impl Trial,
    utility: &Utility,
    candidates: &[GenerationParams],
    mut progress: impl FnMut(&Row) + Send,
) -> Result<Study, TrialError> {
    let mut study = Study { step: trial.step(), rows: Vec::new(), best: None };
    let mut least = f64::INFINITY;
    // R, sigma, tau, and I with q over all test views: one measurement each.
    for (params, measured) in candidates.iter().zip(trial.measure(candidates, u32::MAX).await?) {
        let measured = match measured {
            Ok(measured) => measured,
            Err(reason) => {
                tracing::warn!(%reason, "candidate left out");
                continue;
            }
        };
        let cost = utility.cost(&measured.indicators());
        if cost < least {
            least = cost;
            study.best = Some(study.rows.len());
        }
        let row = Row { params: *params, measured, cost };
        progress(&row);
        study.rows.push(row);
    }
    study.step = trial.step();
    Ok(study)
}

/// Fewest parameters a ladder holds are none; the most are these.
const LONGEST_LADDER: usize = 8;

impl Study {
    /// Ever smaller parameters for steps on which `from` would be too large: each the best of its size, each at least 15 %
    /// smaller than the one before.
    pub fn ladder(&self, from: usize) -> Vec<GenerationParams> {
        let mut by_size: Vec<&Row> = self.rows.iter().filter(|r| !r.measured.indicators().psnr_db.is_nan()).collect();
        by_size.sort_by_key(|r| r.measured.indicators().size_bytes);
        // Keep what no smaller one beats.
        let mut best_db = f64::NEG_INFINITY;
        by_size.retain(|r| {
            let better = r.measured.indicators().psnr_db > best_db;
            best_db = best_db.max(r.measured.indicators().psnr_db);
            better
        });
        let mut below = 0.85 * self.rows[from].measured.indicators().size_bytes as f64;
        let mut ladder = Vec::new();
        for row in by_size.iter().rev() {
            let size = row.measured.indicators().size_bytes as f64;
            if size <= below && ladder.len() < LONGEST_LADDER {
                ladder.push(row.params);
                below = 0.85 * size;
            }
        }
        ladder
    }

    /// The row that comes nearest to keeping the limit, for when none does.
    pub fn nearest(&self, utility: &Utility) -> Option<usize> {
        let excess = |row: &Row| match utility {
            Utility::Size { .. } => row.measured.indicators().size_bytes as f64,
            Utility::Time { .. } => row.measured.indicators().generation_time.as_secs_f64(),
        };
        (0..self.rows.len()).min_by(|&a, &b| excess(&self.rows[a]).total_cmp(&excess(&self.rows[b])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Grid;
    use crate::trial::Cost;
    use lamina_model::{Invalid, Quality, ViewError};
    use std::time::Duration;

    /// A made-up response: sigma = r^2 (0.3 - gamma), q = 10 log10(r^2) - 100 gamma, tau = r microseconds.
    struct Formula;

    impl Trial for Formula {
        fn step(&self) -> u64 {
            7
        }
        fn batches(&self) -> u32 {
            1
        }
        async fn sizes(&mut self, _: &GenerationParams, _: &[f64]) -> Result<Vec<Cost>, TrialError> {
            unreachable!()
        }
        async fn measure(
            &mut self,
            params: &[GenerationParams],
            _: u32,
        ) -> Result<Vec<Result<Measured, Invalid>>, TrialError> {
            Ok(params.iter().map(formula).collect())
        }
    }

    fn formula(p: &GenerationParams) -> Result<Measured, Invalid> {
        let r = f64::from(p.resolution());
        if p.resolution() == 256 {
            return Err(Invalid::new("vdi", "made up"));
        }
        let cost = Cost {
            size_bytes: (r * r * (0.3 - p.gamma())) as u64,
            generation_time: Duration::from_micros(r as u64),
            ..Default::default()
        };
        let mse = 10_f64.powf(-(20.0 * r.log10() - 100.0 * p.gamma()) / 10.0);
        Ok(Measured { cost, quality: Quality { views: vec![ViewError { angle_deg: 0.0, batch_mse: vec![mse] }] } })
    }

    async fn study(utility: Utility) -> Study {
        let candidates = Grid::paper().candidates(&GenerationParams::new(1, 0.0).unwrap()).unwrap();
        tune(&mut Formula, &utility, &candidates, |_| {}).await.unwrap()
    }

    #[tokio::test]
    async fn the_winner_is_the_best_under_the_limit_by_exhaustion() {
        let limit_bytes = 60_000;
        let s = study(Utility::Size { limit_bytes }).await;
        assert_eq!(s.rows.len(), 1300 - 65, "what cannot be measured is left out");
        let best = &s.rows[s.best.unwrap()];
        assert!(best.measured.indicators().size_bytes <= limit_bytes);
        for row in s.rows.iter().filter(|r| r.measured.indicators().size_bytes <= limit_bytes) {
            assert!(row.measured.indicators().psnr_db <= best.measured.indicators().psnr_db);
        }
        // Quality grows with r here alone, so a time limit of 300 us is r = 288, the least gamma.
        let s = study(Utility::Time { limit_ms: 0.3 }).await;
        let best = s.rows[s.best.unwrap()].params;
        assert_eq!((best.resolution(), best.gamma()), (288, 0.001));
    }

    #[tokio::test]
    async fn a_limit_nothing_meets_has_no_winner_but_a_nearest() {
        let utility = Utility::Size { limit_bytes: 10 };
        let s = study(utility).await;
        assert_eq!(s.best, None);
        let nearest = s.rows[s.nearest(&utility).unwrap()].params;
        assert_eq!((nearest.resolution(), nearest.gamma()), (160, 0.257));
    }

    #[tokio::test]
    async fn the_ladder_falls_in_size_and_is_never_beaten_by_something_smaller() {
        let s = study(Utility::Size { limit_bytes: 60_000 }).await;
        let ladder = s.ladder(s.best.unwrap());
        assert!(!ladder.is_empty() && ladder.len() <= LONGEST_LADDER);
        let rung = |p: &GenerationParams| s.rows.iter().find(|r| r.params == *p).unwrap().measured.indicators();
        let mut last = s.rows[s.best.unwrap()].measured.indicators();
        for p in &ladder {
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
}
