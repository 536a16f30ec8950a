//! The colors of a packet: along its lines, or along displaced ones, combined as `reconstruction.rs` says.

use super::clip::ClipPlanes;
use super::packet::LinePacket;
use super::ray_setup::RaySetup;
use super::trace::trace;
use crate::Displacement;
use crate::reconstruction::{FLAT, INNER_RING, OUTER_RING, turns};
use lamina_compute::simd::{Lanes, SimdF32, SimdMask, WIDTH};

/// The colors of one to eight `pixels` (column, row); `clip` must hold all planes that clip their rays.
#[inline(always)]
pub(super) fn colors<L: Lanes>(setup: &RaySetup, clip: &ClipPlanes, pixels: &[(u32, u32)]) -> [[f32; 3]; WIDTH] {
    let packet = LinePacket::<L>::new(setup, clip, pixels);
    let [r, g, b] = match setup.sharpness {
        Some(sharpness) if packet.live.any() => blended(setup, &packet, sharpness),
        _ => trace(setup, &packet, packet.live),
    }
    .map(L::F::to_array);
    std::array::from_fn(|l| [r[l], g[l], b[l]])
}

#[inline(always)]
fn blended<L: Lanes>(setup: &RaySetup, packet: &LinePacket<L>, sharpness: f32) -> [L::F; 3] {
    let inner = ring(setup, packet, INNER_RING, packet.live);
    let linear = mean::<L>(&inner);
    let [a, b, c, d] = inner;
    let least: [L::F; 3] = std::array::from_fn(|n| a[n].min(b[n]).min(c[n].min(d[n])));
    let most: [L::F; 3] = std::array::from_fn(|n| a[n].max(b[n]).max(c[n].max(d[n])));
    let spread = (most[0] - least[0]).max(most[1] - least[1]).max(most[2] - least[2]);
    let uneven = L::F::splat(FLAT).lt(spread) & packet.live;
    if sharpness == 0.0 || !uneven.any() {
        return linear;
    }
    let outer = mean::<L>(&ring(setup, packet, OUTER_RING, uneven));
    std::array::from_fn(|n| {
        let sharp = linear[n] + L::F::splat(sharpness) * (linear[n] - outer[n]);
        L::F::select(uneven, sharp.max(least[n]).min(most[n]), linear[n])
    })
}

/// The colors along the lines in `live` displaced by four quarter turns.
#[inline(always)]
fn ring<L: Lanes>(setup: &RaySetup, packet: &LinePacket<L>, by: Displacement, live: L::M) -> [[L::F; 3]; 4] {
    let mut colors = [[L::F::splat(0.0); 3]; 4];
    for (colors, by) in colors.iter_mut().zip(turns(by)) {
        *colors = trace(setup, &packet.displaced(by), live);
    }
    colors
}

/// Summed in two pairs, so that four equal colors give exactly their mean.
#[inline(always)]
fn mean<L: Lanes>([a, b, c, d]: &[[L::F; 3]; 4]) -> [L::F; 3] {
    std::array::from_fn(|n| L::F::splat(0.25) * ((a[n] + c[n]) + (b[n] + d[n])))
}
