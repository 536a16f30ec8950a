//! The envelope of both formats: magic bytes and version at the start, CRC-32 at the end.

use crate::error::{self, CodecError};

/// Bytes of the CRC-32 that ends a file.
pub(crate) const CRC_BYTES: usize = 4;

/// The format version of `bytes`, which must begin with `magic` and state a version from 1 to `newest`.
pub(crate) fn take_version(bytes: &[u8], magic: [u8; 4], newest: u16) -> Result<u16, CodecError> {
    let Some(rest) = bytes.strip_prefix(&magic) else {
        return Err(CodecError::NotAVdi);
    };
    match rest {
        [low, high, ..] => match u16::from_le_bytes([*low, *high]) {
            0 => Err(error::invalid("it states format version 0; versions start at 1")),
            found if found > newest => Err(CodecError::NewerVersion { found, newest }),
            version => Ok(version),
        },
        _ => Err(too_short()),
    }
}

/// The content of `bytes` before the CRC-32, which is verified. There must be at least `least` bytes.
pub(crate) fn checked_body(bytes: &[u8], least: usize) -> Result<&[u8], CodecError> {
    let (body, crc) = match bytes.split_last_chunk::<CRC_BYTES>() {
        Some(split) if bytes.len() >= least => split,
        _ => return Err(too_short()),
    };
    let (found, stated) = (crc32fast::hash(body), u32::from_le_bytes(*crc));
    if found != stated {
        return Err(CodecError::Damaged(format!("its checksum is {found:08x} and should be {stated:08x}")));
    }
    Ok(body)
}

/// The error for bytes that end before their header does.
pub(crate) fn too_short() -> CodecError {
    CodecError::Damaged("it ends before its header does".into())
}
