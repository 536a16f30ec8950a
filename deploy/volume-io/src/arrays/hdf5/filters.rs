//! Filters of HDF5 that others registered, beside those of the library itself.
//!
//! <https://github.com/HDFGroup/hdf5_plugins/blob/master/docs/RegisteredFilterPlugins.md>

use crate::{blosc, lzf, unpack};
use hdf5_reader::error::Error;
use hdf5_reader::filters::FilterRegistry;
use hdf5_reader::messages::filter_pipeline::FilterDescription;

/// h5py's default for fast packing.
const LZF: u16 = 32_000;
const BLOSC: u16 = 32_001;
const LZ4: u16 = 32_004;
const ZSTANDARD: u16 = 32_015;

/// A chunk that unpacks to more is no honest one; `hdf5-reader` holds it against its own size afterwards.
const MOST_BYTES: usize = 1 << 30;

/// All filters that are understood.
pub(super) fn registry() -> FilterRegistry {
    let mut registry = FilterRegistry::new();
    // Of LZF and Zstandard the third value is the chunk's size in bytes; of Zstandard a frame states it as well.
    registry.register(LZF, Box::new(|of, bytes, _| said(lzf::unpacked(bytes, chunk_bytes(of, 2)))));
    registry.register(BLOSC, Box::new(|_, bytes, _| said(blosc::unpacked(bytes, MOST_BYTES))));
    registry.register(LZ4, Box::new(|_, bytes, _| said(lz4_blocks(bytes))));
    registry.register(ZSTANDARD, Box::new(|_, bytes, _| said(unpack::unpacked_zstandard(bytes, MOST_BYTES))));
    registry
}

fn said(result: Result<Vec<u8>, String>) -> Result<Vec<u8>, Error> {
    result.map_err(Error::DecompressionError)
}

fn chunk_bytes(of: &FilterDescription, n: usize) -> usize {
    of.client_data.get(n).map_or(0, |&bytes| bytes as usize).min(MOST_BYTES)
}

/// The frame of HDF5's LZ4 filter: the whole size (8 bytes), that of a block (4), then each block after its packed size (4), all with
/// the most significant byte first. A block that did not become smaller is stored as it is.
fn lz4_blocks(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let early = || String::from("an LZ4 chunk ends too early");
    let (whole, rest) = bytes.split_first_chunk::<8>().ok_or_else(early)?;
    let (block, mut rest) = rest.split_first_chunk::<4>().ok_or_else(early)?;
    let whole = usize::try_from(u64::from_be_bytes(*whole)).unwrap_or(usize::MAX);
    let block = u32::from_be_bytes(*block) as usize;
    if whole > MOST_BYTES || (block == 0 && whole > 0) {
        return Err(format!("an LZ4 chunk of {whole} bytes in blocks of {block}"));
    }
    let mut unpacked = Vec::new();
    while unpacked.len() < whole {
        let wanted = block.min(whole - unpacked.len());
        let (packed, after) = rest.split_first_chunk::<4>().ok_or_else(early)?;
        let packed = u32::from_be_bytes(*packed) as usize;
        let (data, after) = after.split_at_checked(packed).ok_or_else(early)?;
        if packed == wanted {
            unpacked.extend_from_slice(data);
        } else {
            unpacked.extend(unpack::unpacked_lz4(data, wanted)?);
        }
        rest = after;
    }
    Ok(unpacked)
}
