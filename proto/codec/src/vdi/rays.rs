//! Glue between a VDI and its context-mixing coder, [`super::context`].

use super::context::{self, QuantizedSegment};
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

pub(super) fn read(bytes: &[u8], contents: &Contents) -> Result<Vdi, CodecError> {
    let (header, segments) = (contents.header.header, contents.header.segments as usize);
    let make = |s: QuantizedSegment| quantize::supersegment(s.start, s.end, s.code);
    let (offsets, segments) = context::decode(bytes, header.params.resolution() as usize, segments, make)
        .map_err(|e| invalid(e.to_string()))?;
    let occupied = offsets.windows(2).filter(|w| w[0] < w[1]).count();
    if occupied != contents.occupied_rays as usize {
        return Err(invalid(format!("{occupied} of its rays have supersegments, not {}", contents.occupied_rays)));
    }
    Ok(Vdi::new(header, offsets, segments)?)
}
