//! What is prepared per VDI: how depth becomes steps for every pixel, and where there is nothing to see.
//!
//! Layout, all flat, row by row: `slots` per pixel of the occupied rectangle says which of `spans` is its; `spans[0]`
//! is for pixels without a list, the others follow in order. `masks[0]` is per pixel of the rectangle, `masks[1]` and
//! `masks[2]` per tile of 8 x 8 and 32 x 32 pixels. Tiles are counted from the rectangle's corner. Bit b of a mask is
//! set if a supersegment of these pixels overlaps slab b of [`Slabs`].

use super::depth_steps::{Exact, Span, densities, single};
use lamina_model::Vdi;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile per level, as a power of two.
pub const SHIFTS: [u32; 3] = [0, 3, 5];

/// The 64 slabs: equal in 1/Z, which along a line in the image is as linear as columns and rows are, so that a place on
/// a line gives its slab without a division. Slab 0 is farthest. Nearer than a quarter of the farthest depth all is
/// slab 63: else a camera inside the volume, where 1/Z has no bound, would leave one slab for all the rest.
#[derive(Clone, Copy)]
pub struct Slabs {
    /// 1/Z where slab 0 begins.
    pub far: f64,
    /// Slabs per 1/Z.
    pub per_inverse_depth: f64,
}

/// How many slabs what is stored reaches beyond itself, so that no rounding of places finds a gap that is none.
const MARGIN: f64 = 1e-3;

impl Slabs {
    fn new([near, far]: [f64; 2]) -> Self {
        let inverse_depths = [1.0 / far, 1.0 / near.max(0.25 * far)];
        let thickness = inverse_depths[1] - inverse_depths[0];
        let per_inverse_depth = if thickness > 0.0 { 64.0 / thickness } else { 0.0 };
        Self { far: inverse_depths[0], per_inverse_depth }
    }

    /// The bits of what lies at depths `a <= b`.
    fn touched(&self, a: f64, b: f64) -> u64 {
        let place = |z: f64| (1.0 / z - self.far) * self.per_inverse_depth;
        Self::bits(Self::slab((place(b) - MARGIN) as f32), Self::slab((place(a) + MARGIN) as f32))
    }

    /// The slab at a place on the scale of slabs.
    #[inline(always)]
    pub fn slab(place: f32) -> u32 {
        (place as u32).min(63)
    }

    /// The bits of slabs `a <= b` and all between.
    #[inline(always)]
    pub fn bits(a: u32, b: u32) -> u64 {
        (u64::MAX << a) & (u64::MAX >> (63 - b))
    }
}

/// See the file's head.
pub struct Index {
    /// First occupied column and row.
    pub corner: [u32; 2],
    /// Columns and rows of the occupied rectangle; 0 if the VDI is empty.
    pub size: [u32; 2],
    /// Depths between which everything lies.
    pub depths: [f64; 2],
    /// The depth in the middle.
    pub middle: f64,
    /// Depth to mask bits.
    pub slabs: Slabs,
    /// Per pixel of the rectangle, which span is its.
    pub slots: Vec<u32>,
    /// The first one for all pixels without a list, one more at the end.
    pub spans: Vec<Span>,
    /// Per supersegment, optical depth per step.
    pub densities: Vec<f32>,
    /// Per level and tile.
    pub masks: [Vec<u64>; 3],
}

