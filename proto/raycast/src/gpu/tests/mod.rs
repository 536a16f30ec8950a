//! The parts of the GPU level, each against Rust; whole pictures and VDIs are compared in tests/levels.

mod count;
mod layout;
mod leaf;
mod scan;

use super::pipelines::Pipelines;
use lamina_compute::gpu::{DeviceError, Gpu, testing};

/// The tests' device and its kernels.
fn open() -> Option<(Gpu, Pipelines)> {
    let gpu = testing::gpu()?;
    let pipelines = gpu.run("compiling", || Ok::<_, DeviceError>(Pipelines::new(&gpu))).unwrap();
    Some((gpu, pipelines))
}
