//! Stands in for a device in builds without the feature `gpu`: none can be opened, and what needs one has no code.

use super::{AdapterFacts, Choice, DeviceError};

/// A GPU that cannot exist.
#[derive(Debug, Clone, Copy)]
pub enum Gpu {}

/// The outcome of [`Gpu::open`].
#[derive(Debug)]
pub enum Opened {
    /// A GPU.
    Gpu(Box<Gpu>),
    /// The processor, with the reason for the log.
    Cpu(String),
}

impl Gpu {
    /// The processor.
    ///
    /// # Errors
    /// If [`Choice::Gpu`] asks for a GPU.
    pub fn open(choice: Choice) -> Result<Opened, DeviceError> {
        let reason = "this build has none; build with the feature \"gpu\"";
        match choice {
            Choice::Gpu => Err(DeviceError::NoAdapter(reason.to_owned())),
            Choice::Cpu => Ok(Opened::Cpu("asked for".to_owned())),
            Choice::Auto => Ok(Opened::Cpu(reason.to_owned())),
        }
    }

    /// The driver's description of the device.
    pub fn facts(&self) -> &AdapterFacts {
        match *self {}
    }
}

/// None.
pub fn adapter() -> Option<AdapterFacts> {
    None
}
