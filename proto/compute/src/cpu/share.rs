//! Admission of a node's heavy work, so that it keeps to a share of the processor.
//!
//! There are three lanes with one piece of work at a time each: pictures for users, live steps, and everything else by priority.
//! Pictures have a token bucket of their own with more than half of the rate, so that neither the debt of a long trial delays
//! pictures, nor continuous drawing stops the trials. Live steps have one, too: they wait neither for a trial's end nor for what
//! it owes. Of a first study they do as long as nothing of it is in use: for its trials a second each at most, and for what those
//! owe. Without a limit there is nobody to leave the processor to, and live steps and trials take turns, so that neither disturbs
//! the other's times.

use super::limit::CpuLimit;
use super::queue::{AGING, Priority, Queue};
use super::threads::{Laps, Scheduling, pool};
use super::token_bucket::TokenBucket;
use super::usage::{Activity, Usage};
use parking_lot::{Mutex, MutexGuard};
use rayon::{ThreadPool, ThreadPoolBuildError};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Notify;
use tokio::task::{JoinError, spawn_blocking};
use tokio::time::{Instant, sleep};

/// Share of the rate that pictures may use.
const PICTURES: f64 = 0.6;
/// Share of the rate that live steps may use while trials owe theirs. What is left beside it and pictures is for trials and quality.
const LIVE_STEPS: f64 = 0.25;

/// Processor time granted to one node, or to several in one process. Clones share it.
#[derive(Clone)]
pub struct CpuShare {
    inner: Arc<Inner>,
}

struct Inner {
    /// Work in the background runs on so many threads.
    threads: usize,
    background: ThreadPool,
    live_steps: ThreadPool,
    pictures: ThreadPool,
    state: Mutex<ShareState>,
    /// Notifies waiting work of changes.
    changed: Notify,
}

struct ShareState {
    /// Granted; infinite without a limit.
    cores: f64,
    total: TokenBucket,
    pictures: TokenBucket,
    live_steps: TokenBucket,
    /// Queue of each lane.
    queues: [Queue; 3],
    usage: Usage,
    /// Share of the rate in use, at most 1; see [`CpuShare::throttle`].
    throttle: f64,
    /// See [`CpuShare::hold`].
    held_until: Option<Instant>,
}

impl ShareState {
    fn lane(&self, priority: Priority) -> Lane {
        match priority {
            Priority::Picture => Lane::Pictures,
            Priority::LiveStep if self.cores.is_finite() => Lane::LiveSteps,
            _ => Lane::Background,
        }
    }

    fn queue(&mut self, lane: Lane) -> &mut Queue {
        &mut self.queues[lane as usize]
    }

    /// Whether everybody waits for a first study, and `lane` comes behind it.
    fn is_behind(&self, lane: Lane) -> bool {
        lane == Lane::LiveSteps && self.queues[Lane::Background as usize].has(Priority::FirstTrial)
    }

    /// How long until there are tokens.
    fn owed(&mut self, lane: Lane, now: Instant) -> Duration {
        match lane {
            Lane::Pictures => self.pictures.wait(now),
            Lane::LiveSteps if !self.is_behind(lane) => self.total.wait(now).min(self.live_steps.wait(now)),
            Lane::LiveSteps | Lane::Background => self.total.wait(now),
        }
    }

    /// How long `ticket` has to wait for tokens; `None` while it is not its turn.
    fn wait(&mut self, priority: Priority, ticket: u64, now: Instant) -> Option<Duration> {
        let lane = self.lane(priority);
        let (owed, held) = (self.owed(lane, now), self.held(lane, now));
        let patience = if self.is_behind(lane) { AGING } else { Duration::ZERO };
        let queue = self.queue(lane);
        let patience = patience.saturating_sub(queue.waited(ticket, now));
        queue.is_next(ticket, now).then(|| owed.max(held).max(patience))
    }

