//! Statistics of a step's voxels.

use lamina_model::Voxels;

/// Bins between the least and the largest value: quantiles are within a bin's width.
const BINS: usize = 4096;
/// Bins that the entropy is taken over.
const ENTROPY_BINS: usize = 256;
/// The most voxels that steps are compared at.
const SAMPLES: usize = 1 << 16;

/// The least and the largest of some values, their sum and number; of a step's parts it is added up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    /// The least finite value; infinite if there is none.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// Of the finite values.
    pub sum: f64,
    /// Finite values.
    pub count: u64,
    /// Values that are NaN or infinite.
    pub missing: u64,
}

impl Moments {
    /// Of no values.
    pub(crate) const NONE: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY, sum: 0.0, count: 0, missing: 0 };

    /// Of `values`.
    pub(crate) fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut all = Self::NONE;
        for v in values {
            if v.is_finite() {
                (all.min, all.max) = (all.min.min(v), all.max.max(v));
                (all.sum, all.count) = (all.sum + v, all.count + 1);
            } else {
                all.missing += 1;
            }
        }
        all
    }

    /// Of both parts.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            sum: self.sum + other.sum,
            count: self.count + other.count,
            missing: self.missing + other.missing,
        }
    }

    /// How many of `values`, which lie between the least and the largest, are in each of [`BINS`] equal bins; none where no value is
    /// finite.
    pub(crate) fn histogram(&self, values: impl Iterator<Item = f64>) -> Vec<u64> {
        if self.count == 0 {
            return Vec::new();
        }
        let mut counts = vec![0; BINS];
        let scale = if self.max > self.min { BINS as f64 / (self.max - self.min) } else { 0.0 };
        for v in values.filter(|v| v.is_finite()) {
            counts[(((v - self.min) * scale) as usize).min(BINS - 1)] += 1;
        }
        counts
    }
}

/// Steps are compared at every so manieth of `voxels` voxels.
pub(crate) fn sample_stride(voxels: usize) -> usize {
    voxels.div_ceil(SAMPLES).max(1)
}

/// What a step's finite voxels are like; without any, all values are NaN.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Statistics {
    /// The least value.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// Their mean.
    pub mean: f64,
    /// Voxels that are NaN or infinite.
    pub missing: u64,
    /// Evenly chosen voxels, to compare steps at.
    pub samples: Vec<f64>,
    /// Finite voxels in each bin between `min` and `max`.
    counts: Vec<u64>,
}

impl Statistics {
    /// Of `voxels`, in two passes.
    pub(crate) fn of(voxels: &Voxels) -> Self {
        let values = || (0..voxels.len()).map(|n| voxels.get(n));
        let moments = Moments::of(values());
        Self::new(&moments, moments.histogram(values()), values().step_by(sample_stride(voxels.len())).collect())
    }

    /// Of a step with these `moments`, the histogram of all its values and some of them.
    pub(crate) fn new(moments: &Moments, counts: Vec<u64>, samples: Vec<f64>) -> Self {
        let &Moments { min, max, sum, count, missing } = moments;
        if count == 0 {
            return Self { min: f64::NAN, max: f64::NAN, mean: f64::NAN, missing, samples, counts: Vec::new() };
        }
        Self { min, max, mean: sum / count as f64, missing, samples, counts }
    }

    /// The value below which a share `p` of the voxels lies, within 1/4096 of the range.
    pub(crate) fn quantile(&self, p: f64) -> f64 {
        let all: u64 = self.counts.iter().sum();
        let (wanted, mut below) = (p * all as f64, 0.0);
        let width = (self.max - self.min) / BINS as f64;
        for (bin, &count) in self.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            if below + count as f64 >= wanted {
                let within = ((wanted - below) / count as f64).clamp(0.0, 1.0);
                return self.min + (bin as f64 + within) * width;
            }
            below += count as f64;
        }
        self.max
    }

    /// Shannon entropy of the values in 256 equal bins between the least and the largest, bits.
    pub(crate) fn entropy(&self) -> f64 {
        let all = self.counts.iter().sum::<u64>() as f64;
        let counts = self.counts.chunks(BINS / ENTROPY_BINS).map(|bins| bins.iter().sum::<u64>() as f64);
        let bits: f64 = counts.filter(|n| *n > 0.0).map(|n| -(n / all) * (n / all).log2()).sum();
        if self.counts.is_empty() { f64::NAN } else { bits }
    }

    /// Root mean square of the difference to `before` at the sampled voxels that are finite in both, in ranges of this step; NaN where
    /// there is none.
    pub(crate) fn change_from(&self, before: &[f64]) -> f64 {
        if before.len() != self.samples.len() {
            return f64::NAN;
        }
        let differences = self.samples.iter().zip(before).map(|(a, b)| a - b).filter(|d| d.is_finite());
        let (sum, count) = differences.fold((0.0, 0.0), |(sum, count), d| (sum + d * d, count + 1.0));
        let range = if self.max > self.min { self.max - self.min } else { 1.0 };
        (sum / count).sqrt() / range
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_those_of_closed_forms() {
        // 0, 1, .. 9999, one missing: quantiles and mean of a uniform distribution.
        let mut values: Vec<f64> = (0..10_000).map(f64::from).collect();
        values.push(f64::NAN);
        let of = Statistics::of(&Voxels::F64(values));
        assert_eq!((of.min, of.max, of.mean, of.missing), (0.0, 9999.0, 4999.5, 1));
        for p in [0.0, 0.1, 0.5, 0.999, 1.0] {
            assert!((of.quantile(p) - 9999.0 * p).abs() <= 2.0 * 9999.0 / 4096.0, "{p}: {}", of.quantile(p));
        }
        assert!((of.entropy() - 8.0).abs() < 1e-3, "256 equal bins are 8 bits, not {}", of.entropy());
    }

    #[test]
    fn two_values_are_a_bit_and_one_is_none() {
        let coin = Statistics::of(&Voxels::U8((0..100).map(|n| 7 * (n % 2)).collect()));
        assert_eq!((coin.entropy(), coin.quantile(0.25) < 0.1, coin.quantile(0.75) > 6.9), (1.0, true, true));
        let constant = Statistics::of(&Voxels::U16(vec![3; 9]));
        assert_eq!((constant.entropy(), constant.quantile(0.5), constant.min), (0.0, 3.0, 3.0));
        let none = Statistics::of(&Voxels::F32(vec![f32::NAN; 4]));
        assert!(none.min.is_nan() && none.entropy().is_nan() && none.quantile(0.5).is_nan() && none.missing == 4);
    }
}
