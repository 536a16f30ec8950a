//! How depth becomes steps on every pixel's ray, and optical depths with it. Only occupied pixels have a span, and their
//! lists follow one another.

use bytemuck::{Pod, Zeroable};
use lamina_model::{Supersegment, Vdi};
use rayon::prelude::*;

/// How far depths are stretched before they enter a mask, relative: above any rounding of positions, below any slab.
const HAIR: f64 = 1e-9;

/// Steps below which single precision does not tell where a ray's last step is cut; optical depth per step ends there.
const SHORTEST: f64 = 1e-4;

/// Optical depth per step of what is opaque: its least part is, and sums and products with it are no infinity.
const OPAQUE: f64 = 1e30;

/// Lists whose supersegments one core goes through at a time.
const BLOCK: usize = 1024;

/// How depth along the view becomes steps on one pixel's ray: `scale * depth - offset`, up to `last`, with depths that
/// count from the middle of what is stored; and where its list begins, which ends where the next one's does. The GPU
/// reads it as it is.
#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
pub struct Span {
    /// Steps per depth.
    pub scale: f32,
    /// Steps before the ray enters the box.
    pub offset: f32,
    /// Where the box ends; the last step of a ray is cut there.
    pub last: f32,
    /// The list's first supersegment.
    pub first: u32,
}

/// The same in double precision, depths counted from the camera.
#[derive(Clone, Copy, Default)]
pub struct Exact {
    scale: f64,
    offset: f64,
    last: f64,
}

impl Exact {
    /// The span of pixel (`i`, `j`); zeros if its ray misses the box.
    pub fn new(vdi: &Vdi, i: u32, j: u32) -> Self {
        let (header, r) = (vdi.header(), vdi.resolution());
        let Some((t_in, t_out)) = header.ray_span(i, j) else { return Self::default() };
        // Depth along the view times the slant is distance along the pixel's own ray.
        let slant = header.camera.direction(f64::from(i) + 0.5, f64::from(j) + 0.5, r, r).length();
        let per_step = 1.0 / header.step_length;
        Self { scale: slant * per_step, offset: t_in * per_step, last: (t_out - t_in) * per_step }
    }

    /// Depths along the view of a supersegment's ends, a hair further apart.
    pub fn depths(&self, start: u32, end: u32) -> [f64; 2] {
        if self.scale == 0.0 {
            return [f64::INFINITY, 0.0];
        }
        let depth = |steps: f64| (steps + self.offset) / self.scale;
        [depth(f64::from(start)) * (1.0 - HAIR), depth(f64::from(end).min(self.last)) * (1.0 + HAIR)]
    }

    /// Optical depth per step of a supersegment.
    fn density(&self, s: &Supersegment) -> f32 {
        let steps = f64::from(s.end).min(self.last) - f64::from(s.start);
        let density = if steps > 0.0 { f64::from(s.optical_depth) / steps.max(SHORTEST) } else { 0.0 };
        density.min(OPAQUE) as f32
    }
}

/// The spans in single precision, and one more where the last list ends.
pub fn single(vdi: &Vdi, spans: &[Exact], middle: f64) -> Vec<Span> {
    if spans.is_empty() {
        return Vec::new();
    }
    let firsts = vdi.offsets().windows(2).filter(|ends| ends[0] < ends[1]).map(|ends| ends[0]);
    let single = |(s, first): (&Exact, u32)| {
        let offset = if s.scale > 0.0 { s.offset - s.scale * middle } else { 0.0 };
        Span { scale: s.scale as f32, offset: offset as f32, last: s.last as f32, first }
    };
    let mut single: Vec<Span> = spans.iter().zip(std::iter::once(0).chain(firsts)).map(single).collect();
    single.push(Span { first: vdi.segments().len() as u32, ..Span::default() });
    single
}

/// Optical depth per step of every supersegment, the last step cut at the box.
pub fn densities(vdi: &Vdi, spans: &[Exact]) -> Vec<f32> {
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
