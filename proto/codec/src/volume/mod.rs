//! An error-bounded codec for 3-D scalar volumes: every decoded voxel is within a bound of its value, or, where the
//! volume is not shown, inside an interval in which it stays so.
//!
//! Lattices of halving stride are predicted from the ones before, as in SZ3 (X. Liang et al., "SZ3: A Modular
//! Framework for Composing Prediction-Based Error-Bounded Lossy Compressors", IEEE Trans. Big Data 9(2), 2023) and
//! QoZ (J. Liu et al., "Dynamic Quality Metric Oriented Error Bounded Lossy Compression", SC 2022); the weights of the
//! prediction are fitted to the volume, and the residuals are coded in the context of those around them.
mod bands;
pub(crate) mod container;
mod decode;
mod encode;
mod flags;
mod grid;
mod hidden;
mod mixer;
mod multigrid;
mod predict;
mod quantize;
mod regression;
mod settings;
mod symbols;

#[cfg(test)]
mod tests;

pub use container::{decode, encode};

/// Bytes before the decisions: least value, largest value, first value, each `f32` with the low byte first.
const HEADER: usize = 12;
/// The step of a level is twice the bound times a whole number of these parts.
const STEP_PARTS: f32 = 64.0;
/// The bias of a level is its step times a whole number of these parts.
const BIAS_PARTS: f32 = 64.0;
/// Bits of the number of parts of a step less one, and of a bias.
const STEP_BITS: u32 = 6;
const BIAS_BITS: u32 = 5;

/// Distance of reconstruction points and their bias.
fn step_and_bias(bound: f32, step_parts: u32, bias_parts: u32) -> (f32, f32) {
    let step = 2.0 * bound * (step_parts as f32 / STEP_PARTS);
    (step, step * (bias_parts as f32 / BIAS_PARTS))
}
