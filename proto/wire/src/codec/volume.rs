//! Reduced volumes as bytes: a header that is a message of the contracts, values coded by `lamina-coding`, a checksum.
//!
//! VOLUME-FORMAT.md in this crate's parent folder is the format's definition.

use super::error::{CodecError, invalid};
use super::hidden::Hidden;
use super::{CRC_BYTES, DecodeLimits, checked_body, take_version};
use crate::{required, v1};
use lamina_coding::volume;
use lamina_model::{GenerationParams, Grid, ReducedVolume, Representation, Scene};
use prost::Message;

/// First bytes of every file.
pub(super) const MAGIC: [u8; 4] = *b"LVOL";
/// The version written, and the newest read.
const VERSION: u16 = 1;
/// The largest header read: a scene of as many control points as there may be takes three quarters of it.
const MAX_HEADER_BYTES: usize = 1 << 18;

/// Encodes a reduced volume: no value comes back farther from what it was than the params' gamma, but where nothing can be
/// seen of it.
pub fn encode(volume: &ReducedVolume) -> Vec<u8> {
    let header = v1::VolumeHeader {
        grid: Some(volume.grid().into()),
        scene: Some(volume.scene().into()),
        params: Some(volume.params().into()),
    };
    let head = header.encode_to_vec();
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    let bound = bound(volume.params());
    let hidden = Hidden::of(volume, bound);
    bytes.extend(volume::encode(volume.units(), volume.grid().dims(), bound, |n| hidden.part(n)));
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    bytes
}

/// Decodes a reduced volume. `bytes` must be one whole encoded volume and nothing else.
///
/// # Errors
/// If it is none, a newer one, damaged, larger than `limits`, or contradicts itself.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<ReducedVolume, CodecError> {
    let Head { grid, scene, params, values } = read_head(bytes, limits)?;
    let units = volume::decode(values, grid.dims(), bound(&params)).map_err(|e| invalid(e.to_string()))?;
    Ok(ReducedVolume::new(grid, scene, params, units)?)
}

/// A header, and the values behind it.
pub(super) struct Head<'a> {
    grid: Grid,
    scene: Scene,
    params: GenerationParams,
    values: &'a [u8],
}

/// Checks everything but the values.
pub(super) fn read_head<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<Head<'a>, CodecError> {
    take_version(bytes, MAGIC, VERSION)?;
    let body = checked_body(bytes, MAGIC.len() + 2 + 4 + CRC_BYTES)?;
    let rest = &body[MAGIC.len() + 2..];
    let (length, rest) = rest.split_at(4);
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
    if length > MAX_HEADER_BYTES {
        return Err(invalid(format!("its header claims {length} bytes; at most {MAX_HEADER_BYTES}")));
    }
    let (head, values) = rest.split_at_checked(length).ok_or_else(super::too_short)?;
    let header = v1::VolumeHeader::decode(head).map_err(|e| invalid(format!("its header cannot be read: {e}")))?;
    let grid: Grid = required(header.grid, "grid")?.try_into()?;
    let scene: Scene = required(header.scene, "scene")?.try_into()?;
    let params: GenerationParams = required(header.params, "params")?.try_into()?;
    if params.representation() != Representation::Volume {
        return Err(invalid("a volume's parameters name another representation"));
    }
    let (needed_bytes, limit_bytes) = (grid.voxels() as u64 * size_of::<f32>() as u64, limits.max_decoded_bytes);
    if needed_bytes > limit_bytes {
        return Err(CodecError::TooLarge { needed_bytes, limit_bytes });
    }
    Ok(Head { grid, scene, params, values })
}

/// The error bound. Single precision has no digits for finer ones.
fn bound(params: &GenerationParams) -> f32 {
    (params.gamma() as f32).max(1e-6)
}
