//! GPU access: choice of an adapter, buffers, pipelines, timed passes, read-back; every failure is an error value. No other
//! crate depends on `wgpu`: kernels bring their WGSL and take the `wgpu` types from here. Knows no volumes and no VDIs.
//! Without the feature `gpu` there is no device and no `wgpu`: [`Gpu`] has no values.

#[cfg(not(feature = "gpu"))]
mod absent;
#[cfg(feature = "gpu")]
mod adapter;
mod choice;
#[cfg(feature = "gpu")]
mod color_pass;
#[cfg(feature = "gpu")]
mod device;
mod error;
mod facts;
#[cfg(feature = "gpu")]
pub mod layout;
#[cfg(feature = "gpu")]
pub mod pipeline;
#[cfg(feature = "gpu")]
mod submit;
#[cfg(feature = "gpu")]
pub mod testing;

#[cfg(not(feature = "gpu"))]
pub use absent::{Gpu, Opened, adapter};
#[cfg(feature = "gpu")]
pub use adapter::adapter;
pub use choice::Choice;
#[cfg(feature = "gpu")]
pub use color_pass::ColorPass;
#[cfg(feature = "gpu")]
pub use device::{Gpu, Opened};
pub use error::{DeviceError, KernelError};
pub use facts::AdapterFacts;
#[cfg(feature = "gpu")]
#[cfg(feature = "gpu")]
pub use wgpu;
