//! The encoder's choice of residuals.
use super::multigrid::{Level, within};
use super::settings::Settings;
use super::symbols::RAW;

/// The volume as it is, and what of it may be shown differently.
pub struct Wanted<'a, F> {
    /// Values in the order of voxels.
    pub values: &'a [f32],
    /// Largest error of a value that is shown.
    pub bound: f32,
    /// Interval within which the value at an index is not shown, if there is one: it takes the place of the bound.
    pub free: F,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> Wanted<'_, F> {
    /// Whether `value` will do for `wanted`, which may be `free`.
    #[inline(always)]
    fn accepts(&self, free: Option<(f32, f32)>, wanted: f32, value: f32) -> bool {
        match free {
            Some((low, high)) => low <= value && value <= high,
            None => (f64::from(value) - f64::from(wanted)).abs() <= f64::from(self.bound),
        }
    }
}

/// Most steps that are tried.
const MOST: f32 = RAW as f32 / 2.0;

/// Value `steps` from what is expected.
#[inline]
pub fn reconstruct(range: [f32; 2], level: &Level, expected: f32, steps: i32) -> f32 {
    let bias = level.bias * steps.signum() as f32;
    within(range, expected + (steps as f32 * level.step - bias))
}

/// Chooses the residuals.
pub struct Quantiser<'a, F> {
    /// What to come close to.
    pub wanted: &'a Wanted<'a, F>,
    /// All values lie within.
    pub range: [f32; 2],
    /// How bytes are spent.
    pub settings: Settings,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> Quantiser<'_, F> {
    /// Steps from `expected` to the value wanted at `at`, and the value they give; `RAW` if no number of steps does.
    #[inline(always)]
    pub fn steps(&self, level: &Level, at: usize, expected: f32) -> (f32, i32) {
        let wanted = self.wanted.values[at];
        let error = (wanted - expected) * level.scale;
        let free = (self.wanted.free)(at);
        let loose = free.is_some() && level.number < self.settings.loose;
        if (loose || error.abs() < 0.5 + self.settings.thrift) && self.wanted.accepts(free, wanted, expected) {
            return (expected, 0);
        }
        let sign = if error < 0.0 { -1 } else { 1 };
        let enough = (error.abs() + level.bias * level.scale - self.settings.thrift + 0.5).clamp(1.0, MOST) as i32;
        let least = match free {
            Some((low, high)) if loose => {
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
        (wanted, RAW)
    }
}
