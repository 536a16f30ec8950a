//! What is best under which limit, and what it gives on another step.

use super::step_study::StepStudy;
use crate::cli;
use lamina_tuner::Contract;
use lamina_tuner::tune::Trial;

/// Each limit of a ladder is so many times the one before: the paper's Fig. 8 and 9.
const RUNG: f64 = 1.5;
/// Rungs of the ladder of sizes, from 100 kB up, and of that of times.
const SIZES: i32 = 8;
const TIMES: i32 = 6;

/// Contracts with one limit each.
pub(super) struct StudyLimits {
    /// On size, rising.
    pub size: Vec<Contract>,
    /// On generation time, rising.
    pub time: Vec<Contract>,
}

impl StudyLimits {
    /// Those that the user names, or ladders.
    pub(super) fn new(arguments: &cli::StudyArguments, all: &[StepStudy]) -> Self {
        let size: Vec<u64> = if arguments.size_limits.is_empty() {
            (0..SIZES).map(|k| (1e5 * RUNG.powi(k)).round() as u64).collect()
        } else {
            arguments.size_limits.iter().map(|b| b.0).collect()
        };
        let time: Vec<f64> = if arguments.time_limits.is_empty() {
            let first = 1.25 * ms_at_least(all);
            (0..TIMES).map(|k| (10.0 * first * RUNG.powi(k)).round() / 10.0).collect()
        } else {
            arguments.time_limits.iter().map(|t| t.0).collect()
        };
        let (mut size, mut time) = (size, time);
        size.sort_unstable();
        time.sort_by(f64::total_cmp);
        Self {
            size: size.into_iter().map(Contract::size).collect(),
            time: time.into_iter().filter(|t| *t > 0.0).map(Contract::time).collect(),
        }
    }
}

/// The time that a tenth of the trials of every step keeps: less would leave nothing to choose from.
fn ms_at_least(all: &[StepStudy]) -> f64 {
    let tenth = |m: &StepStudy| {
        let mut times: Vec<f64> = m.rows.iter().map(|r| 1e3 * r.measured.cost.generation.as_secs_f64()).collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 10).copied().unwrap_or(0.0)
    };
    all.iter().map(tenth).fold(0.0, f64::max)
}

/// The row of least cost under `contract`; `None` if no row keeps it.
pub(super) fn best(rows: &[Trial], contract: &Contract) -> Option<usize> {
    let costs = rows.iter().map(|r| contract.cost(&r.measured)).enumerate();
    costs.filter(|(_, cost)| *cost < f64::INFINITY).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(n, _)| n)
}

/// By which share a row exceeds the limit on size or time: 0.1 is a tenth; negative if it keeps it.
pub(super) fn excess(contract: &Contract, row: &Trial) -> f64 {
    contract.excess(&row.measured.cost, f64::NAN).exp() - 1.0
}

/// Parameters chosen on one step, used on another: the paper's Table 1.
pub(super) struct ChoiceTransfer<'a> {
    /// The limit.
    pub contract: &'a Contract,
    /// Chosen on this step.
    pub from: &'a StepStudy,
    /// Used on this one.
    pub to: &'a StepStudy,
    /// What was chosen.
    pub chosen: &'a Trial,
    /// What it gives there.
    pub used: &'a Trial,
    /// What would have been chosen there, if anything keeps the limit there.
    pub own: Option<&'a Trial>,
}

impl ChoiceTransfer<'_> {
    /// By which share the limit is exceeded; see [`excess`].
    pub(super) fn excess(&self) -> f64 {
        excess(self.contract, self.used)
    }

    /// Decibels below what would have been chosen there; negative if the transfer is better because it breaks the limit.
    pub(super) fn loss_db(&self) -> Option<f64> {
        self.own.map(|own| own.measured.quality.psnr_db() - self.used.measured.quality.psnr_db())
    }
}

/// Every transfer between two steps of the same input, both ways, under each of `contracts`.
pub(super) fn transfers<'a>(all: &'a [StepStudy], contracts: &'a [Contract]) -> Vec<ChoiceTransfer<'a>> {
    let mut transfers = Vec::new();
    for (from, to) in all.iter().flat_map(|a| all.iter().map(move |b| (a, b))) {
        if from.name != to.name || from.step == to.step {
            continue;
        }
        for contract in contracts {
            let Some(chosen) = best(&from.rows, contract).map(|n| &from.rows[n]) else { continue };
            let Some(used) = to.rows.iter().find(|r| r.params == chosen.params) else { continue };
            let own = best(&to.rows, contract).map(|n| &to.rows[n]);
            transfers.push(ChoiceTransfer { contract, from, to, chosen, used, own });
        }
    }
    transfers
}
