//! Whatever stands for a step, as bytes: which it is, its first four tell.

use crate::error::CodecError;
use crate::vdi::{self, EncodeOptions};
use crate::{DecodeLimits, volume};
use lamina_model::Intermediate;
use std::time::{Duration, Instant};

/// Encodes either representation; `options` are for VDIs.
///
/// # Errors
/// As [`crate::encode`].
pub fn encode_any(intermediate: &Intermediate, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    match intermediate {
        Intermediate::Vdi(vdi) => vdi::encode(vdi, options),
        Intermediate::Volume(reduced) => Ok(volume::encode(reduced)),
    }
}

/// The same, and what generating, which took `made`, and encoding took: what a volume loses it loses while it is coded.
///
/// # Errors
/// As [`encode_any`].
pub fn encode_timed(
    intermediate: &Intermediate,
    made: Duration,
    options: &EncodeOptions,
) -> Result<(Vec<u8>, [Duration; 2]), CodecError> {
    let start = Instant::now();
    let bytes = encode_any(intermediate, options)?;
    let (generation, encoding) = intermediate.representation().times(made, start.elapsed());
    Ok((bytes, [generation, encoding]))
}

/// Passes bytes whose checksum, version, header and decoded size are right, without decoding them.
///
/// # Errors
/// As [`decode_any`], but for what only decoding can find.
pub fn check_any(bytes: &[u8], limits: &DecodeLimits) -> Result<(), CodecError> {
    if bytes.starts_with(&volume::container::MAGIC) {
        volume::container::read_head(bytes, limits).map(drop)
    } else {
        vdi::check_whole(bytes, limits)
    }
}

/// Decodes either representation. `bytes` must be one whole of them and nothing else.
///
/// # Errors
/// If it is neither, a newer one, damaged, larger than `limits`, or contradicts itself.
pub fn decode_any(bytes: &[u8], limits: &DecodeLimits) -> Result<Intermediate, CodecError> {
    if bytes.starts_with(&volume::container::MAGIC) {
        Ok(Intermediate::Volume(Box::new(volume::decode(bytes, limits)?)))
    } else {
        Ok(Intermediate::Vdi(Box::new(vdi::decode(bytes, limits)?)))
    }
}
