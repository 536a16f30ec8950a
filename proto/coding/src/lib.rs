//! Entropy coding, by decisions whose probabilities are learnt on the way: of reduced volumes, error-bounded, and of the rays
//! of a Volumetric Depth Image, exact.
mod coder;
mod mix;
pub mod rays;
pub mod volume;

/// Why bytes cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The sizes do not fit this machine.
    #[error("what they stand for does not fit into memory")]
    Sizes,
    /// The bytes are not as many as they say.
    #[error("the coded bytes are not as many as they should be")]
    Short,
    /// A number is not finite or out of its range.
    #[error("the coded bytes hold an impossible value")]
    Value,
}
