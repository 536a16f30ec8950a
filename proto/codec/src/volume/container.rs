//! File format of reduced volumes: a header in protobuf encoding, values coded by [`bands`], a checksum.
//!
//! `proto/formats/volume.md` defines the format.

use super::bands;
use super::free_intervals::FreeIntervals;
use crate::DecodeLimits;
use crate::envelope::{CRC_BYTES, checked_body, take_version, too_short};
use crate::error::{CodecError, invalid};
use lamina_message::{required, v1};
use lamina_model::{Grid, ReducedVolume, Scene, VdiParams, VolumeParams};
use prost::Message;

/// First bytes of every file.
pub(crate) const MAGIC: [u8; 4] = *b"LVOL";
/// The version written, and the newest read.
const VERSION: u16 = 1;
/// The largest header read; a scene with the greatest number of control points takes three quarters of it.
const MAX_HEADER_BYTES: usize = 1 << 18;

/// Encodes a reduced volume. Every value decodes within the params' gamma, except where the transfer function shows nothing
/// of it.
pub fn encode(volume: &ReducedVolume) -> Vec<u8> {
    let header = v1::VolumeHeader {
        grid: Some(volume.grid().into()),
        scene: Some(volume.scene().into()),
        params: Some(params_message(volume.params())),
    };
    let head = header.encode_to_vec();
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    let bound = bound(volume.params());
    let free_intervals = FreeIntervals::new(volume, bound);
    bytes.extend(bands::encode(volume.units(), volume.grid().dims(), bound, |n| free_intervals.at(n)));
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    bytes
}

/// Decodes a reduced volume. `bytes` must be exactly one encoded volume.
///
/// # Errors
/// If the bytes are not a volume, of a newer version, damaged, larger than `limits`, or contradict themselves.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<ReducedVolume, CodecError> {
    let Head { grid, scene, params, values } = read_head(bytes, limits)?;
    let units = bands::decode(values, grid.dims(), bound(&params)).map_err(|e| invalid(e.to_string()))?;
    Ok(ReducedVolume::new(grid, scene, params, units)?)
}

/// A checked header, and the bytes of the values.
pub(crate) struct Head<'a> {
    grid: Grid,
    scene: Scene,
    params: VolumeParams,
    values: &'a [u8],
}

/// Checks and reads everything but the values.
pub(crate) fn read_head<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<Head<'a>, CodecError> {
    take_version(bytes, MAGIC, VERSION)?;
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
    Ok(Head { grid, scene, params, values })
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
