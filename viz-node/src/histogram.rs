//! Distributions as Prometheus counts them: how many observations lie at or below each bound.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};

/// Observations by bound.
#[derive(Debug)]
pub(crate) struct Histogram {
    bounds: &'static [f64],
    /// Between one bound and the next; the last is above all.
    counts: Vec<AtomicU64>,
    /// Bits of a double.
    sum: AtomicU64,
}

impl Histogram {
    /// Nothing observed; `bounds` ascend.
    pub(crate) fn new(bounds: &'static [f64]) -> Self {
        Self { bounds, counts: (0..=bounds.len()).map(|_| AtomicU64::new(0)).collect(), sum: AtomicU64::new(0) }
    }

    /// Counts `value`; one that is not finite counts as above all bounds, and not in the sum.
    pub(crate) fn observe(&self, value: f64) {
        let place = self.bounds.iter().position(|bound| value <= *bound).unwrap_or(self.bounds.len());
        self.counts[place].fetch_add(1, Ordering::Relaxed);
        if value.is_finite() {
            let add = |bits| Some((f64::from_bits(bits) + value).to_bits());
            let _ = self.sum.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add);
        }
    }

    /// The family `lamina_NAME` in text format 0.0.4.
    pub(crate) fn write(&self, text: &mut String, name: &str, help: &str) {
        // Writing to a String cannot fail.
        let _ = write!(text, "# HELP lamina_{name} {help}\n# TYPE lamina_{name} histogram\n");
        let mut below = 0;
        for (place, count) in self.counts.iter().enumerate() {
            below += count.load(Ordering::Relaxed);
            let bound = self.bounds.get(place).map_or("+Inf".to_owned(), f64::to_string);
            let _ = writeln!(text, "lamina_{name}_bucket{{le=\"{bound}\"}} {below}");
        }
        let sum = f64::from_bits(self.sum.load(Ordering::Relaxed));
        let _ = write!(text, "lamina_{name}_sum {sum}\nlamina_{name}_count {below}\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_are_cumulative_and_end_with_all() {
        let histogram = Histogram::new(&[0.1, 1.0]);
        [0.05, 0.1, 0.5, 7.0, f64::INFINITY].into_iter().for_each(|value| histogram.observe(value));
        let mut text = String::new();
        histogram.write(&mut text, "x_seconds", "What it is.");
        let expected = "# HELP lamina_x_seconds What it is.\n# TYPE lamina_x_seconds histogram\n\
            lamina_x_seconds_bucket{le=\"0.1\"} 2\nlamina_x_seconds_bucket{le=\"1\"} 3\n\
            lamina_x_seconds_bucket{le=\"+Inf\"} 5\nlamina_x_seconds_sum 7.65\nlamina_x_seconds_count 5\n";
        assert_eq!(text, expected);
    }
}
