//! What a node of a group hears of the others: runs that the root opens, ranks that come here, steps that all others are past.

use super::core::Core;
use super::run::IngestRun;
use super::service::Ingest;
use super::{IngestError, RunSpec};
use std::time::{Duration, Instant};

/// The root's word takes no longer to a member than a rank that it sends there, but for so much.
const TOLD_WITHIN: Duration = Duration::from_secs(1);

impl Core {
    /// The same of a rank that the root of a group sends to this member, as one of its run `run_id`.
    pub fn join(&mut self, spec: RunSpec, rank: u32, run_id: &str, now: Instant) -> Result<String, IngestError> {
        if !self.follows(run_id) {
            return Err(IngestError::UnknownRun(run_id.to_owned()));
        }
        self.open(spec, rank, run_id, String::new(), now)
    }

    /// The root of the group has opened run `run_id`: the one before has ended, whether or not its ranks are still here.
    pub fn follow(&mut self, run_id: &str) {
        self.root_run = Some(run_id.to_owned());
        if self.run.as_ref().is_some_and(|run| run.id != run_id) {
            self.abandon_run();
        }
    }

    /// The root says why bricks of all members cannot make up a step: each rank hears of it in place of its next brick.
    pub fn refuse(&mut self, run_id: &str, reason: &str) {
        if let Ok(run) = self.run(run_id) {
            run.refusals = run.attached.iter().map(|rank| (*rank, reason.to_owned())).collect();
        }
    }

    /// The root makes nothing of `step`: bricks of it that are still to come are not taken.
    pub fn drop_step(&mut self, run_id: &str, step: u64) {
        if let Ok(run) = self.run(run_id) {
            run.drop_step(step);
            self.forget(step);
        }
    }

    /// True if this is the run that the root has opened last.
    pub fn follows(&self, run_id: &str) -> bool {
        self.root_run.as_deref() == Some(run_id)
    }

    /// A member of the group has heard of run `run_id`.
    pub fn heard(&mut self, run_id: &str, now: Instant) {
        if let Ok(run) = self.run(run_id) {
            run.last_heard = now;
        }
    }

    /// So many ranks of run `run_id` bring their bricks to this node of a group.
    pub fn tell_ranks(&mut self, run_id: &str, ranks: u32, now: Instant) {
        self.told = Some((run_id.to_owned(), ranks));
        let Ok(run) = self.run(run_id) else { return };
        run.told_ranks = Some(ranks);
        let steps: Vec<u64> = run.steps.keys().copied().collect();
        for step in steps {
            let is_complete =
                |run: &mut IngestRun| run.steps.get(&step).is_some_and(|a| a.is_complete(ranks, &run.lost));
            let complete = self.run(run_id).is_ok_and(is_complete);
            if complete {
                self.complete(run_id, step, now);
            }
        }
    }
}

impl Ingest {
    /// The root of the group has opened run `run_id`.
    pub(crate) fn follow(&self, run_id: &str) {
        self.core().follow(run_id);
        self.room.notify_waiters();
    }

    /// The root says why bricks of all members cannot make up a step.
    pub(crate) fn refuse(&self, run_id: &str, reason: &str) {
        self.core().refuse(run_id, reason);
    }

    /// The root makes nothing of `step`.
    pub(crate) fn drop_step(&self, run_id: &str, step: u64) {
        self.core().drop_step(run_id, step);
        self.room.notify_waiters();
    }

    /// Waits for the root's word that it has opened run `run_id`: a rank that it sends here may be faster.
    pub(super) async fn announced(&self, run_id: &str) {
        let heard = async {
            loop {
                let told = self.room.notified();
                if self.core().follows(run_id) {
                    return;
                }
                told.await;
            }
        };
        drop(tokio::time::timeout(TOLD_WITHIN, heard).await);
    }

    /// A member of the group has heard of run `run_id`.
    pub(crate) fn heard(&self, run_id: &str) {
        self.core().heard(run_id, Instant::now());
    }

    /// So many ranks of run `run_id` bring their bricks to this node of a group.
    pub(crate) fn tell_ranks(&self, run_id: &str, ranks: u32) {
        self.core().tell_ranks(run_id, ranks, Instant::now());
        self.ready.notify_one();
        self.room.notify_waiters();
    }

    /// The simulation's steps took `interval` each since its last push, which took `push`.
    pub(crate) fn time_step(&self, interval: Duration, push: Duration) {
        self.overhead.step(interval, push);
    }

    /// Steps whose number is a multiple of this are pushed.
    pub(crate) fn cadence(&self) -> u32 {
        self.overhead.coupling().cadence
    }

    /// The root of the group keeps the limit on overhead.
    pub(crate) fn set_cadence(&self, cadence: u32) {
        self.overhead.set_cadence(cadence);
    }

    /// All other members of the group are past `step`.
    pub(crate) fn overdue(&self, run_id: &str, step: u64, time: f64) {
        self.core().overdue(run_id, (step, time), Instant::now());
        self.ready.notify_one();
        self.room.notify_waiters();
    }
}
