//! What a driver says of a device.

/// A GPU as its driver describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterFacts {
    /// The device's name.
    pub name: String,
    /// `IntegratedGpu`, `DiscreteGpu`, `Cpu` (a software device), ...
    pub kind: String,
    /// The driver and its version.
    pub driver: String,
    /// True if the driver runs on the processor.
    pub software: bool,
}
