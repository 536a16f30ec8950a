//! Error-bounded codec for 3-D scalar volumes: every decoded voxel is within a bound of its value or, where the transfer
//! function does not show it, within an interval that stays invisible.
//!
//! Each lattice of halving stride is predicted from the coarser one, as in SZ3 (X. Liang et al., "SZ3: A Modular Framework
//! for Composing Prediction-Based Error-Bounded Lossy Compressors", IEEE Trans. Big Data 9(2), 2023) and QoZ (J. Liu et al.,
//! "Dynamic Quality Metric Oriented Error Bounded Lossy Compression", SC 2022). Prediction weights are fitted to the volume,
//! and residuals are coded by context mixing of the residuals around them.
//!
//! Where only the mean square error has to be that of such a coding ([`ErrorMeasure::MeanSquare`]), each band is coded by
//! wavelet coefficients (`wavelet`) instead if these take fewer bytes, as on fields with noise and without sharp edges.
mod bands;
mod block_flags;
pub(crate) mod container;
mod decode;
mod encode;
mod free_intervals;
mod grid;
mod mask;
mod mixer;
mod motion;
mod multigrid;
mod native_steps;
mod predict;
mod quantize;
mod reference;
mod regression;
mod settings;
mod symbols;
mod temporal;
mod wavelet;

#[cfg(test)]
mod tests;

pub use container::{coded_after, decode, decode_after, encode, encode_after};
pub use reference::{ReferenceVolume, checksum};

/// What a reduced volume's error bound limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ErrorMeasure {
    /// The error of each value.
    #[default]
    Maximum,
    /// The mean square error, which is at most what it is where each value keeps the bound. Single values may be off by more.
    MeanSquare,
    /// The error of each value, also of those that the transfer function hides, which are otherwise free.
    Everywhere,
}

/// How exactly the values of a band come back.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Tolerance {
    /// Each within this bound, above 0, in units of the values.
    Bound(f32),
    /// All are integers, and come back as they are.
    Integers,
}

impl Tolerance {
    /// The largest error that a quantizer may make.
    fn bound(self) -> f32 {
        match self {
            Self::Bound(bound) => bound,
            Self::Integers => 0.5,
        }
    }
}

/// Bytes of a band before the range coder: least and largest value, then the first one or the quantizer step of wavelets, each a
/// little-endian `f32`.
const HEADER: usize = 12;
/// The quantizer step of a level is twice the bound times a multiple of 1 / this.
const STEP_PARTS: f32 = 64.0;
/// The bias of a level is its step times a multiple of 1 / this.
const BIAS_PARTS: f32 = 64.0;
/// Bits of the step's multiple less one, and of the bias's multiple.
const STEP_BITS: u32 = 6;
const BIAS_BITS: u32 = 5;

/// Quantizer step and bias of a level.
fn step_and_bias(bound: f32, step_parts: u32, bias_parts: u32) -> (f32, f32) {
    let step = 2.0 * bound * (step_parts as f32 / STEP_PARTS);
    (step, step * (bias_parts as f32 / BIAS_PARTS))
}
