//! Encoding and decoding of either representation of a time step, a VDI or a reduced volume, told apart by the magic bytes; the
//! latter alone or with those it was coded after.

use crate::error::CodecError;
use crate::vdi::{self, EncodeOptions};
use crate::volume::{self, ReferenceVolume};
use crate::{DecodeLimits, sequence};
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

/// An encoded time step.
#[derive(Debug)]
pub struct EncodedStep {
    /// As sent.
    pub bytes: Vec<u8>,
    /// What it took.
    pub cost: Cost,
    /// Of a reduced volume: what the next one may be coded after.
    pub reference: Option<ReferenceVolume>,
}

/// Encodes as [`encode_any`], a reduced volume after `before` if that saves bytes. `made` is the time that generation took; the
/// encoding time of a reduced volume counts as generation, because its codec does the lossy part.
///
/// # Errors
/// As [`encode_any`].
pub fn encode_timed(
    intermediate: &Intermediate,
    made: Duration,
    options: &EncodeOptions,
    before: Option<&ReferenceVolume>,
) -> Result<EncodedStep, CodecError> {
    let start = Instant::now();
    let (bytes, reference) = match intermediate {
        Intermediate::Vdi(vdi) => (vdi::encode(vdi, options)?, None),
        Intermediate::Volume(reduced) => {
            let (bytes, reference) = volume::encode_after(reduced, options.error, before);
            (bytes, Some(reference))
        }
    };
    let (generation, encode) = intermediate.representation().times(made, start.elapsed());
    let cost = Cost { size_bytes: bytes.len() as u64, generation, encode, elements: intermediate.elements() };
    Ok(EncodedStep { bytes, cost, reference })
}

/// Verifies checksum, version, header and decoded size without decoding the content.
///
/// # Errors
/// As [`decode_any`], except for those that only decoding can find.
pub fn check_any(bytes: &[u8], limits: &DecodeLimits) -> Result<(), CodecError> {
    if sequence::is_sequence(bytes) {
        return sequence::files(bytes)?.into_iter().try_for_each(|file| check_any(file, limits));
    }
    if bytes.starts_with(&volume::container::MAGIC) {
        volume::container::read_head(bytes, limits).map(drop)
    } else {
        vdi::check_whole(bytes, limits)
    }
}

/// Decodes either representation. `bytes` must be exactly one encoded VDI, one reduced volume, or one [sequence](sequence()).
///
/// # Errors
/// If the bytes are none of these, of a newer version, coded after a volume that is not there, damaged, larger than `limits`, or
/// contradict themselves.
pub fn decode_any(bytes: &[u8], limits: &DecodeLimits) -> Result<Intermediate, CodecError> {
    decode_any_after(bytes, limits, |_| None)
}

/// Decodes as [`decode_any`] does, a volume that was coded after another one with what `find` has for that one's checksum.
///
/// # Errors
/// As [`decode_any`].
pub fn decode_any_after(
    bytes: &[u8],
    limits: &DecodeLimits,
    find: impl FnOnce(u32) -> Option<ReferenceVolume>,
) -> Result<Intermediate, CodecError> {
    if sequence::is_sequence(bytes) {
        return sequence::decode(bytes, limits);
    }
    if bytes.starts_with(&volume::container::MAGIC) {
        let reference = volume::coded_after(bytes).and_then(find);
        Ok(Intermediate::Volume(Box::new(volume::decode_after(bytes, limits, reference.as_ref())?)))
    } else {
        Ok(Intermediate::Vdi(Box::new(vdi::decode(bytes, limits)?)))
    }
}
