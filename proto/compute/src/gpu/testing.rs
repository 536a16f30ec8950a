//! The device that tests run on.

use super::{Choice, Gpu, Opened};

/// Any device, hardware or software. `None`, with a line on standard output, if there is none.
///
/// # Panics
/// If there is none and REQUIRE_GPU=1 is set.
pub fn gpu() -> Option<Gpu> {
    match Gpu::open(Choice::Gpu) {
        Ok(Opened::Gpu(gpu)) => Some(*gpu),
        Ok(Opened::Cpu(reason)) => panic!("asked for a GPU, got the processor: {reason}"),
        Err(e) if std::env::var_os("REQUIRE_GPU").is_some_and(|v| v == "1") => panic!("REQUIRE_GPU=1, and {e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    }
}
