//! The simulation's own pace as its pushes show it, and which of them the node does without.

use std::time::{Duration, Instant};

/// What a push tells the node of those before.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Timing {
    /// Mean time of a step since the last push; zero if there was none.
    pub interval: Duration,
    /// What that push took.
    pub push: Duration,
}

/// When the last push began and ended, and the calls since.
#[derive(Debug, Default)]
pub(crate) struct Pace {
    begun: Option<Instant>,
    took: Duration,
    /// Calls since the last push began, this one among them.
    calls: u32,
    /// The step that was asked about last, if it is wanted, and when: its push is no further call, and begins then.
    wanted: Option<(u64, Instant)>,
    /// When the step that is pushed now was asked about.
    asked: Option<Instant>,
    /// Only steps whose number is a multiple of this are wanted; 0: as 1.
    cadence: u32,
    timing: Timing,
}

impl Pace {
    /// Counts a call; true if the node does without it: it is not the cadence's number of calls behind the last push, or its step is not one
    /// that all ranks push. Where the simulation's numbers are never such, every second time is good enough.
    pub(crate) fn passes_over(&mut self, step: u64) -> bool {
        self.asked = self.wanted.take().filter(|(wanted, _)| *wanted == step).map(|(_, at)| at);
        if self.asked.is_some() {
            return false;
        }
        self.calls += 1;
        let cadence = self.cadence.max(1);
        let is_due = step.is_multiple_of(cadence.into()) && self.calls >= cadence;
        cadence > 1 && !is_due && self.calls < 2 * cadence
    }

    /// The next push is of this step, which is counted already, and what the simulation does until then is for it.
    pub(crate) fn expect(&mut self, step: u64, now: Instant) {
        self.wanted = Some((step, now));
    }

    /// A push begins, or began when the simulation asked whether its step is wanted; what it tells the node. A second try of the same
    /// call tells the same.
    pub(crate) fn begin(&mut self, now: Instant) -> Timing {
        if self.calls > 0 {
            let now = self.asked.take().unwrap_or(now);
            let since = self.begun.map_or(Duration::ZERO, |begun| now.saturating_duration_since(begun));
            self.timing = Timing { interval: since / self.calls, push: self.took };
            (self.begun, self.calls) = (Some(now), 0);
        }
        self.timing
    }

    /// A push ended, whatever came of it.
    pub(crate) fn pushed(&mut self, now: Instant) {
        self.took = self.begun.map_or(Duration::ZERO, |begun| now.saturating_duration_since(begun));
    }

    /// The node wants every `cadence`-th step.
    pub(crate) fn set_cadence(&mut self, cadence: u32) {
        self.cadence = cadence;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_means_over_the_steps_since_the_last_push() {
        let (mut pace, start, ms) = (Pace::default(), Instant::now(), Duration::from_millis);
        assert!(!pace.passes_over(6));
        assert_eq!(pace.begin(start), Timing::default());
        pace.pushed(start + ms(4));
        assert!(!pace.passes_over(7));
        assert_eq!(pace.begin(start + ms(100)), Timing { interval: ms(100), push: ms(4) });
        pace.set_cadence(4);
        pace.pushed(start + ms(110));
        assert_eq!([9, 10, 11, 12].map(|step| pace.passes_over(step)), [true, true, true, false]);
        // Four steps of 90 ms.
        assert_eq!(pace.begin(start + ms(460)), Timing { interval: ms(90), push: ms(10) });
        assert_eq!(pace.begin(start + ms(470)).interval, ms(90), "a second try");
    }

    #[test]
    fn a_simulation_may_number_its_steps_as_it_likes() {
        // Twelve steps from `first` on, `apart`; how many are pushed.
        for (first, apart, pushed) in [(0, 1, 6), (0, 16, 6), (1, 10, 3)] {
            let mut pace = Pace::default();
            let mut count = 0;
            for n in 0..12 {
                if !pace.passes_over(first + apart * n) {
                    pace.begin(Instant::now());
                    pace.set_cadence(2);
                    count += 1;
                }
            }
            assert_eq!(count, pushed, "{first}, {apart} apart");
        }
    }

    #[test]
    fn a_step_that_was_asked_about_is_counted_once_and_its_push_begins_then() {
        let (mut pace, start, ms) = (Pace::default(), Instant::now(), Duration::from_millis);
        let mut told = Timing::default();
        for (step, at) in [(0, 0), (1, 100), (2, 200)] {
            assert!(!pace.passes_over(step));
            pace.expect(step, start + ms(at));
            assert!(!pace.passes_over(step));
            // Its values take 30 ms, the push 5.
            assert_eq!(pace.begin(start + ms(at + 30)), told, "the step before");
            pace.pushed(start + ms(at + 35));
            told = Timing { interval: ms(100), push: ms(35) };
        }
        // Asked about, and not pushed.
        assert!(!pace.passes_over(3));
        pace.expect(3, start + ms(300));
        assert!(!pace.passes_over(4));
        assert_eq!(pace.begin(start + ms(400)).interval, ms(100));
        pace.pushed(start + ms(405));
        pace.set_cadence(2);
        assert_eq!([5, 6].map(|step| pace.passes_over(step)), [true, false]);
        assert_eq!(pace.begin(start + ms(600)), Timing { interval: ms(100), push: ms(5) });
    }
}
