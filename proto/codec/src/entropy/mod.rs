//! Binary arithmetic coding with adaptive probabilities, shared by the VDI codec and the volume codec.

pub(crate) mod logistic;
pub(crate) mod range_coder;

/// Why entropy-coded bytes cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum EntropyError {
    /// The decoded sizes exceed what this machine can address.
    #[error("the decoded sizes exceed the address space")]
    SizeOverflow,
    /// The number of bytes differs from the lengths stated in them.
    #[error("the coded bytes differ in number from their stated lengths")]
    LengthMismatch,
    /// A decoded number is not finite or out of its range.
    #[error("the coded bytes hold an impossible value")]
    InvalidValue,
}
