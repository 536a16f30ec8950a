//! Pre-integration: color and optical depth of a step from the transfer function's integral between the scalars at its ends.

use super::{EffectsSource, LanePreintegration};
use crate::volume::effects::FEWEST_ROWS;
use crate::volume::transfer_lut::PreintegrationTable;
use lamina_compute::simd::{Lanes, SimdF32, SimdMask, WIDTH};

impl<L: Lanes> EffectsSource<'_, L> {
    /// Replaces color and depth by the integral's, where the ends of a step are at least [`FEWEST_ROWS`] table rows apart.
    #[inline(always)]
    pub(super) fn integrate(
        &self,
        [u, v]: [L::F; 2],
        length: L::F,
        live: L::M,
        color: &mut [L::F; 3],
        depth: &mut L::F,
    ) {
        let s = L::F::splat;
        let Some(LanePreintegration { rows: sums, ends: outside, exact }) = &self.effects.integral else { return };
        let apart = live & s(FEWEST_ROWS as f32).le((v - u).abs());
        if !apart.any() {
            return;
        }
        let (u, v) = (u - s(self.sampler.table.below as f32), v - s(self.sampler.table.below as f32));
        // Look the prefix sums up at both ends, extrapolating outside the range.
        let last = s((sums.len() - 1) as f32);
        let (mut low, mut high) = (L::rows4(sums, u), L::rows4(sums, v));
        for (row, x) in [(&mut low, u), (&mut high, v)] {
            let (before, beyond) = (x.min(s(0.0)), (x - last).max(s(0.0)));
            for c in 0..4 {
                row[c] = row[c] + before * s(outside[0][c]) + beyond * s(outside[1][c]);
            }
        }
        // Divide the differences of the sums.
        let whole = (high[3] - low[3]).div(v - u);
        let straight = s(1.0).div((high[3] - low[3]).abs().max(s(f32::MIN_POSITIVE)));
        let sign = L::F::select(u.lt(v), straight, s(0.0) - straight);
        for c in 0..3 {
            let mean = ((high[c] - low[c]) * sign).max(s(0.0)).min(s(1.0));
            color[c] = L::F::select(apart, mean, color[c]);
        }
        *depth = L::F::select(apart, (whole * length).max(s(0.0)), *depth);
        // Behind an opaque part of the range single precision loses the digits of a faint part: recompute those lanes in
        // double precision, unless they lie beyond everything visible.
        let lost = apart & (high[3] - low[3]).abs().lt(high[3].max(low[3]) * s(1e-4));
        let lost = lost & u.min(v).le(s(self.sampler.table.visible[1]));
        if lost.any() {
            let mut arrays = (color.map(|c| c.to_array()), depth.to_array());
            exactly(exact, [u.to_array(), v.to_array()], length.to_array(), lost.bits(), &mut arrays);
            (*color, *depth) = (arrays.0.map(L::F::from_array), L::F::from_array(arrays.1));
        }
    }
}

/// Colors and depths of steps between rows `u` and `v`, in double precision, for the lanes whose bits are set.
fn exactly(
    exact: &PreintegrationTable,
    [u, v]: [[f32; WIDTH]; 2],
    length: [f32; WIDTH],
    lanes: u32,
    (colors, depths): &mut ([[f32; WIDTH]; 3], [f32; WIDTH]),
) {
    let rows = exact.bins() as f64;
    for l in (0..WIDTH).filter(|l| lanes >> l & 1 == 1) {
        let (color, whole) = exact.between(f64::from(u[l]) / rows, f64::from(v[l]) / rows);
        colors.iter_mut().zip(color).for_each(|(out, c)| out[l] = c.clamp(0.0, 1.0) as f32);
        depths[l] = whole as f32 * length[l];
    }
}
