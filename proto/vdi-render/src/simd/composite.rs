//! Compositing of one pixel's list along eight rays.

use super::dda::CrossedTile;
use super::packet::{Heading, LinePacket};
use super::ray_setup::RaySetup;
use lamina_compute::simd::{Lanes, SMALL_OPTICAL_DEPTH, SimdF32, SimdI32, SimdMask, opacity, small_opacity};
use lamina_model::Supersegment;
use lamina_model::composite::TRANSMITTANCE_FLOOR;

/// Accumulated colors of eight rays, and the state of the traversal.
pub(super) struct RayAccumulator<L: Lanes> {
    seen: Radiance<L>,
    /// Rays that are not opaque yet.
    pub alive: L::M,
    /// Index in the list where the previous pixel's search ended: neighboring lists are similar.
    hint: usize,
}

/// Accumulated color and transmittance, front to back.
#[derive(Clone, Copy)]
struct Radiance<L: Lanes> {
    color: [L::F; 3],
    transmittance: L::F,
}

/// The parts of eight lines inside one pixel, in steps of that pixel's ray.
struct CrossedIntervals<L: Lanes> {
    near: L::F,
    far: L::F,
    /// Step lengths per step of depth; 0 for lines that are not in the pixel.
    per_step: L::F,
}

impl<L: Lanes> RayAccumulator<L> {
    /// Nothing accumulated, for the rays in `live`.
    #[inline(always)]
    pub(super) fn new(live: L::M) -> Self {
        let seen = Radiance { color: [L::F::splat(0.0); 3], transmittance: L::F::splat(1.0) };
        Self { seen, alive: live, hint: 0 }
    }

    /// Composites the list of `pixel` along the lines in `met`, in the order along them.
    #[inline(always)]
    pub(super) fn composite_list(
        &mut self,
        setup: &RaySetup,
        packet: &LinePacket<L>,
        heading: Heading,
        pixel: &CrossedTile<L>,
        met: L::M,
    ) {
        let [i, j] = pixel.at.map(|k| k as usize);
        let (span, list) = setup.grid.span(j * setup.grid.size[0] as usize + i);
        let (list, densities) = (&setup.vdi.segments()[list.clone()], &setup.grid.densities[list]);
        // Convert the positions to steps on the pixel's ray.
        let (from, to) = (packet.way(pixel.from), packet.way(pixel.to));
        let scale = L::F::splat(span.scale);
        let offset = L::F::splat(span.offset);
        let (a, b) = (scale * packet.depth(from) - offset, scale * packet.depth(to) - offset);
        let (near, far) = if heading.receding { (a, b) } else { (b, a) };
        // A part along a depth plane gets a minimal thickness: a supersegment contains all of it or nothing.
        let far = far.max(near + L::F::splat(setup.thin));
        let per_step = packet.steps(to - from).div(far - near).zero_unless(met);
        // The last step of a ray is cut at the box.
        let far = far.min(L::F::splat(span.last));
        let stretches = CrossedIntervals { near, far, per_step };
        // Ends are integers: end > near means end > floor(near), and start <= far means start <= floor(far).
        let [least, most] = L::F::range_where(near, far, met);
        let mut light = self.seen;
        // Composite the supersegments between them, away from or towards the generation camera.
        if heading.receding {
            let first = first_met(list, least, self.hint);
            self.hint = first;
            for (s, &density) in list[first..].iter().zip(&densities[first..]) {
                if s.start as i32 > most {
                    break;
                }
                light = light.before(s, density, &stretches);
            }
        } else {
            let past = past_met(list, most, self.hint);
            self.hint = past;
            for (s, &density) in list[..past].iter().zip(&densities[..past]).rev() {
                if s.end as i32 <= least {
                    break;
                }
                light = light.before(s, density, &stretches);
            }
        }
        self.seen = light;
        self.alive = self.alive & L::F::splat(TRANSMITTANCE_FLOOR as f32).le(light.transmittance);
    }

    /// The colors in front of `background`. Clamped, as sums for white may round to slightly more than 1.
    #[inline(always)]
    pub(super) fn over(&self, background: [f32; 3]) -> [L::F; 3] {
        let ([r, g, b], t) = (self.seen.color, self.seen.transmittance);
        let white = L::F::splat(1.0);
        [
            (r + t * L::F::splat(background[0])).min(white),
            (g + t * L::F::splat(background[1])).min(white),
            (b + t * L::F::splat(background[2])).min(white),
        ]
    }
}

impl<L: Lanes> Radiance<L> {
    /// Composites the overlaps with a supersegment behind.
    #[inline(always)]
    fn before(self, s: &Supersegment, density: f32, stretches: &CrossedIntervals<L>) -> Self {
        let start = L::F::from(L::I::splat(s.start as i32));
        let end = L::F::from(L::I::splat(s.end as i32));
        let overlap = (end.min(stretches.far) - start.max(stretches.near)).max(L::F::splat(0.0));
        let optical_depth = overlap * stretches.per_step * L::F::splat(density);
        let mut alpha = small_opacity::<L>(optical_depth);
        let large = L::F::splat(SMALL_OPTICAL_DEPTH).lt(optical_depth);
        if large.any() {
            alpha = L::F::select(large, opacity::<L>(optical_depth), alpha);
        }
        let weight = self.transmittance * alpha;
        let ([r, g, b], color) = (s.color, self.color);
        let color = [
            color[0] + weight * L::F::splat(r),
            color[1] + weight * L::F::splat(g),
            color[2] + weight * L::F::splat(b),
        ];
        Self { color, transmittance: self.transmittance - weight }
    }
}

/// Index of the first supersegment of `list` that ends beyond `near`, searched from `hint` on.
#[inline(always)]
fn first_met(list: &[Supersegment], near: i32, hint: usize) -> usize {
    let mut k = hint.min(list.len());
    while k > 0 && list[k - 1].end as i32 > near {
        k -= 1;
    }
    while k < list.len() && list[k].end as i32 <= near {
        k += 1;
    }
    k
}

/// Index after the last supersegment of `list` that starts at `far` or before, searched from `hint` on.
#[inline(always)]
fn past_met(list: &[Supersegment], far: i32, hint: usize) -> usize {
    let mut k = hint.min(list.len());
    while k < list.len() && list[k].start as i32 <= far {
        k += 1;
    }
    while k > 0 && list[k - 1].start as i32 > far {
        k -= 1;
    }
    k
}
