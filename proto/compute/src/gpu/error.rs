//! What can go wrong with a device, by what the caller can do about it.

/// A device that cannot be opened or has failed. Work that met one gave no result; the processor can still do it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// There is none.
    #[error("no GPU: {0}; install a Vulkan driver (mesa-vulkan-drivers has one in software), or choose \"cpu\"")]
    NoAdapter(String),
    /// The driver does not open it.
    #[error("{adapter} does not open: {reason}")]
    Refused {
        /// The device's name.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// It is gone for good: unplugged, reset by its watchdog, or crashed.
    #[error("the GPU was lost: {0}")]
    Lost(String),
    /// Its memory is used up; less at a time may fit.
    #[error("the GPU is out of memory in {0}")]
    OutOfMemory(String),
    /// It was told something impossible: a bug here or in its driver.
    #[error("the GPU refused {doing}: {reason}")]
    Fault {
        /// What was being done.
        doing: String,
        /// Which rule it breaks.
        reason: String,
    },
}
