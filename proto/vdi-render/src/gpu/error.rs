//! Why a kernel gave nothing. The processor can always do the work instead.

use lamina_compute::gpu::DeviceError;
use lamina_model::Invalid;

/// No result.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The device cannot hold it.
    #[error("{what} needs {needed} {unit}, and this GPU takes {limit}; {remedy}, or run on the processor")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// How much it needs.
        needed: u64,
        /// The most there is.
        limit: u64,
        /// Of what.
        unit: &'static str,
        /// What would help.
        remedy: &'static str,
    },
    /// The device failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// What was asked for is impossible on any device.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}
