//! Error of the kernels.

use lamina_compute::gpu::KernelError;
use lamina_model::Invalid;

/// Why a kernel gave no result. The processor can always do the work instead.
pub type GpuError = KernelError<Invalid>;
