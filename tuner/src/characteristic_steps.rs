//! CharacteristicSteps steps: those that were studied, kept as measured tables, never as voxels.
//!
//! One pass and bounded memory. A new step is like a kept one if its size is what that one's table says for the parameters in
//! force; parameters chosen there then hold here. A step like none is characteristic itself: it is studied and kept, and
//! where there are too many, the older of the two most alike is forgotten.

use crate::Contract;
use crate::search::{CostPrior, GaussianProcess, Observation, param_point};
use crate::tune::{Study, Trial};
use crate::utility::Utility;
use lamina_model::{GenerationParams, Representation};

/// Tables kept.
const MOST: usize = 8;
/// Sizes that differ by this much on a logarithmic scale, 12 %, are no longer alike.
const ALIKE: f64 = 0.12;
/// A table says nothing about parameters whose size it knows no better than this.
const KNOWN: f64 = 0.06;

/// A step and what was measured on it.
#[derive(Debug)]
pub struct StudiedStep {
    /// Its trials.
    pub study: Study,
    /// The row in use.
    pub chosen: usize,
    /// The study was cut short: something better may be found.
    pub cut: bool,
    /// By representation.
    sizes: Vec<(Representation, GaussianProcess<CostPrior>)>,
}

impl StudiedStep {
    fn new(study: Study, chosen: usize, cut: bool) -> Self {
        let of = |representation: Representation| {
            let size =
                |r: &Trial| Observation::new(param_point(&r.params), (r.measured.cost.size_bytes.max(1) as f64).ln());
            let rows = study.rows.iter().filter(|r| r.params.representation() == representation);
            let sizes: Vec<Observation> = rows.map(size).collect();
            (!sizes.is_empty()).then(|| (representation, CostPrior::of_sizes(representation, &sizes)))
        };
        Self { sizes: Representation::ALL.into_iter().filter_map(of).collect(), study, chosen, cut }
    }

    /// How far a step of this size is from this one: the difference of the logarithms; `None` where the table does not tell.
    fn distance(&self, params: &GenerationParams, size_bytes: u64) -> Option<f64> {
        let (_, sizes) = self.sizes.iter().find(|(r, _)| *r == params.representation())?;
        let expected = sizes.predict(&param_point(params));
        (expected.deviation < KNOWN).then(|| ((size_bytes.max(1) as f64).ln() - expected.mean).abs())
    }

    fn is_like(&self, params: &GenerationParams, size_bytes: u64) -> bool {
        self.distance(params, size_bytes).is_some_and(|d| d < ALIKE)
    }
}

/// All kept steps of a run, oldest first.
#[derive(Debug, Default)]
pub struct CharacteristicSteps {
    kept: Vec<StudiedStep>,
}

impl CharacteristicSteps {
    /// Keeps a study, whose row `chosen` is used, in place of those like it that were cut short.
    pub fn keep(&mut self, study: Study, chosen: usize, cut: bool) {
        let (params, size_bytes) = (study.rows[chosen].params, study.rows[chosen].measured.cost.size_bytes);
        self.kept.retain(|k| !(k.cut && k.is_like(&params, size_bytes)));
        self.kept.push(StudiedStep::new(study, chosen, cut));
        if self.kept.len() > MOST {
            self.kept.remove(self.most_alike());
        }
    }

    /// The older one of the two kept steps that are most alike.
    fn most_alike(&self) -> usize {
        let distance = |a: &StudiedStep, b: &StudiedStep| {
            let row = &b.study.rows[b.chosen];
            a.distance(&row.params, row.measured.cost.size_bytes).unwrap_or(f64::INFINITY)
        };
        let pairs = (0..self.kept.len()).flat_map(|a| (a + 1..self.kept.len()).map(move |b| (a, b)));
        let nearest = pairs.min_by(|x, y| {
            let [x, y] = [x, y].map(|&(a, b)| distance(&self.kept[a], &self.kept[b]));
            x.total_cmp(&y)
        });
        nearest.map_or(0, |(older, _)| older)
    }

