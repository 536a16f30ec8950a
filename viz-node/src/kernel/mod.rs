//! I: pure functions from a VDI and a camera to colours.

mod cpu;
mod quality;
pub mod scalar;

pub use cpu::{PreparedVdi, render};
pub use quality::quality;