    fn held(&self, lane: Lane, now: Instant) -> Duration {
        let until = self.held_until.filter(|_| lane != Lane::Pictures);
        until.map_or(Duration::ZERO, |until| until.saturating_duration_since(now))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Lane {
    Pictures,
    LiveSteps,
    Background,
}

impl std::fmt::Debug for CpuShare {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CpuShare").field("cores", &self.cores()).finish_non_exhaustive()
    }
}

impl CpuShare {
    /// A share of `limit`, on threads of lower priority.
    ///
    /// # Errors
    /// If the system refuses threads.
    pub fn new(limit: CpuLimit) -> Result<Self, ThreadPoolBuildError> {
        let threads = limit.cores().ceil() as usize;
        Self::on(limit.cores(), threads, Scheduling::Background)
    }

    /// The whole processor without a limit: for a run that waits for its nodes.
    ///
    /// # Errors
    /// If the system refuses threads.
    pub fn unlimited() -> Result<Self, ThreadPoolBuildError> {
        Self::on(f64::INFINITY, CpuLimit::machine() as usize, Scheduling::Normal)
    }

    fn on(cores: f64, threads: usize, scheduling: Scheduling) -> Result<Self, ThreadPoolBuildError> {
        let now = Instant::now();
        let state = ShareState {
            cores,
            total: TokenBucket::new(cores, now),
            pictures: TokenBucket::new(PICTURES * cores, now),
            live_steps: TokenBucket::new(LIVE_STEPS * cores, now),
            queues: Default::default(),
            usage: Usage::default(),
            throttle: 1.0,
            held_until: None,
        };
        let inner = Inner {
            threads,
            background: pool(threads, scheduling, "kernel")?,
            live_steps: pool(threads, scheduling, "step")?,
            pictures: pool(threads, Scheduling::Normal, "picture")?,
            state: Mutex::new(state),
            changed: Notify::new(),
        };
        Ok(Self { inner: Arc::new(inner) })
    }

    fn state(&self) -> MutexGuard<'_, ShareState> {
        self.inner.state.lock()
    }

    /// Number of cores granted; infinite without a limit.
    pub fn cores(&self) -> f64 {
        self.state().cores
    }

    /// Grants `limit` from now on; at most as many cores as it has threads, which are those of the limit that it began with.
    pub fn set_limit(&self, limit: CpuLimit) {
        let throttle = {
            let (mut state, now) = (self.state(), Instant::now());
            if state.cores.is_infinite() {
                return;
            }
            state.cores = limit.cores().min(self.inner.threads as f64);
            let rate = PICTURES * state.cores;
            state.pictures.set_rate(rate, now);
            state.throttle
        };
        self.throttle(throttle);
    }

    /// Statistics of its use so far.
    pub fn usage(&self) -> Usage {
        self.state().usage
    }

    /// Number of pieces of work that wait.
    pub fn waiting(&self) -> usize {
        self.state().queues.iter().map(Queue::len).sum()
    }

    /// Share of the granted rate in use, at most 1.
    pub fn throttled_to(&self) -> f64 {
        self.state().throttle
    }

    /// Its state for metrics: name, what it is, value.
    pub fn gauges(&self) -> [(&'static str, &'static str, f64); 3] {
        [
            ("cpu_share_cores", "Cores that this node may use.", self.cores()),
            ("cpu_share_throttle", "Share of them in use to keep a limit on overhead.", self.throttled_to()),
            ("cpu_share_waiting", "Pieces of heavy work that wait.", self.waiting() as f64),
        ]
    }

    /// Limits work other than pictures to the fraction `share` (0 to 1) of the granted rate from now on.
    pub fn throttle(&self, share: f64) {
        let mut state = self.state();
        state.throttle = share;
        if state.cores.is_finite() {
            let (rate, now) = ((state.cores * share).max(1e-3), Instant::now());
            state.total.set_rate(rate, now);
            state.live_steps.set_rate(LIVE_STEPS * rate, now);
        }
        drop(state);
        self.inner.changed.notify_waiters();
    }

    /// Admits only pictures for `time` from now on, or until called again: to measure the simulation without load.
    pub fn hold(&self, time: Duration) {
        self.state().held_until = Some(Instant::now() + time);
        self.inner.changed.notify_waiters();
    }

