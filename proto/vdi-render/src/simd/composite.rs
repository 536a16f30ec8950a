//! Compositing what eight lines meet in one pixel's list.

use super::dda::Tile;
use super::packet::{Heading, Packet};
use super::ray_setup::Frame;
use lamina_compute::simd::{Floats, Ints, Lanes, Masks, SMALL, WIDTH, opacity, small_opacity};
use lamina_model::Supersegment;
use lamina_model::composite::TRANSMITTANCE_FLOOR;

/// Eight rays under way.
pub struct Light<L: Lanes> {
    seen: Seen<L>,
    /// Which rays may still see something.
    pub alive: L::M,
    /// The place in the list where the previous pixel's search ended: neighbours' lists are alike.
    hint: usize,
}

/// What they have gathered so far, front to back.
#[derive(Clone, Copy)]
struct Seen<L: Lanes> {
    color: [L::F; 3],
    transmittance: L::F,
}

/// The stretches of eight lines in one pixel, in steps of that pixel's ray.
struct Stretches<L: Lanes> {
    near: L::F,
    far: L::F,
    /// Step lengths covered per step of depth; 0 for lines that are not in the pixel.
    per_step: L::F,
}

impl<L: Lanes> Light<L> {
    /// Nothing yet, for the rays that `live`.
    #[inline(always)]
    pub fn new(live: L::M) -> Self {
        let seen = Seen { color: [L::F::splat(0.0); 3], transmittance: L::F::splat(1.0) };
        Self { seen, alive: live, hint: 0 }
    }

    /// Adds what lines meet in `pixel`, near to far or far to near as they run.
    #[inline(always)]
    pub fn gather(&mut self, frame: &Frame, packet: &Packet<L>, heading: Heading, pixel: &Tile<L>, met: L::M) {
        let [i, j] = pixel.at.map(|k| k as usize);
        let (span, list) = frame.index.span(j * frame.index.size[0] as usize + i);
        let (list, densities) = (&frame.vdi.segments()[list.clone()], &frame.index.densities[list]);
        let (from, to) = (packet.way(pixel.from), packet.way(pixel.to));
        let scale = L::F::splat(span.scale);
        let offset = L::F::splat(span.offset);
        let (a, b) = (scale * packet.depth(from) - offset, scale * packet.depth(to) - offset);
        let (near, far) = if heading.receding { (a, b) } else { (b, a) };
        // Along a depth plane a supersegment has all of the stretch or nothing: a thin one tells which.
        let far = far.max(near + L::F::splat(frame.thin));
        let per_step = packet.steps(to - from).div(far - near).only(met);
        // The last step of a ray is cut at the box.
        let far = far.min(L::F::splat(span.last));
        let stretches = Stretches { near, far, per_step };
        // Ends are integers: end > near says end > floor(near), and start <= far says start <= floor(far).
        let [least, most] = L::F::ends(near, far, met);
        let mut light = self.seen;
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

    /// The colours seen in front of `background`, when all is gathered. Sums of what is white may round to a little more
    /// than white.
    #[inline(always)]
    pub fn over(&self, background: [f32; 3]) -> [[f32; WIDTH]; 3] {
        let ([r, g, b], t) = (self.seen.color, self.seen.transmittance);
        let white = L::F::splat(1.0);
        [
            (r + t * L::F::splat(background[0])).min(white).to_array(),
            (g + t * L::F::splat(background[1])).min(white).to_array(),
            (b + t * L::F::splat(background[2])).min(white).to_array(),
        ]
    }
}

impl<L: Lanes> Seen<L> {
    /// With what the stretches have of a supersegment behind it.
    #[inline(always)]
    fn before(self, s: &Supersegment, density: f32, stretches: &Stretches<L>) -> Self {
        let start = L::F::from(L::I::splat(s.start as i32));
        let end = L::F::from(L::I::splat(s.end as i32));
        let overlap = (end.min(stretches.far) - start.max(stretches.near)).max(L::F::splat(0.0));
        let optical_depth = overlap * stretches.per_step * L::F::splat(density);
        let mut alpha = small_opacity::<L>(optical_depth);
        let large = L::F::splat(SMALL).lt(optical_depth);
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

/// The first supersegment of `list` that ends beyond `near`, looked for from place `hint` on: neighbours' lists are
/// alike.
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

/// One past the last supersegment of `list` that starts at `far` or before, likewise.
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
