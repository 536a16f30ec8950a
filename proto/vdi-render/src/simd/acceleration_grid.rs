//! Acceleration grid of a VDI, built once: conversion of depth to steps for every pixel, and masks of occupied depth bins.
//!
//! All arrays are flat, row by row. `slots` gives, per pixel of the occupied rectangle, its index in `spans`; `spans[0]` is for
//! pixels without a list, the others follow in order. `masks[0]` is per pixel of the rectangle, `masks[1]` and `masks[2]` per
//! tile of 8 x 8 and 32 x 32 pixels. Tiles are counted from the rectangle's corner. Bit b of a mask is set if a supersegment of
//! these pixels overlaps depth bin b ([`DepthBins`]).

use super::depth_steps::{DepthSteps, ExactDepthSteps, densities, single};
use lamina_model::Vdi;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile per level, as a power of two.
pub(super) const SHIFTS: [u32; 3] = [0, 3, 5];

/// 64 depth bins, uniform in 1/Z, which along a line in the image is linear like columns and rows, so that a position on a line
/// gives its bin without a division. Bin 0 is farthest. Bin 63 covers everything nearer than a quarter of the farthest depth:
/// for a camera inside the volume, where 1/Z is unbounded, everything else would fall into bin 0 otherwise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthBins {
    /// 1/Z at which bin 0 begins.
    pub far: f64,
    /// Bins per 1/Z.
    pub per_inverse_depth: f64,
}

/// Enlargement of stored depth ranges, in bins, so that rounding of positions never finds a false gap.
const MARGIN: f64 = 1e-3;

impl DepthBins {
    fn new([near, far]: [f64; 2]) -> Self {
        let inverse_depths = [1.0 / far, 1.0 / near.max(0.25 * far)];
        let thickness = inverse_depths[1] - inverse_depths[0];
        let per_inverse_depth = if thickness > 0.0 { 64.0 / thickness } else { 0.0 };
        Self { far: inverse_depths[0], per_inverse_depth }
    }

    /// Mask of the bins between depths `a <= b`.
    fn touched(&self, a: f64, b: f64) -> u64 {
        let place = |z: f64| (1.0 / z - self.far) * self.per_inverse_depth;
        Self::bits(Self::bin((place(b) - MARGIN) as f32), Self::bin((place(a) + MARGIN) as f32))
    }

    /// The bin at a position on the scale of bins.
    #[inline(always)]
    pub(crate) fn bin(place: f32) -> u32 {
        (place as u32).min(63)
    }

    /// Mask of bins `a` to `b`, both included.
    #[inline(always)]
    pub(crate) fn bits(a: u32, b: u32) -> u64 {
        (u64::MAX << a) & (u64::MAX >> (63 - b))
    }
}

/// Data structures for rendering one VDI; see the module's documentation.
#[derive(Debug)]
pub(crate) struct AccelerationGrid {
    /// First occupied column and row.
    pub corner: [u32; 2],
    /// Columns and rows of the occupied rectangle; 0 if the VDI is empty.
    pub size: [u32; 2],
    /// Least and greatest depth of all supersegments.
    pub depths: [f64; 2],
    /// Mean of the two.
    pub middle: f64,
    /// Conversion of depths to mask bits.
    pub depth_bins: DepthBins,
    /// Index in `spans`, per pixel of the rectangle.
    pub slots: Vec<u32>,
    /// Depth conversions: one for pixels without a list, one per list, and one behind the last.
    pub spans: Vec<DepthSteps>,
    /// Density (optical depth per step), per supersegment.
    pub densities: Vec<f32>,
    /// Masks of occupied depth bins, per level and tile.
    pub masks: [Vec<u64>; 3],
}

impl AccelerationGrid {
    /// The grid of `vdi`: one pass over the lists' ends, one over all supersegments.
    pub(crate) fn new(vdi: &Vdi) -> Self {
        let (corner, size) = occupied(vdi);
        let [w, h] = size.map(|n| n as usize);
        let at = |n: usize| (corner[0] + (n % w) as u32, corner[1] + (n / w) as u32);
        let list = |n: usize| vdi.list(at(n).0, at(n).1);
        // Assign a depth conversion to every pixel with a list.
        let mut taken = 0;
        let slots: Vec<u32> = (0..w * h)
            .map(|n| {
                let some = u32::from(!list(n).is_empty());
                taken += some;
                taken * some
            })
            .collect();
        let mut spans = vec![ExactDepthSteps::default(); usize::from(w > 0)];
        let occupied = (0..w * h).into_par_iter().with_min_len(1024).filter(|&n| slots[n] > 0);
        spans.par_extend(occupied.map(|n| ExactDepthSteps::new(vdi, at(n).0, at(n).1)));
        let densities = densities(vdi, &spans);
        // Find the range of depths, and divide it into bins.
        let ends = |n: usize| {
            let ends = list(n).first().zip(list(n).last());
            ends.map_or([f64::INFINITY, 0.0], |(a, b)| spans[slots[n] as usize].depths(a.start, b.end))
        };
        let both = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let depths_of_all =
            (0..w * h).into_par_iter().with_min_len(1024).map(ends).reduce(|| [f64::INFINITY, 0.0], both);
        let depth_bins = DepthBins::new(depths_of_all);
        // Mark the occupied bins per pixel, then per tile.
        let mask = |n: usize| {
            let span = &spans[slots[n] as usize];
            list(n).iter().fold(0, |mask, s| {
                let [a, b] = span.depths(s.start, s.end);
                if a < b { mask | depth_bins.touched(a, b) } else { mask }
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
            depth_bins,
            slots,
            spans,
            densities,
            masks: [fine, tiles, coarse],
        }
    }

    /// Depth conversion of pixel `n` of the occupied rectangle, which must have a list, and the range of its supersegments.
    #[inline(always)]
    pub(crate) fn span(&self, n: usize) -> (&DepthSteps, Range<usize>) {
        let slot = self.slots[n] as usize;
        let [span, next] = &self.spans[slot..slot + 2] else { unreachable!("two of two") };
        (span, span.first as usize..next.first as usize)
    }

    /// Bytes held.
    pub(crate) fn size_bytes(&self) -> usize {
        let masks: usize = self.masks.iter().map(Vec::len).sum();
        size_of_val(&self.slots[..])
            + size_of_val(&self.spans[..])
            + size_of_val(&self.densities[..])
            + masks * size_of::<u64>()
    }

    /// The same grid with all bits set, so that nothing is skipped.
    #[cfg(test)]
    pub(crate) fn without_gaps(mut self) -> Self {
        self.masks.iter_mut().flatten().for_each(|mask| *mask = u64::MAX);
        self
    }
}

/// The bounding rectangle of pixels that have a list: corner and size.
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

/// Masks of tiles 2^`shift` times as wide as those of `fine`.
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
