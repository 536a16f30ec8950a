//! The search beside the exhaustive study: it asks for trials that the study has measured, and each is charged the processor
//! time that measuring it took. So both see the same noise, and a limit on time is kept or broken by the same figure.

use super::choices::{best, excess};
use super::step_study::StepStudy;
use lamina::in_process::InProcessEvaluator;
use lamina::process::ProcessorTime;
use lamina_model::Cost;
use lamina_model::{GenerationParams, Invalid, ParamsKey};
use lamina_tuner::Contract;
use lamina_tuner::evaluator::{self, Batches, Evaluator, TrialError};
use lamina_tuner::search::{CandidateSet, SearchRequest, search};
use lamina_tuner::tune::Trial;
use std::collections::{HashMap, HashSet};
use std::time::Duration;

/// What a search found under one contract, beside the best of all.
pub(super) struct Outcome {
    /// The input's name.
    pub name: String,
    /// Which step of it.
    pub step: u64,
    /// The contract.
    pub contract: Contract,
    /// The exhaustive choice.
    pub best: Option<Trial>,
    /// The search's, as the exhaustive study measured it.
    pub found: Option<Trial>,
    /// Trials it took, those included that ended once generation was timed.
    pub trials: usize,
    /// Processor time of what it measured, and its own, seconds.
    pub cpu_secs: f64,
    /// The same of the exhaustive study.
    pub exhaustive_secs: f64,
}

impl Outcome {
    /// Decibels that the search's choice lacks.
    pub(super) fn regret_db(&self) -> Option<f64> {
        let db = |row: &Trial| row.measured.quality.psnr_db();
        self.best.as_ref().zip(self.found.as_ref()).map(|(best, found)| db(best) - db(found))
    }

    /// By which share the search's choice exceeds the limit; see [`excess`].
    pub(super) fn excess(&self) -> Option<f64> {
        self.found.as_ref().map(|row| excess(&self.contract, row))
    }
}

/// Answers from what was measured.
struct RecordedEvaluator<'a> {
    study: &'a mut InProcessEvaluator,
    /// Processor time of the march that gives sizes, seconds, once it was made.
    march_secs: &'a mut Option<f64>,
    /// Batches given so far.
    given: HashMap<ParamsKey, u32>,
    /// What anything was asked of.
    asked: HashSet<ParamsKey>,
    spent_secs: f64,
}

impl Evaluator for RecordedEvaluator<'_> {
    fn step(&self) -> u64 {
        self.study.step()
    }

    fn batches(&self) -> u32 {
        self.study.batches()
    }

    fn longest_side(&self) -> u32 {
        self.study.longest_side()
    }

    async fn sizes(&mut self, params: &GenerationParams, gammas: &[f64]) -> Result<Vec<Cost>, TrialError> {
        // No exhaustive study has a figure for it: it is made once.
        if self.march_secs.is_none() {
            let before = ProcessorTime::now();
            self.study.sizes(params, gammas).await?;
            *self.march_secs = Some(before.secs().unwrap_or(0.0));
        }
        self.spent_secs += self.march_secs.unwrap_or(0.0);
        let cost = |gamma: &f64| {
            let trial = self.study.trial(&params.with_gamma(*gamma)?);
            trial.map(|t| t.cost).ok_or_else(|| unmeasured().into())
        };
        gammas.iter().map(cost).collect()
    }

    async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        let Some(trial) = self.study.trial(params) else { return Ok(Err(unmeasured())) };
        self.spent_secs += 1e-9 * trial.spent.generate_ns as f64;
        self.asked.insert(params.key());
        Ok(Ok(trial.cost.generation))
    }

    async fn evaluate(
        &mut self,
        params: &[GenerationParams],
        batches: Batches,
    ) -> Result<Vec<Result<evaluator::Measurement, Invalid>>, TrialError> {
        Ok(params.iter().map(|p| self.one(p, batches)).collect())
    }
}

