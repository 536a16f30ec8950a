//! A search over all representations: one after the other, where what the first ones gave is what the next have to beat.

use super::bayesian::BayesianSearch;
use super::candidates::CandidateSet;
use super::deadline::Deadline;
use crate::Contract;
use crate::evaluator::{Evaluator, TrialError};
use crate::tune::{Study, Trial};
use lamina_model::GenerationParams;
use tokio::time::Instant;

/// What is to be searched, and what is known.
#[derive(Debug)]
pub struct SearchRequest<'a> {
    /// What the result has to keep, and what is best.
    pub contract: &'a Contract,
    /// Parameters to choose from. A range of gammas that is found stays in it.
    pub candidates: &'a mut CandidateSet,
    /// Measured before all others if its representation is among the candidates.
    pub in_use: Option<&'a GenerationParams>,
    /// No trial is begun that would probably end later; where this is given the representation in use comes first.
    pub until: Option<Instant>,
    /// Trials of an earlier step, such as those of a study that was interrupted: the models take them in, and the best of them
    /// under the contract is tried first. They are no results.
    pub carried: &'a [Trial],
}

impl<'a> SearchRequest<'a> {
    /// Without end, with nothing known.
    pub fn new(contract: &'a Contract, candidates: &'a mut CandidateSet) -> Self {
        Self { contract, candidates, in_use: None, until: None, carried: &[] }
    }

    /// The same under another contract.
    pub(super) fn under<'b>(&'b mut self, contract: &'b Contract) -> SearchRequest<'b> {
        let Self { candidates, in_use, until, carried, .. } = self;
        SearchRequest { contract, candidates, in_use: *in_use, until: *until, carried }
    }
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchResult {
    /// Its trials; the best of them, if any keeps the contract.
    pub study: Study,
    /// Expected improvement of the candidate most worth trying next, in the utility's unit: dB, kB, ms; `None` where nothing keeps
    /// the contract, or the search was cut short.
    pub left: Option<f64>,
    /// The best probability that some candidate keeps the contract, where none was found to.
    pub hope: f64,
    /// The time was over before it had come to its end: costs are those on the pixels that all were measured on. Or nothing was
    /// found among gammas of an earlier step.
    pub cut: bool,
}

/// Searches the candidates; every trial is passed to `progress`.
///
/// # Errors
/// If a node stops answering, or nothing can be measured.
pub async fn search(
    trial: &mut impl Evaluator,
    request: SearchRequest<'_>,
    mut progress: impl FnMut(&Trial) + Send,
) -> Result<SearchResult, TrialError> {
    let SearchRequest { contract, candidates, in_use, until, carried } = request;
    let mut study = Study { step: trial.step(), rows: Vec::new(), best: None };
    let (mut hope, mut expected, mut stale) = (0.0_f64, Vec::new(), false);
    let (batches, longest_side) = (trial.batches() as usize, trial.longest_side());
    let mut trial = Deadline::new(trial, until);
    let of = |representation| BayesianSearch::new(contract, representation, batches, longest_side, carried);
    let mut searches: Vec<_> = candidates.representations().into_iter().map(of).enumerate().collect();
    if let Some(params) = in_use
        && let Some(n) = searches.iter().position(|(_, s)| s.representation == params.representation())
    {
        searches[n].1.measure(&mut trial, params, &mut progress).await?;
        if until.is_some() {
            searches[..=n].rotate_right(1);
        }
    }
    for (n, mut search) in searches {
        search.to_beat = study.best.map(|n| study.rows[n].cost);
        // No march for a trial that would come too late.
        if trial.enough() {
            let left = trial.left();
            match candidates.resolve(n, trial.inner(), left).await {
                Ok(resolved) => {
                    stale |= resolved.stale;
                    search.take(resolved);
                }
                Err(TrialError::Invalid(reason)) if study.best.is_some() => {
                    tracing::warn!(%reason, "{} left out", search.representation.name());
                }
                Err(error) => return Err(error),
            }
        }
        let (rows, next) = search.run(&mut trial, &mut progress).await?;
        rows.into_iter().for_each(|row| study.add(row));
        hope = hope.max(next.feasible);
        expected.extend(study.best.map(|n| study.rows[n].cost - next.improvement));
    }
    if trial.cut {
        return Ok(SearchResult { study: study.on_common_pixels(contract), left: None, hope, cut: true });
    }
    // What is still expected, beside the best of all.
    let left = study.best.map(|n| {
        let cost = study.rows[n].cost;
        expected.iter().map(|expected| (cost - expected).max(0.0)).fold(0.0, f64::max)
    });
    let cut = stale && study.best.is_none();
    Ok(SearchResult { study, left, hope, cut })
}
