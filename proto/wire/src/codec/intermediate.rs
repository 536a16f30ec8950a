//! Whatever stands for a step, as bytes: which it is, its first four tell.

use super::error::CodecError;
use super::{DecodeLimits, EncodeOptions, volume};
use lamina_model::Intermediate;
use std::time::{Duration, Instant};

/// Encodes either representation; `options` are for VDIs.
///
/// # Errors
/// As [`super::encode`].
pub fn encode_any(intermediate: &Intermediate, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    match intermediate {
        Intermediate::Vdi(vdi) => super::encode(vdi, options),
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
    if bytes.starts_with(&volume::MAGIC) {
        volume::read_head(bytes, limits).map(drop)
    } else {
        super::check(bytes, limits).map(drop)
    }
}

/// Decodes either representation. `bytes` must be one whole of them and nothing else.
///
/// # Errors
/// If it is neither, a newer one, damaged, larger than `limits`, or contradicts itself.
pub fn decode_any(bytes: &[u8], limits: &DecodeLimits) -> Result<Intermediate, CodecError> {
    if bytes.starts_with(&volume::MAGIC) {
        Ok(Intermediate::Volume(Box::new(volume::decode(bytes, limits)?)))
    } else {
        Ok(Intermediate::Vdi(Box::new(super::decode(bytes, limits)?)))
    }
}
