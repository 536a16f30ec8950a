//! Eight neighbouring rays drawn together.

use super::acceleration_grid::SHIFTS;
use super::clip::Clip;
use super::composite::Light;
use super::dda::{Tile, Walk};
use super::packet::{Heading, Packet};
use super::ray_setup::Frame;
use lamina_compute::simd::{Floats, Lanes, Masks, WIDTH};

/// The colours of one to eight `pixels` (column, row), of which `clip` is known to hold the planes that matter.
#[inline(always)]
pub fn trace<L: Lanes>(frame: &Frame, clip: &Clip, pixels: &[(u32, u32)]) -> [[f32; 3]; WIDTH] {
    let packet = Packet::<L>::new(frame, clip, pixels);
    let mut light = Light::<L>::new(packet.live);
    let mut left = packet.live;
    // Mostly all run in the same sense.
    while left.any() {
        let (group, heading) = packet.group(left);
        through(frame, &packet, heading, group, &mut light);
        left = left & !group;
    }
    let [r, g, b] = light.over(frame.vdi.header().background);
    std::array::from_fn(|l| [r[l], g[l], b[l]])
}

/// Follows a group of rays until they leave or can see no more.
#[inline(always)]
fn through<L: Lanes>(frame: &Frame, packet: &Packet<L>, heading: Heading, group: L::M, light: &mut Light<L>) {
    let (zero, one) = (L::F::splat(0.0), L::F::splat(1.0));
    let from = L::F::select(group, zero, one);
    let whole = Tile::<L> { at: [0; 2], met: group, from, to: L::F::select(group, one, zero) };
    let size = frame.index.size.map(|n| n as i32);
    let last = size.map(|n| (n - 1) >> SHIFTS[1]);
    let mut tiles = Walk::new(packet, heading, SHIFTS[1], &whole, [0; 2], last);
    while let Some(tile) = tiles.next(packet) {
        let met = tile.met & light.alive;
        let mask = frame.index.masks[1][(tile.at[1] * (last[0] + 1) + tile.at[0]) as usize];
        if mask == 0 || !met.any() || mask & packet.slabs(heading, tile.from, tile.to, met) == 0 {
            continue;
        }
        let lo = tile.at.map(|k| k << SHIFTS[1]);
        let hi = [(lo[0] + 7).min(size[0] - 1), (lo[1] + 7).min(size[1] - 1)];
        let mut pixels = Walk::new(packet, heading, 0, &tile, lo, hi);
        while let Some(pixel) = pixels.next(packet) {
            let met = pixel.met & light.alive;
            let mask = frame.index.masks[0][(pixel.at[1] * size[0] + pixel.at[0]) as usize];
            if mask != 0 && met.any() && mask & packet.slabs(heading, pixel.from, pixel.to, met) != 0 {
                light.gather(frame, packet, heading, &pixel, met);
            }
        }
        if !(group & light.alive).any() {
            return;
        }
    }
}
