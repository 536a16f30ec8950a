//! What every step is to keep, and by how much it does not.

use crate::Cost;

/// Limits of a contract; `None` does not limit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// The most encoded bytes.
    pub size_bytes: Option<u64>,
    /// The longest wall time of generation, milliseconds.
    pub time_ms: Option<f64>,
    /// True if that time includes encoding.
    pub with_encoding: bool,
    /// The least PSNR over the sampled views, decibels.
    pub psnr_db: Option<f64>,
    /// By which share of its time, above 0 and at most 1, a step of the simulation may take longer beside the nodes than alone.
    pub overhead: Option<f64>,
}

impl Limits {
    /// The time that the limit is about, milliseconds.
    pub fn time_of(&self, cost: &Cost) -> f64 {
        let time = if self.with_encoding { cost.generation + cost.encode } else { cost.generation };
        1e3 * time.as_secs_f64()
    }

    /// By which factor the worst limit on size, time and quality is exceeded, as its natural logarithm: 0 or less keeps all of them,
    /// minus infinity where none is set. Decibels count as amplitude, 20 dB a factor of ten. `psnr_db` is left out where it is NaN.
    pub fn excess(&self, cost: &Cost, psnr_db: f64) -> f64 {
        self.excess_of(cost.size_bytes as f64, self.time_of(cost), psnr_db)
    }

    /// The same of bytes, milliseconds (as [`Self::time_of`]) and decibels, which need not be whole.
    pub fn excess_of(&self, size_bytes: f64, ms: f64, psnr_db: f64) -> f64 {
        let over = |limit: Option<f64>, value: f64| limit.map(|limit| (value / limit).ln());
        let size = over(self.size_bytes.map(|b| b as f64), size_bytes);
        let time = over(self.time_ms, ms);
        let psnr =
            self.psnr_db.filter(|_| !psnr_db.is_nan()).map(|least| (least - psnr_db) * std::f64::consts::LN_10 / 20.0);
        [size, time, psnr].into_iter().flatten().fold(f64::NEG_INFINITY, f64::max)
    }

    /// True if the step keeps all of them; a quality that was not measured (NaN) breaks none.
    pub fn are_kept(&self, cost: &Cost, psnr_db: f64) -> bool {
        self.excess(cost, psnr_db) <= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn excess_is_the_worst_factor() {
        let limits = Limits { size_bytes: Some(100), psnr_db: Some(20.0), ..Limits::default() };
        let cost = |size_bytes| Cost { size_bytes, ..Cost::default() };
        assert!((limits.excess(&cost(200), 0.0) - 10_f64.ln()).abs() < 1e-12, "20 dB short");
        assert!((limits.excess(&cost(200), f64::NAN) - 2_f64.ln()).abs() < 1e-12);
        assert!(limits.are_kept(&cost(100), 20.0) && !limits.are_kept(&cost(101), 20.0));
        assert!(limits.are_kept(&cost(1), f64::INFINITY) && !limits.are_kept(&cost(1), 19.99));
        assert_eq!(Limits::default().excess(&cost(7), 1.0), f64::NEG_INFINITY);
        let time = |with_encoding| Limits { time_ms: Some(40.0), with_encoding, ..Limits::default() };
        let ms = Duration::from_millis;
        let cost = Cost { generation: ms(30), encode: ms(20), ..Cost::default() };
        assert!(time(false).are_kept(&cost, f64::NAN) && !time(true).are_kept(&cost, f64::NAN));
    }
}
