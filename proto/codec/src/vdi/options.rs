//! Choices of an encoder: compression method and layout, with their codes in the format.

use crate::volume::ErrorMeasure;
use lamina_model::{Invalid, VdiHeader};

/// Compression method of a VDI.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Codec {
    /// bzip2 at level 9, which published sizes are compared with.
    Bzip2,
    /// zstd at level 3: many times faster than bzip2, larger files.
    Zstd,
    /// The smallest: context mixing of neighboring rays, not of bytes.
    #[default]
    ContextMixing,
}

impl Codec {
    pub(super) fn id(self) -> u8 {
        match self {
            Self::Bzip2 => 0,
            Self::Zstd => 1,
            Self::ContextMixing => 2,
        }
    }

    /// The format version that introduced it.
    pub(super) fn version(self) -> u16 {
        match self {
            Self::Bzip2 | Self::Zstd => 1,
            Self::ContextMixing => 3,
        }
    }

    pub(super) fn from_id(id: u8) -> Option<Self> {
        [Self::Bzip2, Self::Zstd, Self::ContextMixing].into_iter().find(|c| c.id() == id)
    }
}

/// Arrangement of supersegments before compression by a byte compressor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layout {
    /// Depths as integer differences in byte planes; opacity codes that are fine near transparent and near opaque.
    #[default]
    Columns,
    /// The paper's records of two float depths and RGBA, for comparison; opacity codes are linear.
    Plain,
}

impl Layout {
    pub(super) fn id(self) -> u8 {
        match self {
            Self::Columns => 0,
            Self::Plain => 1,
        }
    }

    pub(super) fn from_id(id: u8) -> Option<Self> {
        [Self::Columns, Self::Plain].into_iter().find(|l| l.id() == id)
    }
}

/// Options of an encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncodeOptions {
    /// Compression method.
    pub codec: Codec,
    /// Arrangement; [`Codec::ContextMixing`] takes [`Layout::Columns`] only.
    pub layout: Layout,
    /// What the error bound of reduced volumes limits.
    pub error: ErrorMeasure,
}

impl EncodeOptions {
    /// Columns compressed by bzip2, which published sizes are compared with.
    pub const BZIP2: Self = Self { codec: Codec::Bzip2, layout: Layout::Columns, error: ErrorMeasure::Maximum };

    /// These options, if the codec supports the layout.
    ///
    /// # Errors
    /// If it does not.
    pub fn check(self) -> Result<Self, Invalid> {
        if self.codec == Codec::ContextMixing && self.layout == Layout::Plain {
            return Err(Invalid::new("codec", "context-mixing has no plain layout; give bzip2 or zstd for that"));
        }
        Ok(self)
    }
}

/// What can be read from an encoded VDI without decompressing it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncodedHeader {
    /// Camera, box and step length.
    pub header: VdiHeader,
    /// Compression method.
    pub codec: Codec,
    /// Arrangement of supersegments.
    pub layout: Layout,
    /// Number of supersegments.
    pub segments: u32,
}
