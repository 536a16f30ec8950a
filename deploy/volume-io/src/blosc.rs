//! Blosc 1, in which Zarr packs chunks by default: blocks by LZ4, Zstandard or zlib, shuffled before.
//!
//! The format: <https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>.

use crate::unpack::{unpacked_lz4, unpacked_zlib, unpacked_zstandard};

/// Length of the header, bytes.
const HEADER: usize = 16;

/// Bits of the flags.
const BYTE_SHUFFLE: u8 = 1;
const IS_COPY: u8 = 2;
const BIT_SHUFFLE: u8 = 4;
const IS_NOT_SPLIT: u8 = 16;

/// A block smaller than this is not split into the bytes of its values, nor is one of wide values.
const LEAST_SPLIT: usize = 128;
const WIDEST_SPLIT: usize = 16;

/// What packs blocks.
#[derive(Clone, Copy)]
enum Format {
    Lz4,
    Zlib,
    Zstandard,
}

/// What a chunk unpacks to, at most `most` bytes.
pub(crate) fn unpacked(chunk: &[u8], most: usize) -> Result<Vec<u8>, String> {
    let early = || String::from("a Blosc chunk ends too early");
    let header = chunk.get(..HEADER).ok_or_else(early)?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]) as usize;
    let (flags, width) = (header[2], usize::from(header[3]));
    let (size, block, packed) = (number(4), number(8), number(12));
    if header[0] > 2 {
        return Err(format!("a Blosc chunk of format {}, of which 1 and 2 are understood: pack by Blosc 1", header[0]));
    }
    if size > most || packed > chunk.len() || (size > 0 && (block == 0 || width == 0)) {
        return Err(format!("a Blosc chunk of {size} bytes in blocks of {block}, {packed} of {} bytes", chunk.len()));
    }
    if flags & IS_COPY != 0 {
        return Ok(chunk.get(HEADER..HEADER + size).ok_or_else(early)?.to_vec());
    }
    let format = match flags >> 5 {
        1 => Format::Lz4,
        3 => Format::Zlib,
        4 => Format::Zstandard,
        0 => return Err("Blosc chunks packed by BloscLZ are not understood: pack by LZ4 or Zstandard".into()),
        other => return Err(format!("a Blosc chunk packed by format {other}, which is not understood")),
    };
    let mut out = Vec::new();
    for (n, start) in (0..size).step_by(block.max(1)).enumerate() {
        let length = block.min(size - start);
        let at = HEADER + 4 * n;
        let from = chunk.get(at..at + 4).ok_or_else(early)?;
        let from = u32::from_le_bytes([from[0], from[1], from[2], from[3]]) as usize;
        let is_split =
            flags & IS_NOT_SPLIT == 0 && length == block && width <= WIDEST_SPLIT && block / width >= LEAST_SPLIT;
        let streams = if is_split { width } else { 1 };
        let unpacked = block_of(chunk, from, length, streams, format)?;
        out.extend(match () {
            () if flags & BYTE_SHUFFLE != 0 && width > 1 => bytes_together(&unpacked, width),
            () if flags & BIT_SHUFFLE != 0 => bits_together(unpacked, width),
            () => unpacked,
        });
    }
    Ok(out)
}

/// A block: each of its streams after its packed size.
fn block_of(chunk: &[u8], mut at: usize, length: usize, streams: usize, format: Format) -> Result<Vec<u8>, String> {
    let early = || String::from("a Blosc block lies outside of its chunk");
    let each = length / streams;
    let mut out = Vec::with_capacity(length);
    for _ in 0..streams {
        let size = chunk.get(at..).and_then(|rest| rest.first_chunk::<4>()).ok_or_else(early)?;
        let size = u32::from_le_bytes(*size) as usize;
        let packed = chunk.get(at + 4..).and_then(|rest| rest.get(..size)).ok_or_else(early)?;
        at += 4 + size;
        if size == each {
            out.extend_from_slice(packed);
            continue;
        }
        let unpacked = match format {
            Format::Lz4 => unpacked_lz4(packed, each)?,
            Format::Zlib => unpacked_zlib(packed, each)?,
            Format::Zstandard => unpacked_zstandard(packed, each)?,
        };
        if unpacked.len() != each {
            return Err(format!("a Blosc block of {} bytes in place of {each}", unpacked.len()));
        }
        out.extend(unpacked);
    }
    if out.len() == length {
        Ok(out)
    } else {
        Err(format!("a Blosc block of {} bytes in place of {length}", out.len()))
    }
}

/// The bytes of each value beside each other again, of first bytes, second bytes and so on; what is no whole value follows.
pub(crate) fn bytes_together(shuffled: &[u8], width: usize) -> Vec<u8> {
    let count = shuffled.len() / width;
    let mut out = shuffled.to_vec();
    for (n, value) in out.chunks_exact_mut(width).enumerate() {
        value.iter_mut().enumerate().for_each(|(byte, to)| *to = shuffled[byte * count + n]);
    }
    out
}

/// The bits of each value beside each other again: the first bits of all values come first. Blocks whose number of values is no multiple
/// of 8 are stored as they are.
fn bits_together(shuffled: Vec<u8>, width: usize) -> Vec<u8> {
    let values = shuffled.len() / width;
    let groups = if values.is_multiple_of(8) { values / 8 } else { 0 };
    let mut out = shuffled.clone();
    // Rows of bits, one for each bit of a value, of as many bits as there are values.
    out[..groups * 8 * width].fill(0);
    for bit in 0..8 * width {
        for group in 0..groups {
            let of_eight = shuffled[bit * groups + group];
            for value in (0..8).filter(|value| of_eight >> value & 1 != 0) {
                out[(8 * group + value) * width + bit / 8] |= 1 << (bit % 8);
            }
        }
    }
    out
}
