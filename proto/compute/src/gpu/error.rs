//! Errors of GPU work, told apart by what the caller can do about them.

/// A device that cannot be opened or has failed. The work gave no result; the processor can still do it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// The machine has no GPU.
    #[error("no GPU: {0}; install a Vulkan driver (mesa-vulkan-drivers has one in software), or choose \"cpu\"")]
    NoAdapter(String),
    /// The driver refuses to open the device.
    #[error("{adapter} does not open: {reason}")]
    Refused {
        /// Name of the device.
        adapter: String,
        /// Message of the driver.
        reason: String,
    },
    /// The device is gone for good: unplugged, reset by its watchdog, or crashed.
    #[error("the GPU was lost: {0}")]
    Lost(String),
    /// The device's memory is used up; smaller work may fit.
    #[error("the GPU is out of memory in {0}")]
    OutOfMemory(String),
    /// The device refused a command: a bug here or in its driver.
    #[error("the GPU refused {doing}: {reason}")]
    Fault {
        /// The work in progress.
        doing: String,
        /// The rule that the command breaks.
        reason: String,
    },
}

/// Why a kernel gave no result. `R` is the error of a request that is impossible on any device; in all other cases the
/// processor can do the work instead.
#[derive(Debug, thiserror::Error)]
pub enum KernelError<R: std::error::Error + 'static> {
    /// The data exceeds a limit of the device.
    #[error("{what} needs {needed} {unit}, and this GPU takes {limit}; {remedy}, or run on the processor")]
    TooLarge {
        /// The data that does not fit.
        what: &'static str,
        /// Amount needed, in `unit`s.
        needed: u64,
        /// Largest amount possible, in `unit`s.
        limit: u64,
        /// Unit of both amounts, in the plural.
        unit: &'static str,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// The device failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The request is impossible on any device.
    #[error(transparent)]
    Invalid(R),
    /// Two passes of one kernel did not agree.
    #[error("the GPU counted and wrote different supersegments on {0} rays; run on the processor")]
    Inconsistent(u32),
}