impl RecordedEvaluator<'_> {
    fn one(&mut self, params: &GenerationParams, batches: Batches) -> Result<evaluator::Measurement, Invalid> {
        let trial = self.study.trial(params).ok_or_else(unmeasured)?;
        let (spent, key) = (&trial.spent, params.key());
        let before = self.given.get(&key).copied();
        let all = trial.quality.batches() as u32;
        let wanted = batches.count(all).max(before.unwrap_or(0));
        self.asked.insert(key);
        let mut ns = 0.0;
        if before.is_none() {
            ns += (spent.generate_ns + spent.encode_ns) as f64;
        }
        if before.unwrap_or(0) == 0 && wanted > 0 {
            ns += spent.decode_ns as f64;
        }
        ns += spent.quality_ns as f64 * f64::from(wanted - before.unwrap_or(0)) / f64::from(all.max(1));
        self.spent_secs += 1e-9 * ns;
        self.given.insert(key, wanted);
        Ok(evaluator::Measurement { cost: trial.cost, quality: trial.quality.first(wanted as usize) })
    }
}

fn unmeasured() -> Invalid {
    Invalid::new("trial", "was not measured")
}

/// Searches every measured step under each contract.
pub(super) fn outcomes(all: &mut [StepStudy], contracts: &[&Contract]) -> anyhow::Result<Vec<Outcome>> {
    let runtime = tokio::runtime::Builder::new_current_thread().build()?;
    let mut outcomes = Vec::new();
    for m in all {
        let mut march_secs = None;
        let candidates: Vec<GenerationParams> = m.rows.iter().map(|r| r.params).collect();
        let spent = candidates.iter().filter_map(|p| m.trial.trial(p));
        let exhaustive_secs = spent.map(|t| t.spent.secs()).sum();
        for contract in contracts {
            // Its own arithmetic; the march, if it is made now, counts as it does every time.
            let (marched, before) = (march_secs.is_some(), ProcessorTime::now());
            let (study, march_secs) = (&mut m.trial, &mut march_secs);
            let mut replay =
                RecordedEvaluator { study, march_secs, given: HashMap::new(), asked: HashSet::new(), spent_secs: 0.0 };
            let mut candidates = CandidateSet::from(candidates.clone());
            let request = SearchRequest::new(contract, &mut candidates);
            let found = runtime.block_on(search(&mut replay, request, |_| {}))?;
            let (spent_secs, trials) = (replay.spent_secs, replay.asked.len());
            let march = march_secs.filter(|_| !marched).unwrap_or(0.0);
            let own_secs = (before.secs().unwrap_or(0.0) - march).max(0.0);
            let chosen = found.study.best.map(|n| found.study.rows[n].params);
            let measured = |p| m.rows.iter().find(|r| r.params == p).cloned();
            outcomes.push(Outcome {
                name: m.name.clone(),
                step: m.step,
                contract: (*contract).clone(),
                best: best(&m.rows, contract).map(|n| m.rows[n].clone()),
                found: chosen.and_then(measured),
                trials,
                cpu_secs: spent_secs + own_secs,
                exhaustive_secs,
            });
        }
    }
    Ok(outcomes)
}

/// The searches in one sentence.
pub(super) fn summary(outcomes: &[Outcome]) -> String {
    let feasible: Vec<&Outcome> = outcomes.iter().filter(|o| o.best.is_some()).collect();
    let regret = feasible.iter().filter_map(|o| o.regret_db()).fold(0.0, f64::max);
    let missed = feasible.iter().filter(|o| o.found.is_none()).count();
    let broken = outcomes.iter().filter(|o| o.excess().is_some_and(|e| e > 0.0)).count();
    let shares: Vec<f64> = outcomes.iter().map(|o| o.exhaustive_secs / o.cpu_secs.max(1e-9)).collect();
    let least = shares.iter().copied().fold(f64::INFINITY, f64::min);
    format!(
        "{} searches, {} under limits that something keeps: at most {regret:.3} dB below the best of all, {missed} found nothing, \
         {broken} broke a limit; at least {least:.0} times less processor time than measuring everything.",
        outcomes.len(),
        feasible.len()
    )
}