    /// The kept step that a step of this size, made with `params`, is like; the newest of several.
    pub fn nearest(&self, params: &GenerationParams, size_bytes: u64) -> Option<&StudiedStep> {
        let near = |k: &&StudiedStep| k.is_like(params, size_bytes);
        let distance = |k: &&StudiedStep| k.distance(params, size_bytes).unwrap_or(f64::INFINITY);
        self.kept.iter().rev().filter(near).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Forgets those that a step of this size, made with `params`, is like and that `chosen` was chosen on: it did not serve.
    pub fn forget(&mut self, params: &GenerationParams, size_bytes: u64, chosen: &GenerationParams) {
        self.kept.retain(|k| k.study.rows[k.chosen].params != *chosen || !k.is_like(params, size_bytes));
    }

    /// The trials of the step studied last.
    pub fn newest(&self) -> &[Trial] {
        self.kept.last().map_or(&[], |step| &step.study.rows)
    }

    /// The trials of each, those of the step studied last first.
    pub(crate) fn tables(&self) -> impl Iterator<Item = &[Trial]> {
        self.kept.iter().rev().map(|step| &step.study.rows[..])
    }

    /// How many are kept.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// True before the first study.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }
}

/// What new parameters must gain before those in use are given up: decibels, or a share of whatever else is wanted.
const WORTH_CHANGING_DB: f64 = 0.2;
const WORTH_CHANGING: f64 = 0.03;

/// The row to use: the study's best, or the parameters in use where they keep the contract and lose next to nothing, so that
/// pictures do not change their grain for no gain. Where nothing keeps the contract, what comes nearest.
pub fn choose(study: &Study, contract: &Contract, in_use: Option<&GenerationParams>) -> Option<usize> {
    let Some(best) = study.best else { return study.nearest(contract) };
    let worth = match contract.utility() {
        Utility::Quality => WORTH_CHANGING_DB,
        Utility::Size | Utility::Time | Utility::Expression(_) => WORTH_CHANGING * study.rows[best].cost.abs(),
    };
    let same = study.rows.iter().position(|r| Some(&r.params) == in_use && r.cost < f64::INFINITY);
    Some(same.filter(|&n| study.rows[n].cost - study.rows[best].cost < worth).unwrap_or(best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluator::Measurement;
    use lamina_model::Cost;
    use lamina_model::{Quality, ViewError};

    fn params(r: u32, gamma: f64) -> GenerationParams {
        GenerationParams::vdi(r, gamma).unwrap()
    }

    /// A step of a field `much` times as rich: sigma = much r^1.8 gamma^-0.3, q = 20 log10 r - 50 gamma.
    fn study(step: u64, much: f64, limit: u64) -> Study {
        let mut study = Study { step, rows: Vec::new(), best: None };
        for (r, gamma) in
            [(96, 0.005), (96, 0.02), (96, 0.1), (160, 0.01), (192, 0.02), (256, 0.02), (224, 0.02), (240, 0.015)]
        {
            let size_bytes = (much * f64::from(r).powf(1.8) * f64::powf(gamma, -0.3)) as u64;
            let mse = 10_f64.powf(-(20.0 * f64::from(r).log10() - 50.0 * gamma) / 10.0);
            let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse], ssim: None }] };
            let measured = Measurement { cost: Cost { size_bytes, ..Cost::default() }, quality };
            let cost = Contract::size(limit).cost(&measured);
            study.add(Trial { params: params(r, gamma), measured, cost });
        }
        study
    }

    #[test]
    fn a_step_is_like_the_one_whose_table_says_its_size() {
        let mut all = CharacteristicSteps::default();
        for (step, much) in [(0, 1.0), (10, 1.6)] {
            let study = study(step, much, 50_000);
            let chosen = study.best.unwrap();
            all.keep(study, chosen, false);
        }
        let size = |much: f64| (much * 224_f64.powf(1.8) * 0.02_f64.powf(-0.3)) as u64;
        let like = |all: &CharacteristicSteps, much| all.nearest(&params(224, 0.02), size(much)).map(|k| k.study.step);
        let found = [1.05, 1.5, 1.28, 3.0].map(|much| like(&all, much));
        assert_eq!(found, [Some(0), Some(10), None, None]);
        assert!(all.nearest(&params(4000, 2.0), size(1.0)).is_none(), "no table knows this");
        all.forget(&params(224, 0.02), size(1.05), &params(1, 0.5));
        assert_eq!(like(&all, 1.05), Some(0), "other parameters than those that did not serve");
        let chosen = all.kept[0].study.rows[all.kept[0].chosen].params;
        all.forget(&params(224, 0.02), size(1.05), &chosen);
        assert_eq!((like(&all, 1.05), like(&all, 1.5)), (None, Some(10)));
    }

    #[test]
    fn memory_is_bounded_and_different_steps_stay() {
        let mut all = CharacteristicSteps::default();
        for n in 0..40_u32 {
            // Slow growth, with one step that is like no other.
            let much = if n == 5 { 20.0 } else { 1.0 + 0.02 * f64::from(n) };
            let study = study(n.into(), much, 50_000_000);
            all.keep(study, 0, false);
        }
        assert_eq!(all.len(), MOST);
        assert!(all.kept.iter().any(|k| k.study.step == 5) && all.kept.iter().any(|k| k.study.step == 39));
    }

    #[test]
    fn parameters_stay_unless_others_gain() {
        let mut study = study(0, 1.0, 50_000);
        let best = study.best.unwrap();
        let contract = Contract::size(50_000);
        assert_eq!(choose(&study, &contract, None), Some(best));
        // 0.005 in gamma and 16 rays differ by 0.35 dB: worth changing; the same parameters are not changed.
        assert_eq!(choose(&study, &contract, Some(&study.rows[best].params)), Some(best));
        assert_eq!(choose(&study, &contract, Some(&params(96, 0.1))), Some(best));
        // As good but for 0.1 dB: not worth changing; but for 0.3 dB it is, and so is what breaks the limit.
        for (loss_db, size_bytes, stays) in [(0.1, 49_000, true), (0.3, 49_000, false), (0.1, 51_000, false)] {
            let mut row = study.rows[best].clone();
            row.params = params(77, 0.077);
            row.measured.cost.size_bytes = size_bytes;
            row.measured.quality.views[0].batch_mse[0] *= 10_f64.powf(loss_db / 10.0);
            row.cost = contract.cost(&row.measured);
            study.rows.push(row);
            let expected = if stays { study.rows.len() - 1 } else { best };
            assert_eq!(choose(&study, &contract, Some(&params(77, 0.077))), Some(expected), "{loss_db} dB");
            study.rows.pop();
        }
    }
}
