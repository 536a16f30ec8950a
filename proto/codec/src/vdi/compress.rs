//! The byte compressors. Every block is compressed alone, so that all cores take part and a reader knows, before it
//! decompresses, exactly how many bytes must come out; a block that yields more or fewer is refused.

use super::Codec;
use crate::error::CodecError;
use std::io::{self, Read, Write};

/// Uncompressed bytes of every block but the last of a section. bzip2 at level 9 sorts 899,981 bytes at once: blocks of
/// this size fill its block and never spill a few bytes into a second.
pub(super) const BLOCK_BYTES: usize = 899_900;

/// 1 to 22. Level 3 is zstd's own default; level 9 takes four times as long for 7 to 13 percent less.
const ZSTD_LEVEL: i32 = 3;

/// A codec that takes bytes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Bytewise {
    Bzip2,
    Zstd,
}

impl Bytewise {
    /// `codec`, if it takes bytes.
    pub fn of(codec: Codec) -> Option<Self> {
        match codec {
            Codec::Bzip2 => Some(Self::Bzip2),
            Codec::Zstd => Some(Self::Zstd),
            Codec::Mixed => None,
        }
    }
}

pub(super) fn compress(codec: Bytewise, block: &[u8]) -> Result<Vec<u8>, CodecError> {
    match codec {
        Bytewise::Bzip2 => bzip2_block(block),
        Bytewise::Zstd => zstd::bulk::compress(block, ZSTD_LEVEL),
    }
    .map_err(CodecError::Compress)
}

fn bzip2_block(block: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    encoder.write_all(block)?;
    encoder.finish()
}

/// Fills `raw` from `packed`, which must hold just that many bytes.
pub(super) fn decompress(codec: Bytewise, packed: &[u8], raw: &mut [u8]) -> io::Result<()> {
    let whole = match codec {
        Bytewise::Bzip2 => {
            let mut decoder = bzip2::bufread::BzDecoder::new(packed);
            decoder.read_exact(raw)?;
            // Reading on checks the stream's own end mark, and that nothing is left on either side.
            decoder.read(&mut [0])? == 0 && decoder.into_inner().is_empty()
        }
        Bytewise::Zstd => zstd::bulk::decompress_to_buffer(packed, raw)? == raw.len(),
    };
    if whole { Ok(()) } else { Err(io::Error::new(io::ErrorKind::InvalidData, "it holds another number of bytes")) }
}
