//! What a decoder accepts.

/// How much a decoder accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodeLimits {
    /// The most memory the decoded lists may take, bytes. Decoding itself takes up to as much again for a
    /// moment, and 32 MB a core.
    pub max_decoded_bytes: u64,
}

impl Default for DecodeLimits {
    /// 1 GiB, about 44 million supersegments.
    fn default() -> Self {
        Self { max_decoded_bytes: 1 << 30 }
    }
}
