//! What one generation cost.

use std::time::Duration;

/// The cost of turning a time step into a VDI or a reduced volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cost {
    /// Encoded bytes. The paper's sigma.
    pub size_bytes: u64,
    /// Wall time of generation, without encoding; of a volume with its coding, as it loses accuracy there. The paper's tau.
    pub generation: Duration,
    /// Wall time of encoding.
    pub encode: Duration,
    /// Supersegments, or sample points.
    pub elements: u64,
}
