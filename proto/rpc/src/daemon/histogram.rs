//! Distributions as Prometheus counts them: how many observations lie at or below each bound.

use std::sync::atomic::{AtomicU64, Ordering};

/// Observations by bound.
#[derive(Debug)]
pub struct Histogram {
    bounds: &'static [f64],
    /// Between one bound and the next; the last is above all.
    counts: Vec<AtomicU64>,
    /// Bits of a double.
    sum: AtomicU64,
}

impl Histogram {
    /// Bounds for times of a step, seconds: a factor of two or so apart, from a millisecond to a minute.
    pub const SECONDS: &'static [f64] =
        &[0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 15.0, 60.0];
    /// Bounds for encoded steps, bytes: from 10 kB to 100 MB.
    pub const BYTES: &'static [f64] = &[1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6, 2e6, 5e6, 1e7, 1e8];

    /// Nothing observed; `bounds` ascend.
    pub fn new(bounds: &'static [f64]) -> Self {
        Self { bounds, counts: (0..=bounds.len()).map(|_| AtomicU64::new(0)).collect(), sum: AtomicU64::new(0) }
    }

    /// Counts `value`; one that is not finite counts as above all bounds, and not in the sum.
    pub fn observe(&self, value: f64) {
        let place = self.bounds.iter().position(|bound| value <= *bound).unwrap_or(self.bounds.len());
        self.counts[place].fetch_add(1, Ordering::Relaxed);
        if value.is_finite() {
            let add = |bits| Some((f64::from_bits(bits) + value).to_bits());
            let _ = self.sum.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add);
        }
    }

    /// How many observations are at most each bound, infinity last, and the sum of those that are finite.
    pub(super) fn cumulative(&self) -> (Vec<(f64, u64)>, f64) {
        let mut below = 0;
        let bounds = self.bounds.iter().copied().chain([f64::INFINITY]);
        let count = |(bound, count): (f64, &AtomicU64)| {
            below += count.load(Ordering::Relaxed);
            (bound, below)
        };
        let buckets = bounds.zip(&self.counts).map(count).collect();
        (buckets, f64::from_bits(self.sum.load(Ordering::Relaxed)))
    }
}
