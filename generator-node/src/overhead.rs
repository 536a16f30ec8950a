//! Overhead control: how much longer the simulation's steps take beside the node than alone, and what keeps that to a limit.
//!
//! The client tells how long the simulation's steps and its pushes take. From time to time the node pauses its own work for a few
//! steps: the mean step then, without its push, is the simulation alone; that of the steps before and after is the simulation
//! beside the node, whatever steadily changes between them. Two such figures in a row above the limit, because a machine does other
//! things, too, and the node takes every n-th step only and throttles its processor share; where that is not enough it takes
//! cheaper parameters (time a step and bytes). What pushes take by themselves is known without a pause: where it is over half of the
//! limit, they become rarer at once, and more frequent again where it is far below.

use lamina_compute::CpuShare;
use parking_lot::{Mutex, MutexGuard};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// What the node costs the simulation, as far as it is known, and what it does about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// By which share of its time a step of the simulation takes longer beside the node; `None`: not measured.
    pub overhead: Option<f64>,
    /// Share of its processor time that the node allows itself, at most 1.
    pub throttle: f64,
    /// Steps whose number is a multiple of this are pushed.
    pub cadence: u32,
    /// Steps down the ladder of cheaper parameters.
    pub cheaper: usize,
}

/// Steps of the simulation in a pause that count.
const PAUSE_STEPS: u32 = 4;
/// Those between two pauses, at least.
const WORK_STEPS: u32 = 8;
/// Work lasts so many times as long as the pauses, once the limit is kept; before that a third of it.
const WORK_PER_PAUSE: u32 = 9;
/// The throttle that a limit begins with: the first steps are to keep it, too, and nothing has been measured yet.
const FIRST_THROTTLE: f64 = 0.3;
/// Share of the limit aimed at.
const AIM: f64 = 0.7;
/// Share of the limit that pushes may take; the rest is for what the node does meanwhile.
const PUSH_AIM: f64 = 0.5;
/// What a push may take of that at most, for pushes to become more frequent again.
const HYSTERESIS: f64 = 0.7;
/// Pushes whose median tells what they take.
const PUSHES: usize = 5;
/// The least throttle: below it parameters become cheaper.
const LEAST_THROTTLE: f64 = 0.03;
/// The sparsest cadence.
const SPARSEST: u32 = 16;
/// The most steps down the ladder.
const CHEAPEST: usize = 8;

/// What is to happen now.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    /// The node's work pauses, at most for so long.
    Pause(Duration),
    /// It goes on with so much of its share.
    Work(f64),
}

/// The controller, as a plain state machine.
#[derive(Debug)]
struct Controller {
    limit: Option<f64>,
    pausing: bool,
    since: Instant,
    /// An interval across the change counts for neither side.
    skip: bool,
    /// Seconds, of the current phase.
    intervals: Vec<f64>,
    /// What the last pushes under this cadence took, each as a share of the simulation's own time since the push before.
    pushes: Vec<f64>,
    /// The cadence that pushes call for by what they take, and the one that the node's work calls for.
    push_cadence: u32,
    work_cadence: u32,
    /// Mean step beside the node before the last pause, and in that pause.
    before: Option<f64>,
    alone: Option<f64>,
    /// The figure before the last one, under the same throttle.
    last: Option<f64>,
    /// How long the last pause took.
    pause: Duration,
    coupling: Coupling,
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

impl Controller {
    fn new(limit: Option<f64>, now: Instant) -> Self {
        let throttle = if limit.is_some() { FIRST_THROTTLE } else { 1.0 };
        let coupling = Coupling { overhead: None, throttle, cadence: 1, cheaper: 0 };
        Self {
            limit,
            pausing: false,
            since: now,
            skip: true,
            intervals: Vec::new(),
            pushes: Vec::new(),
            push_cadence: 1,
            work_cadence: 1,
            before: None,
            alone: None,
            last: None,
            pause: Duration::ZERO,
            coupling,
        }
    }

    /// The simulation's steps took `interval` each since its last push, which took `push` of the first of them.
    fn step(&mut self, interval: Duration, push: Duration, now: Instant) -> Option<Change> {
        let limit = self.limit?;
        if std::mem::take(&mut self.skip) {
            return None;
        }
        let alone = interval.saturating_sub(push / self.coupling.cadence);
        if alone.is_zero() {
            // The simulation pushes by a rule of its own, and nothing follows from its times.
            return None;
        }
        if self.adapt_to_pushes(push.as_secs_f64() / (alone * self.coupling.cadence).as_secs_f64(), limit) {
            self.begin(false, now);
            return Some(Change::Work(self.coupling.throttle));
        }
        self.intervals.push(if self.pausing { alone } else { interval }.as_secs_f64());
        let elapsed = now.saturating_duration_since(self.since);
        // An interval is the mean of as many as the cadence says; one alone may be a chance.
        let steps = if self.intervals.len() < 2 { 0 } else { self.intervals.len() as u32 * self.coupling.cadence };
        if self.pausing {
            (steps >= PAUSE_STEPS).then(|| {
                self.alone = Some(mean(&self.intervals));
                self.pause = elapsed;
                self.begin(false, now);
                Change::Work(self.coupling.throttle)
            })
        } else {
            let kept = self.coupling.overhead.is_some_and(|overhead| overhead <= limit);
            let long = if kept { WORK_PER_PAUSE } else { WORK_PER_PAUSE / 3 };
            (steps >= WORK_STEPS && elapsed >= long * self.pause).then(|| {
                let beside = mean(&self.intervals);
                let (before, alone) = (self.before.replace(beside), self.alone.take());
                if let Some((before, alone)) = before.zip(alone) {
                    self.measured((0.5 * (before + beside) / alone - 1.0).max(0.0), limit);
                }
                self.begin(true, now);
                // A simulation that falls silent leaves the pause to end by itself.
                let steps = PAUSE_STEPS + 4 * self.coupling.cadence;
                Change::Pause(interval * steps + Duration::from_millis(100))
            })
        }
    }

