//! A reduced volume and those that it was coded after, in one piece: `proto/formats/volume.md`, "Sequence".

use crate::DecodeLimits;
use crate::envelope::{take_version, too_short};
use crate::error::{CodecError, invalid};
use crate::volume::{self, ReferenceVolume};
use lamina_model::Intermediate;

/// First bytes.
const MAGIC: [u8; 4] = *b"LSEQ";
const VERSION: u16 = 1;
/// The most volumes in one.
const MOST: u32 = 256;

/// Encoded reduced `volumes` in one piece: the first alone, each other one coded after the one before it. It stands for the last one, and decodes to
/// it without any other file.
pub fn sequence(volumes: &[impl AsRef<[u8]>]) -> Vec<u8> {
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((volumes.len() as u32).to_le_bytes());
    for volume in volumes.iter().map(AsRef::as_ref) {
        bytes.extend((volume.len() as u64).to_le_bytes());
        bytes.extend(volume);
    }
    bytes
}

/// True if `bytes` begin as a sequence does.
pub(crate) fn is_sequence(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// The encoded volumes of a sequence, at least one.
pub(crate) fn files(bytes: &[u8]) -> Result<Vec<&[u8]>, CodecError> {
    take_version(bytes, MAGIC, VERSION)?;
    let (count, mut rest) = bytes[MAGIC.len() + 2..].split_first_chunk().ok_or_else(too_short)?;
    let count = u32::from_le_bytes(*count);
    if !(1..=MOST).contains(&count) {
        return Err(invalid(format!("a sequence of {count} volumes; 1 to {MOST}")));
    }
    let mut files = Vec::new();
    for _ in 0..count {
        let (length, after) = rest.split_first_chunk().ok_or_else(too_short)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| too_short())?;
        let (file, after) = after.split_at_checked(length).ok_or_else(too_short)?;
        if is_sequence(file) {
            return Err(invalid("a sequence within a sequence"));
        }
        files.push(file);
        rest = after;
    }
    if rest.is_empty() { Ok(files) } else { Err(invalid("bytes behind the last volume of a sequence")) }
}

/// The last volume of a sequence.
pub(crate) fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<Intermediate, CodecError> {
    let (mut before, mut last): (Option<ReferenceVolume>, _) = (None, None);
    for file in files(bytes)? {
        let decoded = volume::decode_after(file, limits, before.as_ref())?;
        before = Some(ReferenceVolume::new(file, &decoded));
        last = Some(decoded);
    }
    last.map(|volume| Intermediate::Volume(Box::new(volume))).ok_or_else(too_short)
}
