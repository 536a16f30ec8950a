//! GPU access: choice of an adapter, buffers, pipelines, timed passes, read-back; every failure is an error value. No other
//! crate depends on `wgpu`: kernels bring their WGSL and take the `wgpu` types from here. Knows no volumes and no VDIs.

mod adapter;
mod choice;
mod color_pass;
mod device;
mod error;
pub mod layout;
pub mod pipeline;
mod submit;
pub mod testing;

pub use adapter::{AdapterFacts, adapter};
pub use choice::Choice;
pub use color_pass::ColorPass;
pub use device::{Gpu, Opened};
pub use error::{DeviceError, KernelError};
pub use submit::PassResult;
pub use wgpu;
