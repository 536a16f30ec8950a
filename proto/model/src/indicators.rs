//! What a measurement of generation parameters yields: the paper's sigma, q and tau.

use std::time::Duration;

/// The three indicators of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indicators {
    /// Bytes of the encoded VDI.
    #[doc(alias = "sigma")]
    pub size_bytes: u64,
    /// PSNR pooled over all test views, decibels; +infinity if identical.
    #[doc(alias = "q")]
    pub psnr_db: f64,
    /// Wall time of generation, without encoding.
    #[doc(alias = "tau")]
    pub generation_time: Duration,
}

/// Measured quality: pooled and per view.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// PSNR of the pooled squared error, decibels.
    pub psnr_db: f64,
    /// (angle about y in degrees, PSNR in decibels) per test view.
    pub views: Vec<(f64, f64)>,
}
