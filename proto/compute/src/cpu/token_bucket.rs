//! Token bucket: processor seconds that accrue at a constant rate up to a capacity.
//!
//! Work is admitted while the level is positive and debited when it has ended, by what it took. A debit may leave the level
//! negative; then nothing is admitted until the debt has accrued.

use std::time::Duration;
use tokio::time::Instant;

/// Seconds of accrual that the bucket holds when full.
const CAPACITY_SECS: f64 = 1.0;

/// Processor seconds, accruing.
#[derive(Debug)]
pub(super) struct TokenBucket {
    /// Processor seconds per second; infinite without a limit.
    rate: f64,
    level: f64,
    at: Instant,
}

impl TokenBucket {
    /// A full bucket.
    pub(super) fn new(rate: f64, now: Instant) -> Self {
        Self { rate, level: Self::capacity(rate), at: now }
    }

    fn capacity(rate: f64) -> f64 {
        CAPACITY_SECS * rate
    }

    /// Changes the rate from `now` on.
    pub(super) fn set_rate(&mut self, rate: f64, now: Instant) {
        self.accrue(now);
        self.rate = rate;
        self.level = self.level.min(Self::capacity(rate));
    }

    /// Processor seconds at hand; negative: owed.
    pub(super) fn level(&mut self, now: Instant) -> f64 {
        self.accrue(now);
        self.level
    }

    /// Takes `spent` processor time out.
    pub(super) fn debit(&mut self, spent: Duration, now: Instant) {
        self.accrue(now);
        if self.rate.is_finite() {
            self.level -= spent.as_secs_f64();
        }
    }

    /// How long until the level is positive; zero if it is.
    pub(super) fn wait(&mut self, now: Instant) -> Duration {
        let level = self.level(now);
        if level > 0.0 {
            return Duration::ZERO;
        }
        // A little more than the debt, so that rounding does not make it a second wait.
        Duration::from_secs_f64(((1e-3 - level) / self.rate).clamp(1e-4, 3600.0))
    }

    fn accrue(&mut self, now: Instant) {
        let elapsed = now.saturating_duration_since(self.at).as_secs_f64();
        self.at = self.at.max(now);
        self.level = if self.rate.is_finite() {
            (self.level + self.rate * elapsed).min(Self::capacity(self.rate))
        } else {
            f64::INFINITY
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_admitted_over_time_is_the_rate_and_one_capacity() {
        let start = Instant::now();
        let mut bucket = TokenBucket::new(0.5, start);
        let (mut now, mut spent) = (start, 0.0_f64);
        // Work of 0.3 processor seconds, whenever it is admitted.
        while now < start + Duration::from_secs(100) {
            now += bucket.wait(now);
            bucket.debit(Duration::from_millis(300), now);
            spent += 0.3;
            now += Duration::from_millis(10);
        }
        // Each piece overdraws by up to its own length, and the last one ends after the loop.
        assert!((50.2..51.2).contains(&spent), "{spent}");
    }

    #[test]
    fn a_debt_is_waited_for_and_idle_time_fills_no_more_than_the_capacity() {
        let start = Instant::now();
        let mut bucket = TokenBucket::new(0.5, start);
        bucket.debit(Duration::from_secs(2), start);
        let wait = bucket.wait(start).as_secs_f64();
        assert!((wait - 3.0).abs() < 0.01, "1.5 s are owed: {wait}");
        let later = start + Duration::from_secs(1000);
        assert_eq!((bucket.level(later), bucket.wait(later)), (0.5, Duration::ZERO));
        bucket.set_rate(0.1, later);
        assert_eq!(bucket.level(later), 0.1);
        bucket.set_rate(f64::INFINITY, later);
        bucket.debit(Duration::from_secs(50), later);
        assert_eq!(bucket.wait(later), Duration::ZERO, "no limit");
    }
}
