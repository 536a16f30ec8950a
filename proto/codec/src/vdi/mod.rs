//! The VDI codec: a versioned header, rays by [`context`], or depth and colour columns by a byte compressor, a checksum.
//!
//! `proto/formats/vdi.md` is the format's definition, byte by byte; `read_vdi.py` of the test suites
//! is written from that page alone and compared with this module. Depths come back exactly; colours and opacities are
//! rounded once, to 8 bits or fewer as gamma allows ([`quantize`]), and encoding what was decoded gives the same bytes.
//!
//! [`decode`] takes bytes from anyone: every claim is checked against the limits and the other claims before memory is
//! set aside for it, and no block decompresses to more than its section says.

mod columns;
mod compress;
mod context;
mod header;
mod plain;
mod quantize;
mod rays;
mod sections;

pub use quantize::quantize;

use crate::envelope::{CRC_BYTES, checked_body, take_version, too_short};
use crate::error::{self, CodecError};
use crate::limits::DecodeLimits;
use compress::Bytewise;
use header::Contents;
use lamina_model::{Invalid, Supersegment, Vdi, VdiHeader};

/// First bytes of every file.
const MAGIC: [u8; 4] = *b"LVDI";
/// The newest version read.
const NEWEST: u16 = 3;
/// Magic, version, and the header's length.
const PREAMBLE_BYTES: usize = 8;

/// What makes it small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Codec {
    /// What the paper's sizes are compared with. Level 9.
    Bzip2,
    /// Many times faster and larger. Level 3.
    Zstd,
    /// Smallest: each ray in the context of those beside it ([`context`]), not as bytes.
    #[default]
    Mixed,
}

impl Codec {
    fn id(self) -> u8 {
        match self {
            Self::Bzip2 => 0,
            Self::Zstd => 1,
            Self::Mixed => 2,
        }
    }

    /// The version of the format that it came with.
    fn version(self) -> u16 {
        match self {
            Self::Bzip2 | Self::Zstd => 1,
            Self::Mixed => 3,
        }
    }

    fn from_id(id: u8) -> Option<Self> {
        [Self::Bzip2, Self::Zstd, Self::Mixed].into_iter().find(|c| c.id() == id)
    }
}

/// How supersegments are laid out before compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layout {
    /// Depths as integer differences in byte planes; opacity on a scale that suits both ends.
    #[default]
    Columns,
    /// The paper's: records of two float depths and RGBA, for comparison. Opacity on a linear scale.
    Plain,
}

impl Layout {
    fn id(self) -> u8 {
        match self {
            Self::Columns => 0,
            Self::Plain => 1,
        }
    }

    fn from_id(id: u8) -> Option<Self> {
        [Self::Columns, Self::Plain].into_iter().find(|l| l.id() == id)
    }
}

/// What an encoder may choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncodeOptions {
    /// What makes it small.
    pub codec: Codec,
    /// What is compressed; [`Codec::Mixed`] knows [`Layout::Columns`] only.
    pub layout: Layout,
}

impl EncodeOptions {
    /// What the paper's sizes are compared with: columns by bzip2.
    pub const BZIP2: Self = Self { codec: Codec::Bzip2, layout: Layout::Columns };

    /// The same, if they go together.
    ///
    /// # Errors
    /// Names what does not.
    pub fn check(self) -> Result<Self, Invalid> {
        if self.codec == Codec::Mixed && self.layout == Layout::Plain {
            return Err(Invalid::new("codec", "mixed knows no plain layout; give bzip2 or zstd for that"));
        }
        Ok(self)
    }
}

/// What can be told of an encoded VDI without decompressing it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncodedHeader {
    /// Where its rays and depths lie.
    pub header: VdiHeader,
    /// What made it small.
    pub codec: Codec,
    /// What is compressed.
    pub layout: Layout,
    /// Number of supersegments.
    pub segments: u32,
}

