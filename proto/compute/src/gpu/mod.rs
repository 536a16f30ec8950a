//! The only crate that opens a GPU device: which adapter, if any; buffers, timed dispatch, read back; every failure an
//! error value. It knows nothing of volumes or VDIs: kernels bring their own WGSL and take the `wgpu` types from here.

mod adapter;
mod choice;
mod device;
mod error;
pub mod layout;
pub mod pipeline;
mod submit;
pub mod testing;

pub use adapter::{AdapterFacts, adapter};
pub use choice::Choice;
pub use device::{Gpu, Opened};
pub use error::DeviceError;
pub use submit::Done;
pub use wgpu;
