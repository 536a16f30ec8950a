//! Header of a VDI: fixed-size little-endian integers and floats in a fixed order. The only module that uses bincode.
//!
//! It has a plain struct of its own, so that a change to a model type cannot silently change the bytes. `proto/formats/vdi.md`
//! lists the fields; golden bytes in the tests pin both.

use super::options::{Codec, EncodedHeader, Layout};
use crate::error::{CodecError, invalid};
use lamina_model::camera::CameraFields;
use lamina_model::{Aabb, Camera, Invalid, VdiHeader, VdiParams};
use serde::{Deserialize, Serialize};

/// Bytes of an encoded header.
pub(super) const HEADER_BYTES: usize = 194;

/// An allocation bound for bincode; the header has no field of variable size.
const LIMIT_BYTES: usize = 1024;

#[derive(Serialize, Deserialize)]
struct HeaderFields {
    position: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    fov_y_deg: f64,
    box_min: [f64; 3],
    box_max: [f64; 3],
    step_length: f64,
    resolution: u32,
    gamma: f64,
    opacity_cutoff: f64,
    step_voxels: f64,
    transfer_id: u64,
    background: [f32; 3],
    codec: u8,
    layout: u8,
    segments: u32,
    occupied_rays: u32,
}

/// The header, with the number of occupied rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contents {
    pub header: EncodedHeader,
    /// Rays with at least one supersegment.
    pub occupied_rays: u32,
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_little_endian().with_fixed_int_encoding().with_limit::<LIMIT_BYTES>()
}

pub(super) fn write(contents: &Contents) -> Result<Vec<u8>, CodecError> {
    let EncodedHeader { header, codec, layout, segments } = contents.header;
    let camera = CameraFields::from(header.camera);
    let fields = HeaderFields {
        position: camera.position.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        fov_y_deg: camera.fov_y_deg,
        box_min: header.bounds.min.to_array(),
        box_max: header.bounds.max.to_array(),
        step_length: header.step_length,
        resolution: header.params.resolution(),
        gamma: header.params.gamma(),
        opacity_cutoff: header.params.opacity_cutoff(),
        step_voxels: header.params.step_voxels(),
        transfer_id: header.transfer_id,
        background: header.background,
        codec: codec.id(),
        layout: layout.id(),
        segments,
        occupied_rays: contents.occupied_rays,
    };
    bincode::serde::encode_to_vec(fields, config()).map_err(|e| CodecError::Compress(std::io::Error::other(e)))
}

/// Reads a header that fills `bytes`.
pub(super) fn read(bytes: &[u8]) -> Result<Contents, CodecError> {
    let (fields, consumed): (HeaderFields, usize) = bincode::serde::decode_from_slice(bytes, config())
        .map_err(|e| invalid(format!("its header of {} bytes cannot be read: {e}", bytes.len())))?;
    if consumed != bytes.len() {
        return Err(invalid(format!("its header claims {} bytes and has {consumed}", bytes.len())));
    }
    let codec = Codec::from_id(fields.codec).ok_or_else(|| {
        invalid(format!("its codec {} is none of 0 (bzip2), 1 (zstd) and 2 (context-mixing)", fields.codec))
    })?;
    let layout = Layout::from_id(fields.layout)
        .ok_or_else(|| invalid(format!("its layout {} is neither 0 (columns) nor 1 (plain)", fields.layout)))?;
    let (segments, occupied_rays) = (fields.segments, fields.occupied_rays);
    let header = EncodedHeader { header: model_header(&fields)?, codec, layout, segments };
    let rays = u64::from(fields.resolution).pow(2);
    if occupied_rays > segments || u64::from(occupied_rays) > rays || (occupied_rays == 0 && segments > 0) {
        return Err(invalid(format!("{occupied_rays} occupied rays of {rays} do not fit {segments} supersegments")));
    }
    Ok(Contents { header, occupied_rays })
}

fn model_header(f: &HeaderFields) -> Result<VdiHeader, Invalid> {
    let params = VdiParams::new(f.resolution, f.gamma)?
        .with_opacity_cutoff(f.opacity_cutoff)?
        .with_step_voxels(f.step_voxels)?;
    VdiHeader {
        camera: Camera::new(f.position.into(), f.target.into(), f.up.into(), f.fov_y_deg)?,
        bounds: Aabb::new(f.box_min.into(), f.box_max.into())?,
        step_length: f.step_length,
        params,
        transfer_id: f.transfer_id,
        background: f.background,
    }
    .check()
}
