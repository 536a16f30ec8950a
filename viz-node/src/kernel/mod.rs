//! I: pure functions from a VDI and a camera to colours.
//!
//! One algorithm at three levels: [`scalar`] is the oracle, `cpu` what runs on the processor, `gpu` its twin in WGSL.
//! [`Backend`] is what the rest of the node calls.

mod backend;
mod cpu;
pub mod gpu;
mod quality;
pub mod scalar;

pub use backend::Backend;
pub use cpu::{PreparedVdi, render};
pub use lamina_lanes::Level;
pub use quality::quality;
