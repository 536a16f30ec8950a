//! Quantizer of the encoder: chooses the residual of each point.
use super::multigrid::{LevelParams, within};
use super::settings::EncoderSettings;
use super::symbols::RAW_VALUE;

/// The values to encode, and the freedom in encoding them.
pub(super) struct QuantizationTarget<'a, F> {
    /// Values in the order of voxels.
    pub values: &'a [f32],
    /// Largest absolute error of a visible value.
    pub bound: f32,
    /// Interval in which the value at an index is invisible, if there is one; it replaces the bound.
    pub free: F,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> QuantizationTarget<'_, F> {
    /// Whether `value` may be decoded in place of `wanted`, whose interval is `free`.
    #[inline(always)]
    fn accepts(&self, free: Option<(f32, f32)>, wanted: f32, value: f32) -> bool {
        match free {
            Some((low, high)) => low <= value && value <= high,
            None => (f64::from(value) - f64::from(wanted)).abs() <= f64::from(self.bound),
        }
    }
}

/// Largest residual that is tried.
const MOST: f32 = RAW_VALUE as f32 / 2.0;

/// The value that a decoder reconstructs from a prediction and a residual of `steps`.
#[inline]
pub(super) fn reconstruct(range: [f32; 2], level: &LevelParams, expected: f32, steps: i32) -> f32 {
    let bias = level.bias * steps.signum() as f32;
    within(range, expected + (steps as f32 * level.step - bias))
}

/// Chooses residuals.
pub(super) struct Quantizer<'a, F> {
    /// The values to encode.
    pub wanted: &'a QuantizationTarget<'a, F>,
    /// Least and largest value of the volume.
    pub range: [f32; 2],
    /// Parameters of the encoder.
    pub settings: EncoderSettings,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> Quantizer<'_, F> {
    /// The decoded value and the residual, in steps, of the voxel at `at`; the residual is `RAW_VALUE` if none is within bounds.
    #[inline(always)]
    pub(super) fn steps(&self, level: &LevelParams, at: usize, expected: f32) -> (f32, i32) {
        let wanted = self.wanted.values[at];
        let error = (wanted - expected) * level.scale;
        let free = (self.wanted.free)(at);
        let relaxed_levels = free.is_some() && level.number < self.settings.relaxed_levels;
        if (relaxed_levels || error.abs() < 0.5 + self.settings.dead_zone)
            && self.wanted.accepts(free, wanted, expected)
        {
            return (expected, 0);
        }
        let sign = if error < 0.0 { -1 } else { 1 };
        let enough = (error.abs() + level.bias * level.scale - self.settings.dead_zone + 0.5).clamp(1.0, MOST) as i32;
        let least = match free {
            Some((low, high)) if relaxed_levels => {
                let outside = (low - expected).max(expected - high) * level.scale;
                (outside.clamp(1.0, MOST) as i32).min(enough)
            }
            _ => enough,
        };
        for steps in [least, least + 1, enough, enough + 1] {
            let value = reconstruct(self.range, level, expected, sign * steps);
            if self.wanted.accepts(free, wanted, value) {
                return (value, sign * steps);
            }
        }
        (wanted, RAW_VALUE)
    }
}
