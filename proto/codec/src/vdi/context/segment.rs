//! A supersegment as the entropy coder takes it.

/// A supersegment with its quantized color and opacity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::vdi) struct QuantizedSegment {
    /// First step inside.
    pub start: u32,
    /// First step beyond.
    pub end: u32,
    /// Red, green, blue, opacity.
    pub code: [u8; 4],
}
