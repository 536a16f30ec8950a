//! VDI codec: a versioned header, then rays by context mixing ([`context`]) or columns by a byte compressor, then a checksum.
//!
//! `proto/formats/vdi.md` defines the format byte by byte; `tests/read_vdi.py` is written from that page alone and compared
//! with this module. Depths are lossless; colors and opacities are rounded once, to 8 bits or fewer as gamma allows
//! ([`quantize()`]), and encoding a decoded VDI again gives the same bytes.
//!
//! [`decode`] accepts untrusted bytes: every stated size is checked against the limits and the other sizes before memory is
//! allocated for it, and no block decompresses to more than its section states.

mod band;
mod columns;
mod compress;
mod context;
mod header;
mod options;
mod plain;
mod quantize;
mod rays;
mod sections;
mod statistics;

pub use band::VdiBand;
pub use context::{ColorDecoder, GeometryDecoder};
pub use options::{Codec, EncodeOptions, EncodedHeader, Layout};
pub use quantize::quantize;
pub use statistics::BandStatistics;

use crate::envelope::{CRC_BYTES, checked_body, take_version, too_short};
use crate::error::{self, CodecError};
use crate::limits::DecodeLimits;
use compress::ByteCompressor;
use header::Contents;
use lamina_model::{Supersegment, Vdi};

/// First bytes of every encoded VDI.
const MAGIC: [u8; 4] = *b"LVDI";
/// The newest format version that is read.
const NEWEST: u16 = 3;
/// Bytes of magic, version, and header length.
const PREAMBLE_BYTES: usize = 8;

/// Encodes a VDI, on all cores. Colors and opacities are rounded as [`quantize()`] does, under [`Layout::Plain`] to 8 bits.
///
/// # Errors
/// If the codec does not support the layout, a compressor fails, or [`Layout::Plain`] cannot hold the depths in 32-bit floats.
pub fn encode(vdi: &Vdi, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    let EncodeOptions { codec, layout, .. } = options.check()?;
    let segments = vdi.segments().len() as u32;
    let occupied_rays = vdi.offsets().windows(2).filter(|w| w[0] < w[1]).count() as u32;
    let header = EncodedHeader { header: *vdi.header(), codec, layout, segments };
    framed(&Contents { header, occupied_rays }, |bytes| {
        match (ByteCompressor::of(codec), layout) {
            (None, _) => bytes.extend(rays::write(vdi)),
            (Some(compressor), Layout::Columns) => sections::write(&columns::write(vdi), compressor, bytes)?,
            (Some(compressor), Layout::Plain) => sections::write(&plain::write(vdi)?, compressor, bytes)?,
        }
        Ok(())
    })
}

/// The file of a VDI: magic, version and header, the lists that `write` appends, and the checksum.
fn framed(
    contents: &Contents,
    write: impl FnOnce(&mut Vec<u8>) -> Result<(), CodecError>,
) -> Result<Vec<u8>, CodecError> {
    let head = header::write(contents)?;
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(contents.header.codec.version().to_le_bytes());
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head);
    write(&mut bytes)?;
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    Ok(bytes)
}

/// Decodes a VDI, on all cores. `bytes` must be exactly one encoded VDI.
///
/// # Errors
/// If the bytes are not a VDI, of a newer version, damaged, larger than `limits`, or contradict themselves.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<Vdi, CodecError> {
    let (contents, rest) = check(bytes, limits)?;
    match (ByteCompressor::of(contents.header.codec), contents.header.layout) {
        (None, Layout::Columns) => rays::read(rest, &contents),
        (None, Layout::Plain) => Err(error::invalid("codec 2 has no plain layout")),
        (Some(compressor), Layout::Columns) => {
            columns::read(&sections::read(rest, compressor, &columns::shapes(&contents))?, &contents)
        }
        (Some(compressor), Layout::Plain) => {
            plain::read(&sections::read(rest, compressor, &plain::shapes(&contents))?, &contents)
        }
    }
}

/// The number of bytes in which each band of an encoded VDI is coded: what [`GeometryDecoder`] and [`ColorDecoder`] decode apart.
///
/// # Errors
/// As [`decode`], or if it is not coded by context mixing.
pub fn band_sizes(bytes: &[u8], limits: &DecodeLimits) -> Result<Vec<usize>, CodecError> {
    let (contents, rest) = check_mixed(bytes, limits)?;
    rays::coded_bytes(rest, &contents)
}

impl GeometryDecoder {
    /// Of a band of an encoded VDI, counted from 0.
    ///
    /// # Errors
    /// As [`band_sizes`], or if there is no such band.
    pub fn new(bytes: &[u8], band: usize, limits: &DecodeLimits) -> Result<Self, CodecError> {
        let (contents, rest) = check_mixed(bytes, limits)?;
        rays::geometry(rest, &contents, band)
    }
}

impl ColorDecoder {
    /// Of a band of an encoded VDI, counted from 0.
    ///
    /// # Errors
    /// As [`band_sizes`], or if there is no such band.
    pub fn new(bytes: &[u8], band: usize, limits: &DecodeLimits) -> Result<Self, CodecError> {
        let (contents, rest) = check_mixed(bytes, limits)?;
        rays::colors(rest, &contents, band)
    }
}

/// The VDI whose `bands`, in order, were decoded apart.
///
/// # Errors
/// As [`decode`], or if they are not its bands.
pub fn join_bands(bytes: &[u8], bands: &[VdiBand], limits: &DecodeLimits) -> Result<Vdi, CodecError> {
    rays::join(bands, &check_mixed(bytes, limits)?.0)
}

/// Verifies checksum, version, header and decoded size without decoding the lists.
///
/// # Errors
/// As [`decode`], except for those that only decoding can find.
pub(crate) fn check_whole(bytes: &[u8], limits: &DecodeLimits) -> Result<(), CodecError> {
    check(bytes, limits).map(drop)
}

/// Checks everything but the lists. Returns the header, and the bytes of the lists.
fn check<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<(Contents, &'a [u8]), CodecError> {
    let version = take_version(bytes, MAGIC, NEWEST)?;
    let (contents, rest) = read_contents(checked_body(bytes, PREAMBLE_BYTES + CRC_BYTES)?)?;
    check_size(&contents, limits)?;
    let codec = contents.header.codec;
    if version == 2 {
        return Err(error::invalid("it is of version 2, a draft that no release wrote; generate it again"));
    }
    if codec.version() != version {
        return Err(error::invalid(format!("version {version} has no codec {}", codec.id())));
    }
    Ok((contents, rest))
}

/// As [`check`], of a VDI coded by context mixing, in bands.
fn check_mixed<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<(Contents, &'a [u8]), CodecError> {
    let (contents, rest) = check(bytes, limits)?;
    match (contents.header.codec, contents.header.layout) {
        (Codec::ContextMixing, Layout::Columns) => Ok((contents, rest)),
        _ => Err(error::invalid("it is not coded in bands")),
    }
}

/// Reads the header alone; `bytes` may end after it, and the checksum is not verified.
///
/// # Errors
/// If the bytes are not a VDI, of a newer version or cut short, or the header contradicts itself.
pub fn peek(bytes: &[u8]) -> Result<EncodedHeader, CodecError> {
    take_version(bytes, MAGIC, NEWEST)?;
    Ok(read_contents(bytes)?.0.header)
}

/// The header and the bytes behind it.
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
