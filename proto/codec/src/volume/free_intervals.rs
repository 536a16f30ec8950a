//! Free intervals: values that a voxel may take without being seen, from the transparent parts of the transfer function.
//!
//! A sample is interpolated between the eight points of a cell. If all points of all cells around a point lie in one part of
//! the range that the transfer function leaves transparent, every sample in those cells does too, whatever value of that
//! part the point takes. Gradients and pre-integration depend on points farther away.
//!
//! An invisible point may also decode with an error up to the bound, like any other. Without that allowance points near the
//! end of a part cost half as many bytes again (a smooth field of 256^3 at a bound of 0.05: 70 kB, with it 46).

use lamina_model::{ReducedVolume, Scene};
use rayon::prelude::*;

/// For each sample point, the transparent part of the range in which it and its surroundings lie.
pub(super) struct FreeIntervals<'a> {
    units: &'a [f32],
    bound: f32,
    parts: Vec<[f32; 2]>,
    /// Index of the part, or [`VISIBLE`].
    part: Vec<u8>,
}

/// Marks a point whose surroundings may be seen.
const VISIBLE: u8 = u8::MAX;
/// Marks a missing point with nothing but missing points around: cells with a missing point are drawn as empty, so it may be part of
/// any interval.
const MISSING: u8 = VISIBLE - 1;

impl<'a> FreeIntervals<'a> {
    /// The free intervals of `volume`, whose values may be off by `bound` in any case.
    pub(super) fn new(volume: &'a ReducedVolume, bound: f32) -> Self {
        let (scene, dims) = (volume.scene(), volume.grid().dims());
        let mut parts = scene.transfer.transparent_parts();
        for surface in &scene.effects.isosurfaces {
            // A visible isosurface inside a transparent part splits it in two.
            let at = scene.transfer.range().unit_from_value(surface.value);
            let split = |[lo, hi]: [f32; 2]| match lo <= at && at <= hi {
                true => vec![[lo, at.next_down()], [at.next_up(), hi]],
                false => vec![[lo, hi]],
            };
            parts = parts.into_iter().flat_map(split).filter(|[lo, hi]| lo <= hi).collect();
        }
        parts.truncate(usize::from(MISSING));
        let index = |u: &f32| {
            let found = parts.iter().position(|[lo, hi]| (lo..=hi).contains(&u));
            found.map_or(if u.is_nan() { MISSING } else { VISIBLE }, |n| n as u8)
        };
        let mut part: Vec<u8> = volume.units().par_iter().map(index).collect();
        for _ in 0..reach(scene) {
            (0..3).for_each(|axis| part = common_with_neighbors(&part, dims, axis));
        }
        Self { units: volume.units(), bound, parts, part }
    }

    /// `values` without the transparent parts of the range, each of which becomes one value: those that look alike are alike.
    pub(super) fn seen(&self, values: &[f32]) -> Vec<f32> {
        let seen = |&value: &f32| {
            let (mut at, mut left_out) = (value, 0.0);
            for &[lo, hi] in &self.parts {
                match (lo.is_finite(), hi.is_finite()) {
                    (true, true) => left_out += (value - lo).clamp(0.0, hi - lo),
                    (true, false) => at = at.min(lo),
                    (false, true) => at = at.max(hi),
                    (false, false) => at = 0.0,
                }
            }
            at - left_out
        };
        values.par_iter().map(seen).collect()
    }

    /// The interval of values that point `n` may take; `None` if only the bound applies.
    pub(super) fn at(&self, n: usize) -> Option<(f32, f32)> {
        let unit = self.units[n];
        if unit.is_nan() {
            return Some((f32::NEG_INFINITY, f32::INFINITY));
        }
        let [lo, hi] = *self.parts.get(usize::from(self.part[n]))?;
        Some((lo.min(unit - self.bound), hi.max(unit + self.bound)))
    }
}

/// Distance along each axis, in points, within which samples depend on a point.
fn reach(scene: &Scene) -> u32 {
    let effects = &scene.effects;
    // A gradient is made of samples one point to either side; pre-integration looks at the ends of a step.
    let gradient = u32::from(effects.shading.is_some());
    let ends =
        if effects.pre_integrated || !effects.isosurfaces.is_empty() { scene.step_voxels.ceil() as u32 } else { 0 };
    1 + gradient.max(ends)
}

/// The part of each point, or [`VISIBLE`] where a neighbor along `axis` lies in another part.
fn common_with_neighbors(part: &[u8], dims: [usize; 3], axis: usize) -> Vec<u8> {
    let (row, lines) = (dims[0], [0, 1, dims[1]][axis]);
    let differ = |out: &mut [u8], beside: &[u8]| {
        out.iter_mut().zip(beside).for_each(|(o, &b)| {
            *o = match *o {
                here if here == b || b == MISSING => here,
                MISSING => b,
                _ => VISIBLE,
            };
        });
    };
    let mut out = part.to_vec();
    out.par_chunks_exact_mut(row).enumerate().for_each(|(n, out)| {
        let line = |n: usize| &part[n * row..(n + 1) * row];
        if axis == 0 {
            differ(&mut out[1..], &line(n)[..row - 1]);
            differ(&mut out[..row - 1], &line(n)[1..]);
            return;
        }
        let at = [n % dims[1], n / dims[1]][axis - 1];
        if at > 0 {
            differ(out, line(n - lines));
        }
        if at + 1 < dims[axis] {
            differ(out, line(n + lines));
        }
    });
    out
}
