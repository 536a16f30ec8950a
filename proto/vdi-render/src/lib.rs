//! Rendering of Volumetric Depth Images and reduced volumes from any camera.
//!
//! One algorithm at three levels: [`mod@reference`] is the oracle in double precision, `simd` renders on the processor, `gpu` is
//! its counterpart in WGSL. Each renders a VDI by its nearest rays, or by a combination of displaced ones ([`Detail`]). Reduced volumes are ray-cast by `lamina_raycast`. Programs call [`Backend`].
#![cfg_attr(
    not(feature = "gpu"),
    allow(dead_code, unused_imports, reason = "the kernels on a GPU alone read some of it")
)]

mod backend;
mod drawable;
#[cfg(feature = "gpu")]
pub mod gpu;
mod gpu_renderer;
pub mod kernel;
mod psnr;
mod reconstruction;
pub mod reference;
mod simd;

pub use backend::{Backend, Kernels};
pub use drawable::Drawable;
pub use gpu_renderer::GpuError;
pub use lamina_compute::simd::Level;
pub use psnr::QualityEstimate;
pub use reconstruction::{Detail, Displacement};
pub use simd::{PreparedVdi, render};
