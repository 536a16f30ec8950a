//! Byte compressors. Every block is compressed on its own, so that all cores take part and a reader knows the decompressed
//! size in advance; a block that yields more or fewer bytes is refused.

use super::options::Codec;
use crate::error::CodecError;
use std::io::{self, Read, Write};

/// Uncompressed bytes of every block but the last of a section. bzip2 at level 9 sorts 899,981 bytes at once: blocks of
/// this size fill its block and never spill a few bytes into a second.
pub(super) const BLOCK_BYTES: usize = 899_900;

/// zstd's default level, of 1 to 22; level 9 takes four times as long for 7 to 13 percent less.
#[cfg(not(target_arch = "wasm32"))]
const ZSTD_LEVEL: i32 = 3;

/// A general-purpose compressor.
#[derive(Debug, Clone, Copy)]
pub(super) enum ByteCompressor {
    Bzip2,
    Zstd,
}

impl ByteCompressor {
    /// The compressor of `codec`; `None` for a codec that does not work on bytes.
    pub(super) fn of(codec: Codec) -> Option<Self> {
        match codec {
            Codec::Bzip2 => Some(Self::Bzip2),
            Codec::Zstd => Some(Self::Zstd),
            Codec::ContextMixing => None,
        }
    }
}

pub(super) fn compress(codec: ByteCompressor, block: &[u8]) -> Result<Vec<u8>, CodecError> {
    match codec {
        ByteCompressor::Bzip2 => bzip2_block(block),
        ByteCompressor::Zstd => zstd_block(block),
    }
    .map_err(CodecError::Compress)
}

#[cfg(not(target_arch = "wasm32"))]
fn zstd_block(block: &[u8]) -> io::Result<Vec<u8>> {
    zstd::bulk::compress(block, ZSTD_LEVEL)
}

/// Browsers decode only.
#[cfg(target_arch = "wasm32")]
fn zstd_block(_: &[u8]) -> io::Result<Vec<u8>> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "zstd is not compressed here; choose another codec"))
}

/// Fills `raw` from `packed`; true if that is all it holds.
#[cfg(not(target_arch = "wasm32"))]
fn unpack_zstd(packed: &[u8], raw: &mut [u8]) -> io::Result<bool> {
    Ok(zstd::bulk::decompress_to_buffer(packed, raw)? == raw.len())
}

/// Fills `raw` from `packed`; true if that is all it holds.
#[cfg(target_arch = "wasm32")]
fn unpack_zstd(mut packed: &[u8], raw: &mut [u8]) -> io::Result<bool> {
    let mut decoder = ruzstd::decoding::StreamingDecoder::new(&mut packed).map_err(io::Error::other)?;
    decoder.read_exact(raw)?;
    Ok(decoder.read(&mut [0])? == 0 && packed.is_empty())
}

fn bzip2_block(block: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    encoder.write_all(block)?;
    encoder.finish()
}

/// Decompresses `packed` into `raw`, which it must fill exactly.
pub(super) fn decompress(codec: ByteCompressor, packed: &[u8], raw: &mut [u8]) -> io::Result<()> {
    let whole = match codec {
        ByteCompressor::Bzip2 => {
            let mut decoder = bzip2::bufread::BzDecoder::new(packed);
            decoder.read_exact(raw)?;
            // One more read verifies the end mark of the stream and that nothing is left on either side.
            decoder.read(&mut [0])? == 0 && decoder.into_inner().is_empty()
        }
        ByteCompressor::Zstd => unpack_zstd(packed, raw)?,
    };
    if whole { Ok(()) } else { Err(io::Error::new(io::ErrorKind::InvalidData, "it holds another number of bytes")) }
}
