//! Plain layout, for comparison with the paper: one record of two float depths and an RGBA color per supersegment. Opacity
//! is rounded to a linear scale of 255 steps, which is coarse for thin supersegments.

use super::header::Contents;
use super::quantize;
use super::sections::{Section, SectionShape};
use crate::error::{CodecError, invalid};
use lamina_model::composite::{opacity_from_optical_depth, optical_depth_from_opacity};
use lamina_model::{Supersegment, Vdi, VdiHeader};

/// Bytes of a ray's count.
const COUNT_BYTES: usize = 4;
/// Bytes of a record: start, end, RGBA.
const RECORD_BYTES: usize = 12;

/// Sections of the plain layout, in file order.
pub(super) fn shapes(contents: &Contents) -> [SectionShape; 2] {
    let rays = u64::from(contents.header.header.params.resolution()).pow(2);
    let fixed = |name, elements, width: usize| SectionShape { name, elements, widths: width as u8..=width as u8 };
    [fixed("counts", rays, COUNT_BYTES), fixed("records", u64::from(contents.header.segments), RECORD_BYTES)]
}

pub(super) fn write(vdi: &Vdi) -> Result<Vec<Section>, CodecError> {
    let counts = vdi.offsets().windows(2).flat_map(|w| (w[1] - w[0]).to_le_bytes()).collect();
    let mut records = Vec::with_capacity(RECORD_BYTES * vdi.segments().len());
    let step_length = vdi.header().step_length;
    for s in vdi.segments() {
        for depth in [s.start, s.end] {
            records.extend(distance(depth, step_length)?.to_le_bytes());
        }
        records.extend(quantize::color_codes(s.color));
        records.push(opacity_code(s.optical_depth));
    }
    Ok(vec![Section { width: COUNT_BYTES as u8, bytes: counts }, Section { width: RECORD_BYTES as u8, bytes: records }])
}

pub(super) fn read(sections: &[Section], contents: &Contents) -> Result<Vdi, CodecError> {
    let [counts, records] = sections else {
        return Err(invalid("it has another number of sections"));
    };
    let header = contents.header.header;
    let mut offsets = vec![0_u32];
    let (mut end, mut occupied) = (0_u32, 0);
    for c in counts.bytes.chunks_exact(COUNT_BYTES) {
        let count = u32::from_le_bytes([c[0], c[1], c[2], c[3]]);
        end = end.checked_add(count).ok_or_else(|| invalid("the counts of its rays do not add up"))?;
        occupied += u32::from(count > 0);
        offsets.push(end);
    }
    if occupied != contents.occupied_rays {
        let stated = contents.occupied_rays;
        return Err(invalid(format!("{occupied} rays are occupied where its header says {stated}")));
    }
    let segments = records.bytes.chunks_exact(RECORD_BYTES).map(|r| record(r, header.step_length));
    Ok(Vdi::new(header, offsets, segments.collect::<Result<_, _>>()?)?)
}

fn record(r: &[u8], step_length: f64) -> Result<Supersegment, CodecError> {
    let float = |at: usize| f32::from_le_bytes([r[at], r[at + 1], r[at + 2], r[at + 3]]);
    let steps = |d: f32| {
        step_count(d, step_length).ok_or_else(|| invalid(format!("depth {d} is no number of steps of {step_length}")))
    };
    let optical_depth = optical_depth_from_opacity(f64::from(r[11]) / 255.0) as f32;
    let color = [r[8], r[9], r[10]].map(|c| f32::from(c) / 255.0);
    Ok(Supersegment { start: steps(float(0))?, end: steps(float(4))?, color, optical_depth })
}

fn opacity_code(optical_depth: f32) -> u8 {
    let code = (255.0 * opacity_from_optical_depth(f64::from(optical_depth))).round() as u8;
    code.max(u8::from(optical_depth > 0.0))
}

/// World distance of depth `steps` from the ray's entry into the box.
fn distance(steps: u32, step_length: f64) -> Result<f32, CodecError> {
    let distance = (f64::from(steps) * step_length) as f32;
    if step_count(distance, step_length) != Some(steps) {
        let text = format!("{steps} steps of {step_length} cannot be told from their neighbors as a 32-bit float");
        return Err(CodecError::Unrepresentable(text));
    }
    Ok(distance)
}

fn step_count(distance: f32, step_length: f64) -> Option<u32> {
    let steps = (f64::from(distance) / step_length).round();
    (0.0..=f64::from(VdiHeader::MAX_STEPS)).contains(&steps).then_some(steps as u32)
}