    /// Waits for a permit: for its turn and for tokens. Dropping the future gives up its place in the queue.
    pub async fn acquire(&self, priority: Priority) -> Permit {
        let (lane, ticket) = {
            let mut state = self.state();
            let lane = state.lane(priority);
            (lane, state.queue(lane).join(priority, Instant::now()))
        };
        let place = Place { share: self, lane, ticket };
        loop {
            let changed = self.inner.changed.notified();
            tokio::pin!(changed);
            changed.as_mut().enable();
            let wait = {
                let mut state = self.state();
                let wait = state.wait(priority, ticket, Instant::now());
                if wait == Some(Duration::ZERO) {
                    state.queue(lane).begin(ticket);
                    state.usage.admit(priority);
                    std::mem::forget(place);
                    return Permit { share: self.clone(), lane, priority };
                }
                wait
            };
            match wait {
                Some(wait) => tokio::select! {
                    () = changed => {}
                    () = sleep(wait) => {}
                },
                // Aging may change whose turn it is.
                None => tokio::select! {
                    () = changed => {}
                    () = sleep(Duration::from_millis(250)) => {}
                },
            }
        }
    }

    /// A permit if nobody works or waits in its lane and there are tokens; otherwise the work counts as skipped.
    pub fn try_acquire(&self, priority: Priority) -> Option<Permit> {
        let (mut state, now) = (self.state(), Instant::now());
        let lane = state.lane(priority);
        let waits = state.owed(lane, now).max(state.held(lane, now)) > Duration::ZERO;
        if waits || !state.queue(lane).is_idle() {
            state.usage.skip(priority);
            return None;
        }
        let ticket = state.queue(lane).join(priority, now);
        state.queue(lane).begin(ticket);
        state.usage.admit(priority);
        Some(Permit { share: self.clone(), lane, priority })
    }

    /// Counts work of `priority` that was left out.
    pub fn skip(&self, priority: Priority) {
        self.state().usage.skip(priority);
    }

    fn spend(&self, priority: Priority, spent: &[(Activity, Duration)]) {
        let (mut state, now) = (self.state(), Instant::now());
        for (activity, time) in spent {
            state.usage.spend(*activity, *time);
            state.total.debit(*time, now);
            match priority {
                Priority::Picture => state.pictures.debit(*time, now),
                Priority::LiveStep => state.live_steps.debit(*time, now),
                Priority::FirstTrial | Priority::Trial | Priority::Quality => {}
            }
        }
    }
}

/// A place in a queue, given up when this is dropped.
struct Place<'a> {
    share: &'a CpuShare,
    lane: Lane,
    ticket: u64,
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.share.state().queue(self.lane).leave(self.ticket);
        self.share.inner.changed.notify_waiters();
    }
}

/// The right to use the node's threads, one piece of work at a time in a lane, until this is dropped.
#[derive(Debug)]
pub struct Permit {
    share: CpuShare,
    lane: Lane,
    priority: Priority,
}

impl Permit {
    /// Runs `work` on the node's threads and debits the processor time of all of them: to `activity`, where `work` names no
    /// other in its laps. The permit is held until the work has ended, also when the future is dropped.
    ///
    /// # Errors
    /// If `work` panics.
    pub async fn run<T: Send + 'static>(
        self,
        activity: Activity,
        work: impl FnOnce(&mut Laps) -> T + Send + 'static,
    ) -> Result<T, JoinError> {
        spawn_blocking(move || self.run_blocking(activity, work)).await
    }

    /// The same on a thread that may block.
    pub fn run_blocking<T: Send>(&self, activity: Activity, work: impl FnOnce(&mut Laps) -> T + Send) -> T {
        let pool = match self.lane {
            Lane::Pictures => &self.share.inner.pictures,
            Lane::LiveSteps => &self.share.inner.live_steps,
            Lane::Background => &self.share.inner.background,
        };
        let (done, spent) = pool.install(|| {
            let mut laps = Laps::start();
            let done = work(&mut laps);
            laps.lap(activity);
            (done, laps.spent())
        });
        self.share.spend(self.priority, &spent);
        done
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        self.share.state().queue(self.lane).end();
        self.share.inner.changed.notify_waiters();
    }
}

#[cfg(test)]
mod tests;