/// Encodes a VDI, on all cores. Colours and opacities are rounded as [`quantize`] says, in [`Layout::Plain`] to 8 bits.
///
/// # Errors
/// If the options do not [go together](EncodeOptions::check), or [`Layout::Plain`] is asked for and its 32-bit floats cannot hold the depths, or a compressor fails.
pub fn encode(vdi: &Vdi, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    let EncodeOptions { codec, layout } = options.check()?;
    let segments = vdi.segments().len() as u32;
    let occupied_rays = vdi.offsets().windows(2).filter(|w| w[0] < w[1]).count() as u32;
    let header = EncodedHeader { header: *vdi.header(), codec, layout, segments };
    let head = header::write(&Contents { header, occupied_rays })?;
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(codec.version().to_le_bytes());
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head);
    match (Bytewise::of(codec), layout) {
        (None, _) => bytes.extend(rays::write(vdi)),
        (Some(compressor), Layout::Columns) => sections::write(&columns::write(vdi), compressor, &mut bytes)?,
        (Some(compressor), Layout::Plain) => sections::write(&plain::write(vdi)?, compressor, &mut bytes)?,
    }
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    Ok(bytes)
}

/// Decodes a VDI, on all cores. `bytes` must be one whole encoded VDI and nothing else.
///
/// # Errors
/// If it is no VDI, a newer one, damaged, larger than `limits`, or contradicts itself.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<Vdi, CodecError> {
    let (version, contents, rest) = check(bytes, limits)?;
    let codec = contents.header.codec;
    if version == 2 {
        return Err(error::invalid("it is of version 2, a draft that no release wrote; make it again"));
    }
    if codec.version() != version {
        return Err(error::invalid(format!("version {version} has no codec {}", codec.id())));
    }
    match (Bytewise::of(codec), contents.header.layout) {
        (None, Layout::Columns) => rays::read(rest, &contents),
        (None, Layout::Plain) => Err(error::invalid("codec 2 knows no plain layout")),
        (Some(compressor), Layout::Columns) => {
            columns::read(&sections::read(rest, compressor, &columns::shapes(&contents))?, &contents)
        }
        (Some(compressor), Layout::Plain) => {
            plain::read(&sections::read(rest, compressor, &plain::shapes(&contents))?, &contents)
        }
    }
}

/// Passes bytes whose checksum, version, header and decoded size are right.
///
/// # Errors
/// As [`decode`], but for what only decoding can find.
pub(crate) fn check_whole(bytes: &[u8], limits: &DecodeLimits) -> Result<(), CodecError> {
    check(bytes, limits).map(drop)
}

/// Checks everything but the lists; gives the version, the header, and the bytes of the lists.
fn check<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<(u16, Contents, &'a [u8]), CodecError> {
    let version = take_version(bytes, MAGIC, NEWEST)?;
    let (contents, rest) = read_contents(checked_body(bytes, PREAMBLE_BYTES + CRC_BYTES)?)?;
    check_size(&contents, limits)?;
    Ok((version, contents, rest))
}

/// Reads the header alone; `bytes` may end after it, and the checksum is not looked at.
///
/// # Errors
/// If it is no VDI, a newer one, cut short, or its header contradicts itself.
pub fn peek(bytes: &[u8]) -> Result<EncodedHeader, CodecError> {
    take_version(bytes, MAGIC, NEWEST)?;
    Ok(read_contents(bytes)?.0.header)
}

/// The header and what follows it.
fn read_contents(bytes: &[u8]) -> Result<(Contents, &[u8]), CodecError> {
    let (preamble, rest) = bytes.split_at_checked(PREAMBLE_BYTES).ok_or_else(too_short)?;
    let length = usize::from(u16::from_le_bytes([preamble[6], preamble[7]]));
    if length != header::HEADER_BYTES {
        return Err(error::invalid(format!("its header has {length} bytes, not {}", header::HEADER_BYTES)));
    }
    let (head, rest) = rest.split_at_checked(length).ok_or_else(too_short)?;
    Ok((header::read(head)?, rest))
}

fn check_size(contents: &Contents, limits: &DecodeLimits) -> Result<(), CodecError> {
    let rays = u64::from(contents.header.header.params.resolution()).pow(2);
    let needed_bytes = 4 * (rays + 1) + u64::from(contents.header.segments) * size_of::<Supersegment>() as u64;
    let limit_bytes = limits.max_decoded_bytes;
    if needed_bytes > limit_bytes {
        return Err(CodecError::TooLarge { needed_bytes, limit_bytes });
    }
    Ok(())
}
