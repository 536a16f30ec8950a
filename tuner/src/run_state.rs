//! What is known of the run watched, and what time there is for studies.

use crate::Contract;
use crate::characteristic_steps::{CharacteristicSteps, StudiedStep};
use crate::search::CandidateSet;
use crate::tune::Trial;
use lamina_model::{Cost, StepReport};
use std::collections::VecDeque;
use std::time::Duration;
use tokio::time::Instant;

/// What is known of the run watched.
pub(crate) struct RunState {
    pub id: String,
    pub since: Instant,
    pub characteristic: CharacteristicSteps,
    pub studied_step: Option<u64>,
    /// Wall time of the first study, of all after it, and what the next is to have at least.
    pub first: Duration,
    pub later: Duration,
    next: Duration,
    /// What the last study chose from.
    pub candidates: CandidateSet,
    pub pace: TrialPace,
    /// Trials of a study that nodes cut short.
    pub carried: Vec<Trial>,
}

/// How many times as long as trials live steps take: beside them the simulation and the viewers compute, and a step's data are
/// new to the processor's caches.
#[derive(Default)]
pub(crate) struct TrialPace(VecDeque<f64>);

impl TrialPace {
    /// Steps looked back at.
    const STEPS: usize = 5;

    /// A step took `live` where a trial of the same parameters on a step like it took `trial`, milliseconds.
    pub(crate) fn add(&mut self, live: f64, trial: f64) {
        let ratio = live / trial;
        if ratio.is_finite() {
            self.0.truncate(Self::STEPS - 1);
            self.0.push_front(ratio);
        }
    }

    /// The middle of the last ones, at least 1.
    pub(crate) fn ratio(&self) -> f64 {
        let mut ratios: Vec<f64> = self.0.iter().copied().collect();
        ratios.sort_by(f64::total_cmp);
        ratios.get(ratios.len() / 2).map_or(1.0, |&middle| middle.max(1.0))
    }
}

impl RunState {
    pub(crate) fn new(id: String) -> Self {
        let (characteristic, none) = (CharacteristicSteps::default(), Duration::ZERO);
        Self {
            id,
            since: Instant::now(),
            characteristic,
            studied_step: None,
            first: none,
            later: none,
            next: none,
            candidates: CandidateSet::default(),
            pace: TrialPace::default(),
            carried: Vec::new(),
        }
    }

    /// True if there is time for a study: those after the first, with another that is worth beginning, take no more than this
    /// share of the time since the run was first seen. The first is always made; a budget of 1 is none.
    pub(crate) fn may_study(&self, budget: f64) -> bool {
        let with_another = (self.later + self.next).as_secs_f64();
        let affordable = with_another <= budget * self.since.elapsed().as_secs_f64();
        self.studied_step.is_none() || budget >= 1.0 || affordable
    }

    /// When a study that begins now has to end: with it, those after the first take that share. The first one has all the time.
    pub(crate) fn until(&self, budget: f64) -> Option<Instant> {
        let limited = self.studied_step.is_some() && budget < 1.0;
        // It is itself a part of the run.
        let left = || (budget * self.since.elapsed().as_secs_f64() - self.later.as_secs_f64()) / (1.0 - budget);
        limited.then(|| Instant::now() + Duration::from_secs_f64(left().max(0.0)))
    }

    /// Forgets what was chosen, under another contract; gives the trials measured last, which the next study goes on from. That one
    /// has all the time, as the first had.
    pub(crate) fn forget_choices(&mut self) -> Vec<Trial> {
        let newest = std::mem::take(&mut self.characteristic).newest().to_vec();
        if !newest.is_empty() {
            self.carried = newest;
        }
        (self.studied_step, self.next) = (None, Duration::ZERO);
        self.carried.clone()
    }

    /// The step studied that a reported one is like.
    pub(crate) fn nearest_studied(&self, report: &StepReport) -> Option<&StudiedStep> {
        self.characteristic.nearest(&report.params, report.cost.size_bytes)
    }

