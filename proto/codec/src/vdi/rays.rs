//! Glue between a VDI and its context-mixing coder, [`super::context`].

use super::band::VdiBand;
use super::context::{self, ColorDecoder, GeometryDecoder, QuantizedSegment, damaged};
use super::header::Contents;
use super::quantize;
use crate::error::{CodecError, invalid};
use lamina_model::{Vdi, VdiHeader};

const _: () = assert!(context::MAX_DEPTH == VdiHeader::MAX_STEPS);

pub(super) fn write(vdi: &Vdi) -> Vec<u8> {
    let codes = quantize::codes(vdi);
    let segment = |k: usize| {
        let s = &vdi.segments()[k];
        QuantizedSegment { start: s.start, end: s.end, code: codes[k] }
    };
    context::encode(vdi.header().params.resolution() as usize, vdi.offsets(), segment)
}

/// Rays a side, and supersegments.
fn sizes(contents: &Contents) -> (usize, usize) {
    (contents.header.header.params.resolution() as usize, contents.header.segments as usize)
}

pub(super) fn coded_bytes(bytes: &[u8], contents: &Contents) -> Result<Vec<usize>, CodecError> {
    let (resolution, segments) = sizes(contents);
    context::coded_bytes(bytes, resolution, segments).map_err(damaged)
}

pub(super) fn geometry(bytes: &[u8], contents: &Contents, band: usize) -> Result<GeometryDecoder, CodecError> {
    let (resolution, segments) = sizes(contents);
    context::geometry_decoder(bytes, resolution, segments, band).map_err(damaged)
}

pub(super) fn colors(bytes: &[u8], contents: &Contents, band: usize) -> Result<ColorDecoder, CodecError> {
    let (resolution, segments) = sizes(contents);
    context::color_decoder(bytes, resolution, segments, band).map_err(damaged)
}

pub(super) fn read(bytes: &[u8], contents: &Contents) -> Result<Vdi, CodecError> {
    let (resolution, segments) = sizes(contents);
    join(&context::decode(bytes, resolution, segments).map_err(damaged)?, contents)
}

/// The VDI of all `bands`, in order.
pub(super) fn join(bands: &[VdiBand], contents: &Contents) -> Result<Vdi, CodecError> {
    let (resolution, stated) = sizes(contents);
    let mut offsets = Vec::with_capacity(bands.iter().map(|band| band.ends().len()).sum::<usize>() + 1);
    let mut segments = Vec::with_capacity(stated);
    offsets.push(0);
    for band in bands {
        let first = segments.len() as u32;
        offsets.extend(band.ends().iter().map(|end| first + end));
        segments.extend(band.segments().iter().map(|s| quantize::supersegment(s.start, s.end, s.code)));
    }
    if segments.len() != stated || offsets.len() != resolution * resolution + 1 {
        let (rays, found) = (offsets.len() - 1, segments.len());
        return Err(invalid(format!("{found} supersegments on {rays} rays, not {stated} on {resolution}^2")));
    }
    let occupied = offsets.windows(2).filter(|w| w[0] < w[1]).count();
    if occupied != contents.occupied_rays as usize {
        return Err(invalid(format!("{occupied} of its rays have supersegments, not {}", contents.occupied_rays)));
    }
    Ok(Vdi::new(contents.header.header, offsets, segments)?)
}
