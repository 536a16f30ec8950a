//! I: pure functions from a VDI, or a reduced volume, and a camera to colours.
//!
//! One algorithm at three levels: [`scalar`] is the oracle, `cpu` what runs on the processor, `gpu` its twin in WGSL.
//! All draw the nearest rays of a VDI, its image displaced or not; [`Detail`] says whether several such pictures are blended.
//! A reduced volume is cast by the kernels of `lamina_cast`. [`Backend`] is what the rest of the node calls.

mod backend;
mod blend;
mod cpu;
pub mod gpu;
mod prepared;
mod quality;
pub mod scalar;

pub use backend::Backend;
pub use blend::{Detail, Displacement};
pub use cpu::{PreparedVdi, render};
pub use lamina_lanes::Level;
pub use prepared::Prepared;
pub use quality::QualityEstimate;