    /// Takes in how long a reported step took, if time is limited and its parameters were tried on a step like it.
    pub(crate) fn timed(&mut self, report: &StepReport, contract: &Contract) {
        if contract.limits.time_ms.is_none() {
            return;
        }
        let ms = |cost: Cost| contract.time_of(&cost);
        let tried = self.nearest_studied(report).and_then(|step| {
            step.study.rows.iter().find(|row| row.params == report.params).map(|row| row.measured.cost)
        });
        if let Some(trial) = tried {
            self.pace.add(ms(report.cost), ms(trial));
        }
    }

    /// A study ended. A quarter of its time, some first trials, is worth beginning another for; where one was cut short, twice
    /// as much. What gave nothing tells neither.
    pub(crate) fn record_study(&mut self, time: Duration, first: bool, end: StudyEnd) {
        *(if first { &mut self.first } else { &mut self.later }) += time;
        match end {
            StudyEnd::Whole => self.next = time / 4,
            // A node that stood still tells nothing.
            StudyEnd::Cut(given) => self.next = 2 * self.next.max(time.min(given)),
            StudyEnd::Failed => {}
        }
    }
}

/// How a study ended.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum StudyEnd {
    Whole,
    /// This time was too short for it.
    Cut(Duration),
    Failed,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_is_the_middle_of_the_last_live_steps_and_no_less_than_that_of_trials() {
        let mut pace = TrialPace::default();
        assert_eq!(pace.ratio(), 1.0);
        pace.add(3.0, 6.0);
        assert_eq!(pace.ratio(), 1.0, "faster than its trial");
        pace.add(5.0, 0.0);
        pace.add(12.0, 6.0);
        pace.add(90.0, 6.0);
        assert_eq!(pace.ratio(), 2.0, "one that something else disturbed counts no more than the others");
        for _ in 0..5 {
            pace.add(9.0, 6.0);
        }
        assert_eq!((pace.ratio(), pace.0.len()), (1.5, 5));
    }

    #[test]
    fn studies_after_the_first_stay_within_their_budget() {
        let second = Duration::from_secs(1);
        let mut run = RunState::new("a".to_owned());
        assert!(run.may_study(0.0), "the first is always made");
        // Nobody measured for a minute: no price of tuning.
        run.record_study(60 * second, true, StudyEnd::Failed);
        run.record_study(2 * second, true, StudyEnd::Whole);
        run.studied_step = Some(0);
        let mut at = |secs: u32, later: u32| {
            run.since = Instant::now() - secs * second;
            run.later = later * second;
            run.may_study(0.05)
        };
        // Another of half a second within 5 %.
        assert!(!at(9, 0) && at(11, 0));
        assert!(!at(49, 2) && at(51, 2) && at(100, 2));
        run.record_study(2 * second, false, StudyEnd::Whole);
        assert_eq!((run.later, run.next), (4 * second, second / 2));
        for budget in [0.05, 0.4] {
            let left = (run.until(budget).unwrap() - Instant::now()).as_secs_f64();
            // 4 s of 100 are taken.
            let share = (4.0 + left) / (100.0 + left);
            assert!(left > 0.0 && (share - budget).abs() < 1e-3, "{left} s: {share}");
        }
        assert_eq!(run.until(1.0), None);
        assert_eq!(RunState::new(String::new()).until(0.05), None, "the first has all the time");
        assert!(!run.may_study(0.04) && run.may_study(1.0), "all of the time is no limit");

        // Cut short again and again, a study has more and more time, and all of them keep to the budget.
        let (mut run, mut last) = (RunState::new("a".to_owned()), Duration::ZERO);
        run.record_study(second, true, StudyEnd::Whole);
        run.studied_step = Some(0);
        for _ in 0..8 {
            while !run.may_study(0.05) {
                run.since -= second / 10;
            }
            let begun = Instant::now();
            // The last of it is too short for a trial.
            let took = (run.until(0.05).unwrap() - begun) * 3 / 4;
            assert!(took > last, "{took:?} after {last:?}");
            (run.since, last) = (run.since - took, took);
            run.record_study(took, false, StudyEnd::Cut(took));
            assert!(run.later.as_secs_f64() <= 0.05 * run.since.elapsed().as_secs_f64());
        }
        assert!(last > 4 * second, "{last:?}");
        let before = run.next;
        run.record_study(3600 * second, false, StudyEnd::Cut(second));
        assert_eq!(run.next, 2 * before, "a node that stood still is paid for, but not expected to do so again");
    }
}
