//! A search that keeps off the limits, and goes up to them only where it has to.

use super::request::{SearchRequest, SearchResult, search};
use crate::Contract;
use crate::evaluator::{Evaluator, TrialError};
use crate::tune::{Study, Trial};

/// Searches under what the contract of `request` [aims](Contract::aim) at, and if nothing comes up to that, under the contract
/// itself; see [`search`] for the rest. Trials of both are passed to `progress`.
///
/// # Errors
/// Those of [`search`].
pub async fn search_with_margin(
    trial: &mut impl Evaluator,
    mut request: SearchRequest<'_>,
    mut progress: impl FnMut(&Trial) + Send,
) -> Result<SearchResult, TrialError> {
    let contract = request.contract;
    let aim = contract.aim();
    let found = search(trial, request.under(&aim), &mut progress).await?;
    if found.study.best.is_some() || aim == *contract {
        return Ok(found);
    }
    if found.cut {
        return Ok(SearchResult { study: judged(found.study, contract), ..found });
    }
    let nearer = search(trial, request, &mut progress).await?;
    if !nearer.cut {
        return Ok(nearer);
    }
    // What the first one measured is known all the same.
    let mut study = nearer.study;
    let new = found.study.rows.into_iter().filter(|row| study.rows.iter().all(|known| known.params != row.params));
    let new: Vec<Trial> = new.collect();
    study.rows.extend(new);
    Ok(SearchResult { study: judged(study, contract), ..nearer })
}

/// `study` with costs under `contract`.
fn judged(mut study: Study, contract: &Contract) -> Study {
    study.rows.iter_mut().for_each(|row| row.cost = contract.cost(&row.measured));
    study.on_common_pixels(contract)
}
