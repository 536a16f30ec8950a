//! Binary arithmetic coding with adaptive probabilities: what both the VDI and the volume coder are made of.

pub mod logistic;
pub mod range_coder;

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