    fn begin(&mut self, pausing: bool, now: Instant) {
        (self.pausing, self.since, self.skip) = (pausing, now, true);
        self.intervals.clear();
    }

    /// Takes in a figure; acts where it and the one before agree.
    fn measured(&mut self, overhead: f64, limit: f64) {
        let last = self.last.replace(overhead);
        let [least, most] = last.map_or([f64::NEG_INFINITY, f64::INFINITY], |l| [l.min(overhead), l.max(overhead)]);
        self.coupling.overhead = Some(last.map_or(overhead, |l| 0.5 * (l + overhead)));
        let before = self.coupling;
        self.adapt(least, most, limit);
        if self.coupling != before {
            // What was measured so far was under the other setting.
            (self.before, self.last) = (None, None);
        }
    }

    /// Takes in what a push took, as a share of the simulation's own time since the push before; true if pushes are to be rarer or more
    /// frequent for that alone.
    fn adapt_to_pushes(&mut self, share: f64, limit: f64) -> bool {
        if self.pushes.len() == PUSHES {
            self.pushes.remove(0);
        }
        self.pushes.push(share);
        let Some(share) = self.push_share() else { return false };
        let (before, aim) = (self.coupling.cadence, PUSH_AIM * limit);
        // At another cadence the same push is a share of so much more, or less, time.
        let at = |cadence: u32| share * f64::from(before) / f64::from(cadence);
        if share > aim {
            self.push_cadence = before;
            while self.push_cadence < SPARSEST && at(self.push_cadence) > aim {
                self.push_cadence *= 2;
            }
        } else if self.push_cadence > 1 && at(self.push_cadence / 2) <= HYSTERESIS * aim {
            self.push_cadence /= 2;
        }
        self.set_cadence();
        self.coupling.cadence != before
    }

    /// The median of the last pushes, once there are enough.
    fn push_share(&self) -> Option<f64> {
        let mut sorted = self.pushes.clone();
        sorted.sort_by(f64::total_cmp);
        (sorted.len() == PUSHES).then(|| sorted[PUSHES / 2])
    }

    /// The sparser one of what pushes and what the node's work call for. What was measured under another one does not count.
    fn set_cadence(&mut self) {
        let cadence = self.push_cadence.max(self.work_cadence);
        if cadence != self.coupling.cadence {
            self.coupling.cadence = cadence;
            (self.before, self.last) = (None, None);
            self.pushes.clear();
        }
    }

    /// Gives up cadence, then cost, where even the `least` of two figures is too much; takes back in the reverse order what the
    /// limit leaves where even the `most` is little.
    fn adapt(&mut self, least: f64, most: f64, limit: f64) {
        let Coupling { mut throttle, cadence, mut cheaper, overhead } = self.coupling;
        let aim = AIM * limit;
        if least > aim {
            if throttle <= LEAST_THROTTLE && cadence == SPARSEST {
                cheaper = (cheaper + 1).min(CHEAPEST);
            }
            self.work_cadence = (2 * cadence).min(SPARSEST);
            throttle = (throttle * (aim / least).clamp(0.3, 0.95)).max(LEAST_THROTTLE);
        } else if most < 0.5 * limit {
            if throttle < 1.0 {
                throttle = (1.5 * throttle).min(1.0);
            } else if cheaper > 0 {
                cheaper -= 1;
            } else {
                self.work_cadence = (self.work_cadence / 2).max(1);
            }
        }
        self.coupling = Coupling { overhead, throttle, cadence, cheaper };
        self.set_cadence();
    }
}

/// The controller of a node, at work on its share.
#[derive(Debug)]
pub struct Overhead {
    share: CpuShare,
    controller: Mutex<Controller>,
}

impl Overhead {
    /// No limit yet.
    pub fn new(share: CpuShare) -> Arc<Self> {
        Arc::new(Self { share, controller: Mutex::new(Controller::new(None, Instant::now())) })
    }

    fn controller(&self) -> MutexGuard<'_, Controller> {
        self.controller.lock()
    }

    /// What is known and done now.
    pub fn coupling(&self) -> Coupling {
        self.controller().coupling
    }

    /// Sets the limit, a share of the simulation's time; `None`: it is neither kept nor measured.
    pub fn limit(&self, limit: Option<f64>) {
        let mut controller = self.controller();
        if controller.limit != limit {
            *controller = Controller::new(limit, Instant::now());
            self.share.throttle(controller.coupling.throttle);
            self.share.hold(Duration::ZERO);
        }
    }

    /// As the root of a group says, which keeps the limit.
    pub fn set_cadence(&self, cadence: u32) {
        self.controller().coupling.cadence = cadence.clamp(1, SPARSEST);
    }

    /// Another simulation begins: what is known of the last one does not hold for it.
    pub fn restart(&self) {
        let mut controller = self.controller();
        *controller = Controller::new(controller.limit, Instant::now());
        self.share.throttle(controller.coupling.throttle);
    }

    /// The simulation's steps took `interval` each since its last push, which took `push`.
    pub fn step(&self, interval: Duration, push: Duration) {
        let change = self.controller().step(interval, push, Instant::now());
        match change {
            Some(Change::Pause(most)) => self.share.hold(most),
            Some(Change::Work(throttle)) => {
                self.share.hold(Duration::ZERO);
                self.share.throttle(throttle);
            }
            None => {}
        }
    }
}

#[cfg(test)]
mod tests;
