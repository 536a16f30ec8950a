//! What packed bytes unpack to, and no more than they may: LZ4, zlib, Zstandard, and any other by its reader.

use std::io::Read;

/// What an LZ4 block unpacks to, at most `size` bytes.
pub(crate) fn unpacked_lz4(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    lz4_flex::block::decompress(packed, size).map_err(|e| format!("LZ4: {e}"))
}

/// What a zlib stream unpacks to, at most `most` bytes.
pub(crate) fn unpacked_zlib(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    read_at_most(flate2::read::ZlibDecoder::new(packed), most, "zlib")
}

/// What a Zstandard frame unpacks to, at most `most` bytes.
pub(crate) fn unpacked_zstandard(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    read_at_most(zstd::Decoder::new(packed).map_err(|e| format!("Zstandard: {e}"))?, most, "Zstandard")
}

/// All that `reader` gives, which must be no more than `most` bytes.
pub(crate) fn read_at_most(reader: impl Read, most: usize, format: &str) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    reader.take(most as u64 + 1).read_to_end(&mut out).map_err(|e| format!("{format}: {e}"))?;
    if out.len() > most {
        return Err(format!("a {format} stream unpacks to more than {most} bytes, which is all that it may hold"));
    }
    Ok(out)
}
