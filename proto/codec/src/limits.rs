//! Limits on what a decoder accepts.

/// Memory limits of a decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodeLimits {
    /// The most memory that decoded content may take, bytes. Decoding temporarily takes up to as much again, and 32 MB a
    /// core.
    pub max_decoded_bytes: u64,
}

impl Default for DecodeLimits {
    /// 1 GiB, about 44 million supersegments.
    fn default() -> Self {
        Self { max_decoded_bytes: 1 << 30 }
    }
}
