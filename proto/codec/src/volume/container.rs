//! File format of reduced volumes: a header in protobuf encoding, values coded by [`bands`], a checksum.
//!
//! `proto/formats/volume.md` defines the format.

use super::bands;
use super::free_intervals::FreeIntervals;
use super::motion::{self, MotionField};
use super::native_steps::NativeSteps;
use super::reference::ReferenceVolume;
use super::{ErrorMeasure, Tolerance, mask};
use crate::DecodeLimits;
use crate::envelope::{CRC_BYTES, checked_body, take_version, too_short};
use crate::error::{CodecError, invalid};
use lamina_message::{required, v1};
use lamina_model::{Grid, ReducedVolume, Scene, VdiParams, VolumeParams, inpaint};
use prost::Message;
use rayon::prelude::*;
use std::borrow::Cow;

/// First bytes of every file.
pub(crate) const MAGIC: [u8; 4] = *b"LVOL";
/// The version of a volume whose points are all there.
const VERSION: u16 = 1;
/// The version of a volume with a mask of missing points.
const MASKED: u16 = 2;
/// The version of a volume with bands of wavelet coefficients: there is a mask, which may be empty, and each band begins with a byte
/// that says how it is coded.
const MARKED: u16 = 3;
/// The version of a volume that is coded after another one: which one it is, and the motion from it, follow the mask.
const TEMPORAL: u16 = 4;
/// The version of a volume in the steps of its data, and the newest read: the first step and the width of all follow the mask.
const NATIVE: u16 = 5;
/// The largest header read; a scene with the greatest number of control points takes three quarters of it.
const MAX_HEADER_BYTES: usize = 1 << 18;

/// Encodes a reduced volume. Every value decodes within the params' gamma, except where the transfer function shows nothing
/// of it (there, too, by [`ErrorMeasure::Everywhere`]), or, by [`ErrorMeasure::MeanSquare`], with a mean square error no greater than with that bound; a missing point
/// decodes as missing.
pub fn encode(volume: &ReducedVolume, measure: ErrorMeasure) -> Vec<u8> {
    encode_after(volume, measure, None).0
}

