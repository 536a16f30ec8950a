//! The steps of values that were integers before: of 8-bit data each is a multiple of a 255th.
//!
//! Where the bound is finer than such a step, most of the values that a quantizer of the bound's steps tells apart are never there. In
//! units of their own steps such values are integers, and are coded exactly, in as few bins as there are values.
use rayon::prelude::*;

/// Values `first + n width`, with n from 0 on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NativeSteps {
    /// The least value.
    pub first: f32,
    /// The distance of two values next to each other, above 0.
    pub width: f32,
}

/// Values that are looked at for the width of a step, twice, before all are.
const SAMPLED: usize = 1 << 12;
/// The largest bound, in steps, at which coding them exactly takes no more bytes than the bound's quantizer: measured on four scans.
const WIDEST: f32 = 0.6;
/// How near two values are that count as one, in bounds; and how far from its step one may be, in steps.
const SAME: f32 = 0.2;
const NEAR: f32 = 0.01;
/// More steps are not told apart in single precision.
const MOST: f32 = (1 << 20) as f32;

impl NativeSteps {
    /// The steps of `values`, finite or NaN where one is missing, if all are made of such, wide enough for `bound`.
    pub(super) fn of(values: &[f32], bound: f32) -> Option<Self> {
        // From all over, and neighbors: of a ramp either alone may show a multiple of the step.
        let (apart, middle) = (values.len().div_ceil(SAMPLED).max(1), values.len() / 2);
        let neighbors = &values[middle..values.len().min(middle + SAMPLED)];
        let mut sampled: Vec<f32> =
            values.iter().step_by(apart).chain(neighbors).copied().filter(|v| !v.is_nan()).collect();
        sampled.sort_unstable_by(f32::total_cmp);
        let (same, least) = (SAME * bound, bound / WIDEST);
        let mut gaps = sampled.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > same);
        let width = gaps.try_fold(0.0, |width, gap| {
            let common = common_measure(width, gap, same);
            (common >= least).then_some(common)
        })?;
        let [low, high] = super::encode::range(values, *sampled.first()?);
        let count = ((high - low) / width).round();
        if !(1.0..=MOST).contains(&count) {
            return None;
        }
        // Of the whole range, which knows it best.
        let steps = Self { first: low, width: (high - low) / count };
        let most = bound.min(NEAR * steps.width);
        let fits = |value: &f32| value.is_nan() || (steps.value(steps.number(*value)) - value).abs() <= most;
        (steps.width >= least && values.par_iter().all(fits)).then_some(steps)
    }

    /// The number of the step next to `value`.
    pub(super) fn number(&self, value: f32) -> f32 {
        ((value - self.first) / self.width).round_ties_even()
    }

    /// The value of step `number`.
    pub(super) fn value(&self, number: f32) -> f32 {
        self.first + number * self.width
    }
}

/// The largest length that both are multiples of, but for `same`; less than that if there is none. One of them may be 0.
fn common_measure(a: f32, b: f32, same: f32) -> f32 {
    let (mut long, mut short) = (a.max(b), a.min(b));
    while short > same {
        let rest = long - short * (long / short).round();
        (long, short) = (short, rest.abs());
    }
    long
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_integers_are_found_where_they_are_wider_than_the_bound() {
        let units = |numbers: &[u16], of: f32| -> Vec<f32> { numbers.iter().map(|n| f32::from(*n) / of).collect() };
        let bytes = units(&(0..=255).rev().collect::<Vec<_>>(), 255.0);
        let steps = NativeSteps::of(&bytes, 1e-3).unwrap();
        assert_eq!((steps.first, steps.width), (0.0, 1.0 / 255.0));
        assert!(bytes.iter().all(|v| (steps.value(steps.number(*v)) - v).abs() < 1e-7));
        assert!(NativeSteps::of(&bytes, 0.0023).is_some());
        assert_eq!(NativeSteps::of(&bytes, 0.0024), None, "the bound's steps are wider");
        // Of values that are far from each other the greatest common step.
        let few = NativeSteps::of(&units(&[3, 9, 33, 3, 24], 255.0), 1e-4).unwrap();
        assert!((few.width - 3.0 / 255.0).abs() < 1e-7, "{few:?}");
        assert_eq!(few.number(33.0 / 255.0), 10.0);
        let fine = units(&(0..=65535).step_by(3).collect::<Vec<_>>(), 65535.0);
        assert!((NativeSteps::of(&fine, 1e-6).unwrap().width - 3.0 / 65535.0).abs() < 1e-9);
        let smooth: Vec<f32> = (0..5000).map(|n| (n as f32 * 0.01).sin()).collect();
        for (values, what) in [(smooth, "no integers"), (vec![0.5; 9], "one value"), (vec![], "none")] {
            assert_eq!(NativeSteps::of(&values, 1e-4), None, "{what}");
        }
        // One value among them that is none.
        let mut off = bytes;
        off[77] += 0.0015;
        assert_eq!(NativeSteps::of(&off, 1e-3), None);
    }
}
