//! Ranges of scalars: from a value to where it lies.

use crate::Invalid;
use serde::{Deserialize, Serialize};

/// How scalars are spread over the transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// In proportion.
    Linear,
    /// By the decadic logarithm, for data that spans decades.
    Log10,
}

/// The scalars that map to 0 and 1 of the transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RangeFields", into = "RangeFields")]
pub struct ScalarRange {
    lo: f64,
    hi: f64,
    scale: Scale,
}

/// A scalar range as written in files.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeFields {
    /// Maps to 0.
    pub lo: f64,
    /// Maps to 1.
    pub hi: f64,
    /// `linear` or `log10`.
    pub scale: Scale,
}

impl TryFrom<RangeFields> for ScalarRange {
    type Error = Invalid;
    fn try_from(f: RangeFields) -> Result<Self, Invalid> {
        Self::new(f.lo, f.hi, f.scale)
    }
}

impl From<ScalarRange> for RangeFields {
    fn from(r: ScalarRange) -> Self {
        Self { lo: r.lo, hi: r.hi, scale: r.scale }
    }
}

impl ScalarRange {
    /// Positions farther from the range are brought to it: in single precision their differences, and rows of a table,
    /// stay numbers.
    pub const FARTHEST: f32 = 1e30;

    /// The range from `lo` to `hi`.
    ///
    /// # Errors
    /// If the ends are not finite, not `lo < hi`, or under [`Scale::Log10`] not positive or without different logarithms.
    pub fn new(lo: f64, hi: f64, scale: Scale) -> Result<Self, Invalid> {
        if !(lo.is_finite() && hi.is_finite() && lo < hi && (hi - lo).is_finite()) {
            return Err(Invalid::new("range", format!("{lo} to {hi} must be two finite numbers, the lower first")));
        }
        if scale == Scale::Log10 && lo <= 0.0 {
            return Err(Invalid::new("range", format!("log10 needs a positive lower end, not {lo}")));
        }
        if scale == Scale::Log10 && hi.ln() <= lo.ln() {
            let text = format!("the logarithms of {lo} and {hi} are the same in double precision; use a linear scale");
            return Err(Invalid::new("range", text));
        }
        Ok(Self { lo, hi, scale })
    }

    /// Lower end, data units.
    pub fn lo(&self) -> f64 {
        self.lo
    }
    /// Upper end, data units.
    pub fn hi(&self) -> f64 {
        self.hi
    }
    /// Linear or logarithmic.
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// Where `value` lies: 0 at `lo`, 1 at `hi`. What is not finite becomes NaN, which is drawn as empty. Values the
    /// logarithm cannot take count as one whole range below `lo`.
    #[inline]
    pub fn unit_from_value(&self, value: f64) -> f32 {
        match self.scale {
            Scale::Linear => Self::linear(value, self.lo, self.hi - self.lo),
            Scale::Log10 => unit(value, if value <= 0.0 { -1.0 } else { self.logarithmic(value) }),
        }
    }

    /// The same under [`Scale::Linear`], from a range's lower end and width: for loops that ask for these once.
    #[inline]
    pub fn linear(value: f64, lo: f64, width: f64) -> f32 {
        unit(value, (value - lo) / width)
    }

    /// Not the logarithm of a ratio: over six hundred decades that has no end.
    fn logarithmic(&self, value: f64) -> f64 {
        ((value.ln() - self.lo.ln()) / (self.hi.ln() - self.lo.ln())).max(-1.0)
    }
}

/// Position `u` of `value`, in single precision.
#[inline]
fn unit(value: f64, u: f64) -> f32 {
    let farthest = f64::from(ScalarRange::FARTHEST);
    if value.is_finite() { u.clamp(-farthest, farthest) as f32 } else { f32::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_range_maps_decades_evenly_and_nonpositive_values_below() {
        let r = ScalarRange::new(0.01, 100.0, Scale::Log10).unwrap();
        assert!((r.unit_from_value(1.0) - 0.5).abs() < 1e-6);
        assert_eq!(r.unit_from_value(-3.0), -1.0);
        assert!(r.unit_from_value(f64::NAN).is_nan() && r.unit_from_value(f64::INFINITY).is_nan());
        assert!(ScalarRange::new(0.0, 1.0, Scale::Log10).is_err());
        assert!(ScalarRange::new(1.0, 1.0, Scale::Linear).is_err());
    }
}
