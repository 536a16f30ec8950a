//! nu: what the user wants, as a cost of a measurement.

use lamina_model::{Indicators, Invalid};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// The paper's utilities: best quality under one limit.
#[doc(alias = "nu")]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Utility {
    /// Eq. 1: the best quality among those whose encoded VDI has at most this many bytes.
    Size {
        /// The limit, bytes.
        limit_bytes: u64,
    },
    /// Eq. 2: the best quality among those generated within this time.
    Time {
        /// The limit, milliseconds.
        limit_ms: f64,
    },
}

impl Utility {
    /// Passes a limit that something could meet.
    ///
    /// # Errors
    /// If the limit is zero, negative or not a number.
    pub fn check(self) -> Result<Self, Invalid> {
        match self {
            Self::Size { limit_bytes: 0 } => {
                Err(Invalid::new("utility.size.limit_bytes", "0 bytes hold no VDI; give a size above 0"))
            }
            Self::Time { limit_ms } if !(limit_ms > 0.0 && limit_ms < 1e12) => Err(Invalid::new(
                "utility.time.limit_ms",
                format!("{limit_ms} must be a number of milliseconds above 0"),
            )),
            valid => Ok(valid),
        }
    }

    /// alpha: lower is better; +infinity breaks the limit or measures nothing.
    #[doc(alias = "alpha")]
    pub fn cost(&self, indicators: &Indicators) -> f64 {
        let feasible = self.keeps_limit(indicators.size_bytes, indicators.generation_time);
        if feasible && !indicators.psnr_db.is_nan() { -indicators.psnr_db } else { f64::INFINITY }
    }

    /// True if a step of this size and generation time keeps the limit.
    pub fn keeps_limit(&self, size_bytes: u64, generation_time: Duration) -> bool {
        match *self {
            Self::Size { limit_bytes } => size_bytes <= limit_bytes,
            Self::Time { limit_ms } => generation_time.as_secs_f64() * 1e3 <= limit_ms,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cost_is_negative_quality_within_the_limit_and_infinite_beyond() {
        let m =
            |size_bytes, psnr_db, ms| Indicators { size_bytes, psnr_db, generation_time: Duration::from_millis(ms) };
        let size = Utility::Size { limit_bytes: 100 };
        assert_eq!(size.cost(&m(100, 30.0, 9)), -30.0);
        assert_eq!(size.cost(&m(101, 30.0, 9)), f64::INFINITY);
        assert_eq!(size.cost(&m(50, f64::INFINITY, 9)), f64::NEG_INFINITY);
        assert_eq!(size.cost(&m(50, f64::NAN, 9)), f64::INFINITY);
        let time = Utility::Time { limit_ms: 40.0 };
        assert_eq!(time.cost(&m(1 << 40, 20.0, 40)), -20.0);
        assert_eq!(time.cost(&m(1, 20.0, 41)), f64::INFINITY);
        assert!(
            Utility::Time { limit_ms: f64::NAN }.check().is_err() && Utility::Size { limit_bytes: 0 }.check().is_err()
        );
    }
}