impl Index {
    /// One pass over the lists' ends, one over all supersegments.
    pub fn new(vdi: &Vdi) -> Self {
        let (corner, size) = occupied(vdi);
        let [w, h] = size.map(|n| n as usize);
        let at = |n: usize| (corner[0] + (n % w) as u32, corner[1] + (n / w) as u32);
        let list = |n: usize| vdi.list(at(n).0, at(n).1);
        let mut taken = 0;
        let slots: Vec<u32> = (0..w * h)
            .map(|n| {
                let some = u32::from(!list(n).is_empty());
                taken += some;
                taken * some
            })
            .collect();
        let mut spans = vec![Exact::default(); usize::from(w > 0)];
        let occupied = (0..w * h).into_par_iter().with_min_len(1024).filter(|&n| slots[n] > 0);
        spans.par_extend(occupied.map(|n| Exact::new(vdi, at(n).0, at(n).1)));
        let densities = densities(vdi, &spans);
        let ends = |n: usize| {
            let ends = list(n).first().zip(list(n).last());
            ends.map_or([f64::INFINITY, 0.0], |(a, b)| spans[slots[n] as usize].depths(a.start, b.end))
        };
        let both = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let depths_of_all =
            (0..w * h).into_par_iter().with_min_len(1024).map(ends).reduce(|| [f64::INFINITY, 0.0], both);
        let slabs = Slabs::new(depths_of_all);
        let mask = |n: usize| {
            let span = &spans[slots[n] as usize];
            list(n).iter().fold(0, |mask, s| {
                let [a, b] = span.depths(s.start, s.end);
                if a < b { mask | slabs.touched(a, b) } else { mask }
            })
        };
        let fine: Vec<u64> = (0..w * h).into_par_iter().with_min_len(1024).map(mask).collect();
        let tiles = coarser(&fine, size, SHIFTS[1] - SHIFTS[0]);
        let coarse = coarser(&tiles, size.map(|n| n.div_ceil(1 << SHIFTS[1])), SHIFTS[2] - SHIFTS[1]);
        let middle = 0.5 * (depths_of_all[0] + depths_of_all[1]);
        let spans = single(vdi, &spans, middle);
        Self {
            corner,
            size,
            depths: depths_of_all,
            middle,
            slabs,
            slots,
            spans,
            densities,
            masks: [fine, tiles, coarse],
        }
    }

    /// The span of pixel `n` of the occupied rectangle, which has a list, and the list's supersegments.
    #[inline(always)]
    pub fn span(&self, n: usize) -> (&Span, Range<usize>) {
        let slot = self.slots[n] as usize;
        let [span, next] = &self.spans[slot..slot + 2] else { unreachable!("two of two") };
        (span, span.first as usize..next.first as usize)
    }

    /// Bytes held.
    pub fn size_bytes(&self) -> usize {
        let masks: usize = self.masks.iter().map(Vec::len).sum();
        size_of_val(&self.slots[..])
            + size_of_val(&self.spans[..])
            + size_of_val(&self.densities[..])
            + masks * size_of::<u64>()
    }

    /// Every bit set, so that nothing is skipped.
    #[cfg(test)]
    pub fn without_gaps(mut self) -> Self {
        self.masks.iter_mut().flatten().for_each(|mask| *mask = u64::MAX);
        self
    }
}

/// The rectangle of pixels that have a list: corner and size.
fn occupied(vdi: &Vdi) -> ([u32; 2], [u32; 2]) {
    let r = vdi.resolution();
    let (mut lo, mut hi) = ([r; 2], [0; 2]);
    for (n, _) in vdi.offsets().windows(2).enumerate().filter(|(_, ends)| ends[0] < ends[1]) {
        for (axis, k) in [n as u32 % r, n as u32 / r].into_iter().enumerate() {
            lo[axis] = lo[axis].min(k);
            hi[axis] = hi[axis].max(k + 1);
        }
    }
    if hi[0] == 0 { ([0; 2], [0; 2]) } else { (lo, [hi[0] - lo[0], hi[1] - lo[1]]) }
}

/// The masks of tiles 2^`shift` times as wide as those of `fine`.
fn coarser(fine: &[u64], size: [u32; 2], shift: u32) -> Vec<u64> {
    let [w, h] = size.map(|n| n.div_ceil(1 << shift) as usize);
    let mut coarse = vec![0; w * h];
    for (row, masks) in fine.chunks(size[0].max(1) as usize).enumerate() {
        for (column, mask) in masks.iter().enumerate() {
            coarse[(row >> shift) * w + (column >> shift)] |= mask;
        }
    }
    coarse
}
