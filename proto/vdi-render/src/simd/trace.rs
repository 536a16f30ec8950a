//! Tracing of one packet: traversal of tiles and pixels, with empty ones skipped by their masks.

use super::acceleration_grid::SHIFTS;
use super::composite::RayAccumulator;
use super::dda::{CrossedTile, TileWalk};
use super::packet::{Heading, LinePacket};
use super::ray_setup::RaySetup;
use lamina_compute::simd::{Lanes, SimdF32, SimdMask};

/// The colors along the lines of `packet` in `live`, and the background in the other lanes.
#[inline(always)]
pub(super) fn trace<L: Lanes>(setup: &RaySetup, packet: &LinePacket<L>, live: L::M) -> [L::F; 3] {
    let mut light = RayAccumulator::<L>::new(live);
    let mut left = live;
    // Trace rays that share their signs of direction together; mostly all do.
    while left.any() {
        let (group, heading) = packet.group(left);
        through(setup, packet, heading, group, &mut light);
        left = left & !group;
    }
    light.over(setup.vdi.header().background)
}

/// Traces a group of rays until they leave the VDI or become opaque.
#[inline(always)]
fn through<L: Lanes>(
    setup: &RaySetup,
    packet: &LinePacket<L>,
    heading: Heading,
    group: L::M,
    light: &mut RayAccumulator<L>,
) {
    let size = setup.grid.size.map(|n| n as i32);
    let [from, to] = packet.visible(heading, size, group);
    let met = group & from.lt(to);
    if !met.any() {
        return;
    }
    let whole = CrossedTile::<L> { at: [0; 2], met, from, to };
    let last = size.map(|n| (n - 1) >> SHIFTS[1]);
    let mut tiles = TileWalk::new(packet, heading, SHIFTS[1], &whole, [0; 2], last);
    while let Some(tile) = tiles.next(packet) {
        let met = tile.met & light.alive;
        let mask = setup.grid.masks[1][(tile.at[1] * (last[0] + 1) + tile.at[0]) as usize];
        if mask == 0 || !met.any() || mask & packet.depth_bins(heading, tile.from, tile.to, met) == 0 {
            continue;
        }
        let lo = tile.at.map(|k| k << SHIFTS[1]);
        let hi = [(lo[0] + 7).min(size[0] - 1), (lo[1] + 7).min(size[1] - 1)];
        let mut pixels = TileWalk::new(packet, heading, 0, &tile, lo, hi);
        while let Some(pixel) = pixels.next(packet) {
            let met = pixel.met & light.alive;
            let mask = setup.grid.masks[0][(pixel.at[1] * size[0] + pixel.at[0]) as usize];
            if mask != 0 && met.any() && mask & packet.depth_bins(heading, pixel.from, pixel.to, met) != 0 {
                light.composite_list(setup, packet, heading, &pixel, met);
            }
        }
        if !(group & light.alive).any() {
            return;
        }
    }
}
