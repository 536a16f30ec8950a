//! The parts of the GPU level, each against Rust; whole pictures and VDIs are compared in generator-node/tests/gpu.rs.

mod layout;
mod leaf;
mod scan;

use super::pipelines::Pipelines;
use lamina_device::{Choice, DeviceError, Gpu, Opened};

/// Any device and its kernels; `None`, said aloud, where there is none, unless REQUIRE_GPU=1.
fn open() -> Option<(Gpu, Pipelines)> {
    match Gpu::open(Choice::Gpu) {
        Ok(Opened::Gpu(gpu)) => {
            let pipelines = gpu.run("compiling", || Ok::<_, DeviceError>(Pipelines::new(&gpu))).unwrap();
            Some((*gpu, pipelines))
        }
        Ok(Opened::Cpu(reason)) => panic!("asked for a GPU, got the processor: {reason}"),
        Err(e) if std::env::var_os("REQUIRE_GPU").is_some_and(|v| v == "1") => panic!("REQUIRE_GPU=1, and {e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    }
}
