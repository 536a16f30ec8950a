//! Priority queue of heavy work, with aging: work that has waited long precedes more urgent work that came later.

use std::time::Duration;
use tokio::time::Instant;

/// Purpose of heavy work, the most urgent first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Priority {
    /// A picture for a user who waits for it.
    Picture,
    /// A trial of a run's first study, of which nothing is in use yet.
    FirstTrial,
    /// A live step.
    LiveStep,
    /// Another trial.
    Trial,
    /// The quality of a live step.
    Quality,
}

impl Priority {
    /// All priorities, the most urgent first.
    pub const ALL: [Self; 5] = [Self::Picture, Self::FirstTrial, Self::LiveStep, Self::Trial, Self::Quality];

    /// Its name in metrics and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Picture => "picture",
            Self::FirstTrial => "first_trial",
            Self::LiveStep => "live_step",
            Self::Trial => "trial",
            Self::Quality => "quality",
        }
    }

    /// The priority of a study's trial: urgent as long as nothing of a run's first study is in use.
    pub fn of_trial(is_urgent: bool) -> Self {
        if is_urgent { Self::FirstTrial } else { Self::Trial }
    }
}

/// Waiting time that raises work by one level of priority, so that live steps come between the trials of a long first study.
pub(super) const AGING: Duration = Duration::from_secs(1);

/// The waiting tickets, and whether one of them is at work.
#[derive(Debug, Default)]
pub(super) struct Queue {
    next_ticket: u64,
    waiting: Vec<Waiting>,
    /// What is at work.
    at_work: Option<Priority>,
}

#[derive(Debug)]
struct Waiting {
    ticket: u64,
    priority: Priority,
    since: Instant,
}

impl Queue {
    /// Adds a waiting ticket and returns it.
    pub(super) fn join(&mut self, priority: Priority, now: Instant) -> u64 {
        self.next_ticket += 1;
        self.waiting.push(Waiting { ticket: self.next_ticket, priority, since: now });
        self.next_ticket
    }

    /// Removes a waiting ticket.
    pub(super) fn leave(&mut self, ticket: u64) {
        self.waiting.retain(|w| w.ticket != ticket);
    }

    /// True if no ticket is at work and `ticket` is the first of those waiting.
    pub(super) fn is_next(&self, ticket: u64, now: Instant) -> bool {
        self.at_work.is_none() && self.first(now) == Some(ticket)
    }

    /// True if a ticket of `priority` is at work or waits.
    pub(super) fn has(&self, priority: Priority) -> bool {
        self.at_work == Some(priority) || self.waiting.iter().any(|w| w.priority == priority)
    }

    /// How long `ticket` has been waiting.
    pub(super) fn waited(&self, ticket: u64, now: Instant) -> Duration {
        let since = self.waiting.iter().find(|w| w.ticket == ticket).map(|w| w.since);
        since.map_or(Duration::ZERO, |since| now.saturating_duration_since(since))
    }

    /// True if no ticket is at work or waiting.
    pub(super) fn is_idle(&self) -> bool {
        self.at_work.is_none() && self.waiting.is_empty()
    }

    /// Number of waiting tickets.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Moves the waiting `ticket` to work.
    pub(super) fn begin(&mut self, ticket: u64) {
        self.at_work = self.waiting.iter().find(|w| w.ticket == ticket).map(|w| w.priority);
        self.leave(ticket);
    }

    /// Ends the work in progress.
    pub(super) fn end(&mut self) {
        self.at_work = None;
    }

    fn first(&self, now: Instant) -> Option<u64> {
        let urgency = |w: &Waiting| {
            let aged = now.saturating_duration_since(w.since).as_secs_f64() / AGING.as_secs_f64();
            (w.priority as i64 - aged as i64, w.ticket)
        };
        self.waiting.iter().min_by_key(|w| urgency(w)).map(|w| w.ticket)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_urgent_comes_first_and_who_waits_long_becomes_urgent() {
        let (mut queue, start) = (Queue::default(), Instant::now());
        let quality = queue.join(Priority::Quality, start);
        let step = queue.join(Priority::LiveStep, start);
        let trial = queue.join(Priority::FirstTrial, start);
        assert!(queue.is_next(trial, start) && !queue.is_next(step, start));
        queue.begin(trial);
        assert!(!queue.is_next(step, start), "one at a time");
        queue.end();
        // The study's next trial comes 1.1 s later: the step is as urgent by then, and came first.
        let later = start + Duration::from_millis(1100);
        let next = queue.join(Priority::FirstTrial, later);
        assert!(queue.is_next(step, later));
        queue.leave(step);
        assert!(queue.is_next(next, later));
        queue.leave(next);
        assert!(queue.is_next(quality, later) && queue.len() == 1 && !queue.is_idle());
    }
}
