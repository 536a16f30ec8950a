//! Encoding and decoding of either representation of a time step, a VDI or a reduced volume, told apart by the magic bytes.

use crate::error::CodecError;
use crate::vdi::{self, EncodeOptions};
use crate::{DecodeLimits, volume};
use lamina_model::{Cost, Intermediate};
use std::time::{Duration, Instant};

/// Encodes either representation. `options` concern VDIs only.
///
/// # Errors
/// As [`crate::encode`].
pub fn encode_any(intermediate: &Intermediate, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    match intermediate {
        Intermediate::Vdi(vdi) => vdi::encode(vdi, options),
        Intermediate::Volume(reduced) => Ok(volume::encode(reduced)),
    }
}

/// Encodes as [`encode_any`] and also returns the cost. `made` is the time that generation took; the encoding time of a reduced
/// volume counts as generation, because its codec does the lossy part.
///
/// # Errors
/// As [`encode_any`].
pub fn encode_timed(
    intermediate: &Intermediate,
    made: Duration,
    options: &EncodeOptions,
) -> Result<(Vec<u8>, Cost), CodecError> {
    let start = Instant::now();
    let bytes = encode_any(intermediate, options)?;
    let (generation, encode) = intermediate.representation().times(made, start.elapsed());
    let cost = Cost { size_bytes: bytes.len() as u64, generation, encode, elements: intermediate.elements() };
    Ok((bytes, cost))
}

/// Verifies checksum, version, header and decoded size without decoding the content.
///
/// # Errors
/// As [`decode_any`], except for those that only decoding can find.
pub fn check_any(bytes: &[u8], limits: &DecodeLimits) -> Result<(), CodecError> {
    if bytes.starts_with(&volume::container::MAGIC) {
        volume::container::read_head(bytes, limits).map(drop)
    } else {
        vdi::check_whole(bytes, limits)
    }
}

/// Decodes either representation. `bytes` must be exactly one encoded VDI or reduced volume.
///
/// # Errors
/// If the bytes are neither, of a newer version, damaged, larger than `limits`, or contradict themselves.
pub fn decode_any(bytes: &[u8], limits: &DecodeLimits) -> Result<Intermediate, CodecError> {
    if bytes.starts_with(&volume::container::MAGIC) {
        Ok(Intermediate::Volume(Box::new(volume::decode(bytes, limits)?)))
    } else {
        Ok(Intermediate::Vdi(Box::new(vdi::decode(bytes, limits)?)))
    }
}
