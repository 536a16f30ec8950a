//! Encoding and decoding of either representation of a time step, a VDI or a reduced volume, told apart by the magic bytes.

use crate::error::CodecError;
use crate::vdi::{self, EncodeOptions};
use crate::{DecodeLimits, volume};
use lamina_model::{Cost, Intermediate};
use std::time::{Duration, Instant};

/// Encodes either representation.
///
/// ```
/// use lamina_codec::{CodecError, DecodeLimits, EncodeOptions, decode_any, encode_any};
/// use lamina_model::{Grid, Intermediate, ReducedVolume, Volume, VolumeParams, Voxels, suggest::suggest};
///
/// let grid = Grid::new([8; 3], glam::DVec3::ONE, glam::DVec3::ZERO)?;
/// let volume = Volume::new(grid, Voxels::U8((0..=255).chain(0..=255).collect()))?;
/// let mut scene = suggest(&[&volume])?;
/// scene.transfer = scene.transfer.with_unit_length(1.0);
///
/// // Values 0..=1 of the transfer function's range, each off by at most 0.01 after decoding.
/// let units: Vec<f32> = (0..512).map(|n| (n % 256) as f32 / 255.0).collect();
/// let reduced = ReducedVolume::new(grid, scene, VolumeParams::new(8, 0.01)?, units.clone())?;
/// let bytes = encode_any(&Intermediate::Volume(Box::new(reduced)), &EncodeOptions::default())?;
/// assert!(bytes.len() < 512 * size_of::<f32>());
///
/// let Intermediate::Volume(decoded) = decode_any(&bytes, &DecodeLimits::default())? else { unreachable!() };
/// assert!(decoded.units().iter().zip(&units).all(|(d, u)| (d - u).abs() <= 0.0101));
/// # Ok::<(), CodecError>(())
/// ```
///
/// # Errors
/// As [`crate::encode`].
pub fn encode_any(intermediate: &Intermediate, options: &EncodeOptions) -> Result<Vec<u8>, CodecError> {
    match intermediate {
        Intermediate::Vdi(vdi) => vdi::encode(vdi, options),
        Intermediate::Volume(reduced) => Ok(volume::encode(reduced, options.error)),
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
