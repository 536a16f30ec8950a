//! What begins and ends the bytes of both formats: magic bytes, version, checksum.

use crate::error::{self, CodecError};

/// The checksum that ends a file.
pub const CRC_BYTES: usize = 4;

/// The version that bytes state which begin with `magic`, up to `newest`.
pub fn take_version(bytes: &[u8], magic: [u8; 4], newest: u16) -> Result<u16, CodecError> {
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

/// `bytes`, of which there must be `least`, without the checksum that ends them.
pub fn checked_body(bytes: &[u8], least: usize) -> Result<&[u8], CodecError> {
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

/// What is said of bytes that end before their header does.
pub fn too_short() -> CodecError {
    CodecError::Damaged("it ends before its header does".into())
}
