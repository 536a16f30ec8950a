//! The outcome of opening a device.

use super::Gpu;

/// The outcome of [`Gpu::open`].
#[derive(Debug)]
pub enum Opened {
    /// A GPU.
    Gpu(Box<Gpu>),
    /// The processor, with the reason for the log.
    Cpu(String),
}
