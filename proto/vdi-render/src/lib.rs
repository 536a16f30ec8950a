//! I: pure functions from a VDI, or a reduced volume, and a camera to colours.
//!
//! One algorithm at three levels: [`reference`] is the oracle, `simd` what runs on the processor, `gpu` its twin in WGSL.
//! All draw the nearest rays of a VDI, its image displaced or not; [`Detail`] says whether several such pictures are blended.
//! A reduced volume is cast by the kernels of `lamina_raycast`. [`Backend`] is what programs call.

mod backend;
mod drawable;
pub mod gpu;
mod psnr;
mod reconstruction;
pub mod reference;
mod simd;

pub use backend::Backend;
pub use drawable::Prepared;
pub use lamina_compute::simd::Level;
pub use psnr::QualityEstimate;
pub use reconstruction::{Detail, Displacement};
pub use simd::{PreparedVdi, render};
