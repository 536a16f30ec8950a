//! Conversion of depth along the view to steps on each pixel's ray, and densities of supersegments. Only occupied pixels have
//! a conversion; their lists follow each other.

use bytemuck::{Pod, Zeroable};
use lamina_model::{Supersegment, Vdi};
use rayon::prelude::*;

/// Relative enlargement of depth ranges before they enter a mask: above rounding errors, below the size of a bin.
const HAIR: f64 = 1e-9;

/// Least length, in steps, of a ray's last step: single precision does not resolve shorter ones.
const SHORTEST: f64 = 1e-4;

/// Density of an opaque supersegment: finite, but its smallest part is opaque.
const OPAQUE: f64 = 1e30;

/// Number of lists that one core processes at a time.
const BLOCK: usize = 1024;

/// Conversion for one pixel: step = `scale * depth - offset`, at most `last`, with depths relative to the middle of the stored
/// ones; and the first supersegment of its list, which ends where the next one begins. The GPU reads this layout.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct DepthSteps {
    /// Steps per depth.
    pub scale: f32,
    /// Steps from the camera to the ray's entry into the box, shifted to the middle depth.
    pub offset: f32,
    /// Steps at which the ray leaves the box; its last step is cut there.
    pub last: f32,
    /// Index of the list's first supersegment.
    pub first: u32,
}

/// The conversion in double precision, with depths counted from the camera.
#[derive(Clone, Copy, Default)]
pub(super) struct ExactDepthSteps {
    scale: f64,
    offset: f64,
    last: f64,
}

impl ExactDepthSteps {
    /// The conversion of pixel (`i`, `j`); zeros if its ray misses the box.
    pub(super) fn new(vdi: &Vdi, i: u32, j: u32) -> Self {
        let (header, r) = (vdi.header(), vdi.resolution());
        let Some((t_in, t_out)) = header.ray_span(i, j) else { return Self::default() };
        // Depth along the view times the slant is distance along the pixel's own ray.
        let slant = header.camera.direction(f64::from(i) + 0.5, f64::from(j) + 0.5, r, r).length();
        let per_step = 1.0 / header.step_length;
        Self { scale: slant * per_step, offset: t_in * per_step, last: (t_out - t_in) * per_step }
    }

    /// Depths along the view of a supersegment's ends, slightly enlarged.
    pub(super) fn depths(&self, start: u32, end: u32) -> [f64; 2] {
        if self.scale == 0.0 {
            return [f64::INFINITY, 0.0];
        }
        let depth = |steps: f64| (steps + self.offset) / self.scale;
        [depth(f64::from(start)) * (1.0 - HAIR), depth(f64::from(end).min(self.last)) * (1.0 + HAIR)]
    }

    /// Density (optical depth per step) of a supersegment.
    fn density(&self, s: &Supersegment) -> f32 {
        let steps = f64::from(s.end).min(self.last) - f64::from(s.start);
        let density = if steps > 0.0 { f64::from(s.optical_depth) / steps.max(SHORTEST) } else { 0.0 };
        density.min(OPAQUE) as f32
    }
}

/// The conversions in single precision, and one behind the last list.
pub(super) fn single(vdi: &Vdi, spans: &[ExactDepthSteps], middle: f64) -> Vec<DepthSteps> {
    if spans.is_empty() {
        return Vec::new();
    }
    let firsts = vdi.offsets().windows(2).filter(|ends| ends[0] < ends[1]).map(|ends| ends[0]);
    let single = |(s, first): (&ExactDepthSteps, u32)| {
        let offset = if s.scale > 0.0 { s.offset - s.scale * middle } else { 0.0 };
        DepthSteps { scale: s.scale as f32, offset: offset as f32, last: s.last as f32, first }
    };
    let mut single: Vec<DepthSteps> = spans.iter().zip(std::iter::once(0).chain(firsts)).map(single).collect();
    single.push(DepthSteps { first: vdi.segments().len() as u32, ..DepthSteps::default() });
    single
}

/// Density of every supersegment, with the last step cut at the box.
pub(super) fn densities(vdi: &Vdi, spans: &[ExactDepthSteps]) -> Vec<f32> {
    let mut densities = vec![0.0; vdi.segments().len()];
    let lists: Vec<&[u32]> = vdi.offsets().windows(2).filter(|ends| ends[0] < ends[1]).collect();
    let mut rest = &mut densities[..];
    let mut blocks = Vec::new();
    for (lists, spans) in lists.chunks(BLOCK).zip(spans.get(1..).unwrap_or_default().chunks(BLOCK)) {
        let (first, past) = (lists[0][0], lists[lists.len() - 1][1]);
        let (block, others) = rest.split_at_mut((past - first) as usize);
        blocks.push((lists, spans, block));
        rest = others;
    }
    blocks.into_par_iter().for_each(|(lists, spans, block)| {
        let first = lists[0][0] as usize;
        for (ends, span) in lists.iter().zip(spans) {
            for n in ends[0] as usize..ends[1] as usize {
                block[n - first] = span.density(&vdi.segments()[n]);
            }
        }
    });
    densities
}
