//! The pace of a source of steps, as a simulation has one, and how fast it turned out.

use crate::cli::StepsPerSecond;
use std::time::{Duration, Instant};

/// Lets steps begin no faster than at a pace.
#[derive(Debug)]
pub struct Pacer {
    interval: Duration,
    next: Instant,
    begun: Instant,
    steps: u32,
    computing: Duration,
}

impl Pacer {
    /// The first step begins now.
    pub fn new(pace: StepsPerSecond) -> Self {
        let interval = if pace.0 > 0.0 { Duration::from_secs_f64(1.0 / pace.0) } else { Duration::ZERO };
        let now = Instant::now();
        Self { interval, next: now, begun: now, steps: 0, computing: Duration::ZERO }
    }

    /// Another pace from the next step on.
    pub fn set(&mut self, pace: StepsPerSecond) {
        self.interval = Self::new(pace).interval;
        self.next = self.next.min(Instant::now() + self.interval);
    }

    /// Waits until the next step is due, or `stopped`. A late step does not make the next ones early.
    pub fn wait(&mut self, stopped: &impl Fn() -> bool) {
        while !stopped() {
            let Some(left) = self.next.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) else {
                break;
            };
            std::thread::sleep(left.min(Duration::from_millis(50)));
        }
        let now = Instant::now();
        // Less than an interval is caught up with.
        let late = now.saturating_duration_since(self.next) > self.interval;
        self.next = if late { now } else { self.next } + self.interval;
    }

    /// A step was computed in so much time.
    pub fn computed(&mut self, time: Duration) {
        self.steps += 1;
        self.computing += time;
    }

    /// Steps a second, and milliseconds of computing a step.
    pub fn speed(&self) -> String {
        let steps = f64::from(self.steps.max(1));
        let per_second = steps / self.begun.elapsed().as_secs_f64();
        let ms = 1e3 * self.computing.as_secs_f64() / steps;
        format!("{per_second:.1} steps a second, {ms:.0} ms of computing each")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_begin_no_earlier_than_the_pace_says_and_a_late_one_does_not_hurry_the_next() {
        let mut pacer = Pacer::new(StepsPerSecond(50.0));
        let begun = Instant::now();
        pacer.wait(&|| false);
        std::thread::sleep(Duration::from_millis(70));
        (0..3).for_each(|_| pacer.wait(&|| false));
        // 70 ms, at once, and two intervals of 20 ms.
        assert!(begun.elapsed() >= Duration::from_millis(109), "{:?}", begun.elapsed());
        let begun = Instant::now();
        pacer.wait(&|| true);
        (0..1000).for_each(|_| Pacer::new(StepsPerSecond(0.0)).wait(&|| false));
        assert!(begun.elapsed() < Duration::from_secs(5), "stopped, or without a pace");
        pacer.computed(Duration::from_millis(30));
        pacer.computed(Duration::from_millis(10));
        assert!(pacer.speed().ends_with("20 ms of computing each"), "{}", pacer.speed());
    }
}
