//! Isosurfaces: where a step crosses them, and their composition with the medium in front and behind.

use super::{EffectsSource, exact_opacity};
use crate::count;
use crate::simd::rays::RayPacket;
use lamina_compute::simd::{Lanes, SimdF32, SimdMask};

impl<L: Lanes> EffectsSource<'_, L> {
    /// Lights the medium at the middle of a step, and composites it with the surfaces crossed between its ends. One loop over
    /// the medium and then each surface, so that the lighting code is compiled once.
    #[inline(always)]
    pub(super) fn light_and_surfaces(
        &self,
        packet: &RayPacket<L>,
        [from, length]: [L::F; 2],
        [u, v]: [L::F; 2],
        live: L::M,
        color: &mut [L::F; 3],
        depth: &mut L::F,
    ) {
        let s = L::F::splat;
        let surfaces = &self.effects.surfaces;
        let falls = v.lt(u);
        let (mut sum, mut through, mut at, mut met) = ([s(0.0); 3], s(1.0), s(0.0), s(0.0));
        let mut crossed = live & !live;
        for n in 0..=surfaces.len() {
            // Find the crossing of surface n in the order along the ray; n = 0 is the medium itself.
            let (mut own, mut share, mut hit, mut surface) = (*color, s(0.5), live, s(0.0));
            if n > 0 {
                let (rising, falling) = (&surfaces[n - 1], &surfaces[surfaces.len() - n]);
                let level = L::F::select(falls, s(falling.0), s(rising.0));
                hit = live & ((u.lt(level) & level.le(v)) | (v.lt(level) & level.le(u)));
                if !hit.any() {
                    continue;
                }
                count::value();
                share = self.crossing(packet, [from, length], [u, v], level);
                for (own, (low, high)) in own.iter_mut().zip(rising.1.iter().zip(falling.1)) {
                    *own = L::F::select(falls, s(high), s(*low));
                }
                surface = L::F::select(falls, s(falling.2), s(rising.2)).zero_unless(hit);
            }
            self.light(packet, from + share * length, &mut own);
            if n == 0 {
                *color = own;
                continue;
            }
            // Composite the medium in front of the surface, then the surface.
            let before = exact_opacity::<L>(*depth * (share - at).max(s(0.0))).zero_unless(hit);
            for c in 0..3 {
                sum[c] = sum[c] + through * before * color[c];
            }
            through = through - through * before;
            let hides = exact_opacity::<L>(surface);
            for c in 0..3 {
                sum[c] = sum[c] + through * hides * own[c];
            }
            through = through - through * hides;
            at = L::F::select(hit, share.max(at), at);
            met = met + surface;
            crossed = crossed | hit;
        }
        // Composite the medium behind the last surface, and convert to straight color.
        if crossed.any() {
            let rest = exact_opacity::<L>(*depth * (s(1.0) - at));
            let all = exact_opacity::<L>(*depth + met).max(s(f32::MIN_POSITIVE));
            for c in 0..3 {
                let straight = (sum[c] + through * rest * color[c]).div(all).min(s(1.0));
                color[c] = L::F::select(crossed, straight, color[c]);
            }
            *depth = *depth + met;
        }
    }

    /// Position of the crossing of `level` within the step, as a share of it: two steps of the secant method.
    #[inline(always)]
    fn crossing(&self, packet: &RayPacket<L>, [from, length]: [L::F; 2], [u, v]: [L::F; 2], level: L::F) -> L::F {
        let s = L::F::splat;
        let first = (level - u).div(v - u);
        let w = self.sampler.sample::<L>(packet.at(from + first * length));
        let behind = (w.lt(level) & u.lt(level)) | (level.le(w) & level.le(u));
        let (x, y) = (L::F::select(behind, first, s(0.0)), L::F::select(behind, s(1.0), first));
        let (p, q) = (L::F::select(behind, w, u), L::F::select(behind, v, w));
        let second = (x + (level - p).div(q - p) * (y - x)).max(s(0.0)).min(s(1.0));
        // False where the field is not finite there, or flat.
        L::F::select(s(0.0).lt((q - p).abs()), second, first)
    }
}