/// Encodes a reduced volume as [`encode`] does, by its difference from `reference` where that saves bytes: a decoder then has to have the
/// reference. Its grid may be another, its box should be the same. Also returns what the next volume may be coded after.
pub fn encode_after(
    volume: &ReducedVolume,
    measure: ErrorMeasure,
    reference: Option<&ReferenceVolume>,
) -> (Vec<u8>, ReferenceVolume) {
    let header = v1::VolumeHeader {
        grid: Some(volume.grid().into()),
        scene: Some(volume.scene().into()),
        params: Some(params_message(volume.params())),
    };
    let head = header.encode_to_vec();
    let (units, dims) = (volume.units(), volume.grid().dims());
    let is_masked = units.par_iter().any(|u| u.is_nan());
    let bound = bound(volume.params());
    let free_intervals = FreeIntervals::new(volume, bound);
    let free = |n| if measure == ErrorMeasure::Everywhere { None } else { free_intervals.at(n) };
    let (mut filled, mut missing) = (Cow::Borrowed(units), Vec::new());
    if is_masked {
        missing = mask::encode(&units.iter().map(|u| u.is_nan()).collect::<Vec<bool>>(), dims);
        inpaint(filled.to_mut(), dims);
    }
    let native = NativeSteps::of(units, bound);
    let past = reference.filter(|_| native.is_none()).map(|reference| {
        let aligned = reference.aligned(dims);
        let [before, now] = [&aligned[..], &filled].map(|values| free_intervals.seen(values));
        let motion = motion::estimate(before, now, dims, bound);
        (reference.checksum(), motion.encode(), motion.moved(&aligned, dims))
    });
    let before = past.as_ref().map(|(.., moved)| &moved[..]);
    let coded = match native {
        None => bands::encode(&filled, dims, Tolerance::Bound(bound), free, measure, before),
        Some(steps) => {
            filled.to_mut().par_iter_mut().for_each(|value| *value = steps.number(*value));
            let free = |n| free(n).map(|(lo, hi)| ((lo - steps.first) / steps.width, (hi - steps.first) / steps.width));
            bands::encode(&filled, dims, Tolerance::Integers, free, ErrorMeasure::Maximum, None)
        }
    };
    let version = match (native.is_some(), coded.is_temporal, coded.is_marked, is_masked) {
        (true, ..) => NATIVE,
        (false, true, ..) => TEMPORAL,
        (false, false, true, _) => MARKED,
        (false, false, false, true) => MASKED,
        (false, false, false, false) => VERSION,
    };
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(version.to_le_bytes());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    if version >= MARKED && is_masked && missing.is_empty() {
        // An empty mask says that no point is missing; a decoder reads zeros beyond the end.
        missing.push(0);
    }
    if version > VERSION {
        bytes.extend((missing.len() as u64).to_le_bytes());
        bytes.extend(missing);
    }
    if let (TEMPORAL, Some((checksum, motion, _))) = (version, past) {
        bytes.extend(checksum.to_le_bytes());
        bytes.extend((motion.len() as u64).to_le_bytes());
        bytes.extend(motion);
    }
    if let Some(NativeSteps { first, width }) = native {
        bytes.extend([first, width].iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes.extend(coded.bytes);
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    let mut decoded = coded.decoded;
    if let Some(steps) = native {
        decoded.par_iter_mut().for_each(|value| *value = steps.value(*value));
    }
    if is_masked {
        decoded.iter_mut().zip(units).filter(|(_, unit)| unit.is_nan()).for_each(|(value, _)| *value = f32::NAN);
    }
    (bytes, ReferenceVolume::of(checksum, dims, &decoded))
}

/// Decodes a reduced volume. `bytes` must be exactly one encoded volume.
///
/// # Errors
/// If the bytes are not a volume, of a newer version, coded after another one, damaged, larger than `limits`, or contradict themselves.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<ReducedVolume, CodecError> {
    decode_after(bytes, limits, None)
}

/// Decodes a reduced volume as [`decode`] does, or one that was coded after `reference`.
///
/// # Errors
/// As [`decode`]; also if the bytes were coded after another volume than `reference`.
pub fn decode_after(
    bytes: &[u8],
    limits: &DecodeLimits,
    reference: Option<&ReferenceVolume>,
) -> Result<ReducedVolume, CodecError> {
    let Head { grid, scene, params, mask, past, native, values, is_marked } = read_head(bytes, limits)?;
    let dims = grid.dims();
    let before = match past {
        None => None,
        Some((checksum, motion)) => {
            let reference = reference.filter(|reference| reference.checksum() == checksum);
            let reference = reference.ok_or(CodecError::NeedsReference { checksum })?;
            Some(MotionField::decode(motion, dims).moved(&reference.aligned(dims), dims))
        }
    };
    let tolerance = native.map_or_else(|| Tolerance::Bound(bound(&params)), |_| Tolerance::Integers);
    let decoded = bands::decode(values, dims, tolerance, is_marked, before.as_deref());
    let mut units = decoded.map_err(|e| invalid(e.to_string()))?;
    if let Some(steps) = native {
        units.par_iter_mut().for_each(|unit| *unit = steps.value(*unit));
        if !units.par_iter().all(|unit| unit.is_finite()) {
            return Err(invalid("a value beyond single precision"));
        }
    }
    if let Some(mask) = mask {
        let missing = mask::decode(mask, grid.dims());
        units.iter_mut().zip(missing).filter(|(_, missing)| *missing).for_each(|(unit, _)| *unit = f32::NAN);
    }
    Ok(ReducedVolume::new(grid, scene, params, units)?)
}

/// The checksum of the volume that one is coded after, if these bytes are a volume that is.
pub fn coded_after(bytes: &[u8]) -> Option<u32> {
    let head = read_head(bytes, &DecodeLimits { max_decoded_bytes: u64::MAX }).ok()?;
    head.past.map(|(checksum, _)| checksum)
}

/// A checked header, and the bytes of the values.
pub(crate) struct Head<'a> {
    grid: Grid,
    scene: Scene,
    params: VolumeParams,
    mask: Option<&'a [u8]>,
    /// The checksum of the volume that this one is coded after, and the motion from it.
    past: Option<(u32, &'a [u8])>,
    /// The steps that the values count.
    native: Option<NativeSteps>,
    values: &'a [u8],
    /// Each band begins with a byte that says how it is coded.
    is_marked: bool,
}

/// Checks and reads everything but the values.
pub(crate) fn read_head<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<Head<'a>, CodecError> {
    let version = take_version(bytes, MAGIC, NATIVE)?;
    let body = checked_body(bytes, MAGIC.len() + 2 + 4 + CRC_BYTES)?;
    let rest = &body[MAGIC.len() + 2..];
    let (length, rest) = rest.split_at(4);
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
    if length > MAX_HEADER_BYTES {
        return Err(invalid(format!("its header claims {length} bytes; at most {MAX_HEADER_BYTES}")));
    }
    let (head, values) = rest.split_at_checked(length).ok_or_else(too_short)?;
    let header = v1::VolumeHeader::decode(head).map_err(|e| invalid(format!("its header cannot be read: {e}")))?;
    let grid: Grid = required(header.grid, "grid")?.try_into()?;
    let scene: Scene = required(header.scene, "scene")?.try_into()?;
    let params = params_of(required(header.params, "params")?)?;
    let (needed_bytes, limit_bytes) = (grid.voxels() as u64 * size_of::<f32>() as u64, limits.max_decoded_bytes);
    if needed_bytes > limit_bytes {
        return Err(CodecError::TooLarge { needed_bytes, limit_bytes });
    }
    let (mask, values) = if version > VERSION { take_section(values)? } else { (&[][..], values) };
    let (past, values) = if version == TEMPORAL {
        let (checksum, rest) = values.split_first_chunk().ok_or_else(too_short)?;
        let (motion, values) = take_section(rest)?;
        (Some((u32::from_le_bytes(*checksum), motion)), values)
    } else {
        (None, values)
    };
    let (native, values) = if version == NATIVE {
        let (numbers, values) = values.split_first_chunk::<8>().ok_or_else(too_short)?;
        let [first, width] = [0, 4].map(|at| f32::from_le_bytes(std::array::from_fn(|n| numbers[at + n])));
        if !(first.is_finite() && width.is_finite() && width > 0.0) {
            return Err(invalid("its values count steps of no width"));
        }
        (Some(NativeSteps { first, width }), values)
    } else {
        (None, values)
    };
    let mask = (!mask.is_empty()).then_some(mask);
    let is_marked = version == MARKED || version == TEMPORAL;
    Ok(Head { grid, scene, params, mask, past, native, values, is_marked })
}

/// The bytes of a section that begins with its length, and those after it.
fn take_section(rest: &[u8]) -> Result<(&[u8], &[u8]), CodecError> {
    let (length, rest) = rest.split_first_chunk().ok_or_else(too_short)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| too_short())?;
    rest.split_at_checked(length).ok_or_else(too_short)
}

/// The header's code for the representation.
const VOLUME: u32 = 1;

fn params_message(params: &VolumeParams) -> v1::VolumeParams {
    v1::VolumeParams {
        longest_side: params.longest_side(),
        error_bound: params.error_bound(),
        // The format has room for what only VDIs have.
        opacity_cutoff: 1.0,
        step_voxels: VdiParams::DEFAULT_STEP_VOXELS,
        representation: VOLUME,
    }
}

fn params_of(message: v1::VolumeParams) -> Result<VolumeParams, CodecError> {
    if message.representation != VOLUME {
        return Err(invalid("a volume's parameters name another representation"));
    }
    Ok(VolumeParams::new(message.longest_side, message.error_bound)?)
}

/// The error bound in single precision, at least 1e-6, below which single precision has no digits.
fn bound(params: &VolumeParams) -> f32 {
    (params.error_bound() as f32).max(1e-6)
}
