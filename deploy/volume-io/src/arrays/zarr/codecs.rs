//! The codecs of a chunk, undone from the last to the first.

use crate::scalars::ByteOrder;
use crate::{blosc, unpack};

/// Codecs in the order in which they were applied.
#[derive(Debug, Clone)]
pub(super) struct CodecChain(pub(super) Vec<ChunkCodec>);

/// One codec.
#[derive(Debug, Clone)]
pub(super) enum ChunkCodec {
    /// The axes in another order: the first is the stored chunk's slowest.
    Transpose(Vec<usize>),
    /// Numbers as bytes.
    Bytes(ByteOrder),
    Blosc,
    Zlib,
    Gzip,
    Zstandard,
    /// After the size, 4 bytes.
    Lz4,
    /// The bytes of values of this width apart.
    Shuffle(usize),
    /// A CRC of 4 bytes before or after.
    LeadingChecksum,
    TrailingChecksum,
    /// Chunks within the chunk, which an index finds.
    Shards {
        chunk: Vec<usize>,
        codecs: CodecChain,
        index: CodecChain,
        at_start: bool,
    },
}

impl CodecChain {
    /// Order of the bytes of numbers.
    pub(super) fn order(&self) -> ByteOrder {
        self.0
            .iter()
            .find_map(|step| if let ChunkCodec::Bytes(order) = step { Some(*order) } else { None })
            .unwrap_or(ByteOrder::Little)
    }

    /// The axes as they are stored, the slowest first: numbers of axes of the array.
    pub(super) fn stored_axes(&self, axes: usize) -> Vec<usize> {
        let mut stored: Vec<usize> = (0..axes).collect();
        for step in &self.0 {
            if let ChunkCodec::Transpose(order) = step {
                stored = order.iter().map(|&n| stored[n]).collect();
            }
        }
        stored
    }

    /// The bytes of `size` that `packed` stands for.
    pub(super) fn unpacked(&self, packed: Vec<u8>, size: usize) -> Result<Vec<u8>, String> {
        let mut bytes = packed;
        for (n, step) in self.0.iter().enumerate().rev() {
            // What stays to be undone may add its checksum.
            let most = size + 4 * n;
            bytes = match step {
                ChunkCodec::Transpose(_) | ChunkCodec::Bytes(_) | ChunkCodec::Shards { .. } => bytes,
                ChunkCodec::Blosc => blosc::unpacked(&bytes, most)?,
                ChunkCodec::Zlib => unpack::unpacked_zlib(&bytes, most)?,
                ChunkCodec::Gzip => unpack::read_at_most(flate2::read::MultiGzDecoder::new(&bytes[..]), most, "gzip")?,
                ChunkCodec::Zstandard => unpack::unpacked_zstandard(&bytes, most)?,
                ChunkCodec::Lz4 => match bytes.split_first_chunk::<4>() {
                    Some((stated, rest)) => unpack::unpacked_lz4(rest, most.min(u32::from_le_bytes(*stated) as usize))?,
                    None => return Err("an LZ4 chunk ends too early".into()),
                },
                ChunkCodec::Shuffle(width) => blosc::bytes_together(&bytes, *width),
                ChunkCodec::LeadingChecksum => {
                    bytes.get(4..).map(<[u8]>::to_vec).ok_or("a chunk shorter than its checksum")?
                }
                ChunkCodec::TrailingChecksum => {
                    let (data, stated) = bytes.split_last_chunk::<4>().ok_or("a chunk shorter than its checksum")?;
                    if crc32c(data) != u32::from_le_bytes(*stated) {
                        return Err("a chunk whose CRC-32C is wrong".into());
                    }
                    data.to_vec()
                }
            };
        }
        Ok(bytes)
    }
}

/// The CRC of Castagnoli's polynomial, bit by bit: only the index of a shard and small chunks carry one.
fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut n = 0;
        while n < 256 {
            let (mut value, mut bit) = (n as u32, 0);
            while bit < 8 {
                value = value >> 1 ^ if value & 1 != 0 { 0x82F6_3B78 } else { 0 };
                bit += 1;
            }
            table[n] = value;
            n += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |crc, &byte| crc >> 8 ^ TABLE[((crc ^ u32::from(byte)) & 255) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_rfc_3720() {
        // RFC 3720, appendix B.4.
        assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
        assert_eq!(crc32c(&[0xFF; 32]), 0x62A8_AB43);
        assert_eq!(crc32c(&(0..32).collect::<Vec<u8>>()), 0x46DD_794E);
    }
}
