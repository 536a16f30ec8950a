//! What the trials of an earlier step let expect of this one, where there was too little time to measure.

use crate::Contract;
use crate::evaluator::Measurement;
use crate::tune::{Study, Trial};
use lamina_model::{Cost, GenerationParams, Quality, ViewError};

/// Parameters tried on an earlier step that should keep the contract on the step of `study`, none of whose trials does: the figures of
/// the earlier step, changed as those of parameters tried on both. `tables` are the trials of earlier steps.
pub(crate) fn transferred<'a>(
    study: &Study,
    mut tables: impl Iterator<Item = &'a [Trial]>,
    contract: &Contract,
) -> Option<GenerationParams> {
    let aim = contract.aim();
    tables.find_map(|table| {
        let there = |here: &Trial| table.iter().find(|row| row.params == here.params);
        let change = study.rows.iter().find_map(|here| Some((here, StepRatios::between(there(here)?, here)?)));
        let (here, change) = change?;
        let untried = |row: &&Trial| study.rows.iter().all(|tried| tried.params != row.params);
        let alike = |row: &&Trial| row.params.representation() == here.params.representation();
        let expected = table.iter().filter(untried).filter(alike);
        let costs = expected.map(|row| (aim.cost(&change.of(&row.measured)), row.params));
        costs.filter(|(cost, _)| *cost < f64::INFINITY).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, params)| params)
    })
}

/// The factors by which figures differ between two steps.
struct StepRatios {
    size: f64,
    time: f64,
    mse: f64,
    /// Of what structural similarity lacks to 1.
    dissimilarity: Option<f64>,
}

impl StepRatios {
    /// From a trial to one of the same parameters on another step; `None` where the figures do not tell.
    fn between(there: &Trial, here: &Trial) -> Option<Self> {
        let [a, b] = [there, here].map(|trial| &trial.measured);
        let time = |cost: &Cost| (cost.generation + cost.encode).as_secs_f64();
        let lacks = |m: &Measurement| m.quality.ssim().map(|ssim| 1.0 - ssim);
        let change = Self {
            size: b.cost.size_bytes as f64 / a.cost.size_bytes as f64,
            time: time(&b.cost) / time(&a.cost),
            mse: 10_f64.powf((a.quality.psnr_db() - b.quality.psnr_db()) / 10.0),
            dissimilarity: lacks(a).zip(lacks(b)).map(|(a, b)| b / a),
        };
        let known = |factor: f64| factor.is_finite() && factor > 0.0;
        (known(change.size) && known(change.mse) && change.dissimilarity.is_none_or(known)).then_some(change)
    }

    fn of(&self, measured: &Measurement) -> Measurement {
        let Measurement { cost, quality } = measured;
        let time = if self.time.is_finite() { self.time } else { 1.0 };
        let view = |view: &ViewError| ViewError {
            angle_deg: view.angle_deg,
            batch_mse: view.batch_mse.iter().map(|mse| self.mse * mse).collect(),
            ssim: view.ssim.zip(self.dissimilarity).map(|(ssim, factor)| 1.0 - factor * (1.0 - ssim)),
        };
        Measurement {
            cost: Cost {
                size_bytes: (self.size * cost.size_bytes as f64) as u64,
                generation: cost.generation.mul_f64(time),
                encode: cost.encode.mul_f64(time),
                ..*cost
            },
            quality: Quality { views: quality.views.iter().map(view).collect() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(gamma: f64, size_bytes: u64, ssim: f64, psnr_db: f64) -> Trial {
        let view = ViewError { angle_deg: 10.0, batch_mse: vec![10_f64.powf(-psnr_db / 10.0)], ssim: Some(ssim) };
        let cost = Cost { size_bytes, ..Cost::default() };
        let measured = Measurement { cost, quality: Quality { views: vec![view] } };
        Trial { params: GenerationParams::volume(64, gamma).unwrap(), measured, cost: 0.0 }
    }

    #[test]
    fn the_cheapest_that_should_keep_the_limit_is_taken() {
        let contract: Contract = "ssim >= 0.98".parse().unwrap();
        let earlier = [
            trial(0.08, 2500, 0.982, 35.0),
            trial(0.06, 3200, 0.988, 37.0),
            trial(0.03, 4800, 0.995, 42.0),
            trial(0.01, 9000, 0.9998, 54.0),
        ];
        let study = |ssim| Study { step: 40, rows: vec![trial(0.08, 3500, ssim, 33.0)], best: None };
        let gamma = |ssim| {
            let found = transferred(&study(ssim), std::iter::once(&earlier[..]), &contract);
            found.map(|params| params.gamma())
        };
        // 0.018 from 1 has become 0.027: 0.012 becomes 0.018, which is within the limit and its margin.
        assert_eq!(gamma(0.973), Some(0.06));
        // Twice as much, 0.036: 0.024 is too much, 0.01 is not.
        assert_eq!(gamma(0.964), Some(0.03));
        assert_eq!(gamma(-1.0), None, "nothing tried then is good enough");
        let none = transferred(&study(0.97), [&earlier[1..], &[]].into_iter(), &contract);
        assert_eq!(none, None, "nothing was tried on both");
    }

    #[test]
    fn limits_on_size_and_quality_together_are_kept() {
        let contract: Contract = "size <= 4kB, psnr >= 36dB".parse().unwrap();
        let earlier = [trial(0.08, 2000, 0.9, 38.0), trial(0.05, 2600, 0.9, 41.0), trial(0.01, 5000, 0.9, 54.0)];
        let study = Study { step: 9, rows: vec![trial(0.08, 2800, 0.9, 34.0)], best: None };
        // 1.4 times the bytes and 4 dB less: 3.64 kB and 37 dB.
        let found = transferred(&study, std::iter::once(&earlier[..]), &contract).unwrap();
        assert_eq!(found, earlier[1].params);
    }
}
