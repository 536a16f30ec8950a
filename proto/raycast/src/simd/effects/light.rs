//! Lighting: shadows and ambient occlusion from the light volume, shading by the gradient, depth cueing.

use super::EffectsSource;
use crate::count;
use crate::simd::rays::RayPacket;
use crate::volume::effects::WEAK_GRADIENT;
use lamina_compute::simd::{Lanes, SimdF32, SimdI32};

impl<L: Lanes> EffectsSource<'_, L> {
    /// Applies shadow, occlusion, shading and depth cue to straight colors at `t` steps from the entry.
    #[inline(always)]
    pub(super) fn light(&self, packet: &RayPacket<L>, t: L::F, color: &mut [L::F; 3]) {
        let s = L::F::splat;
        let (effects, lane_effects) = (self.effects.effects, self.effects);
        let p = packet.at(t);
        // Look the light volume up.
        let (mut shadow, mut open) = (s(1.0), s(1.0));
        if let Some(volume) = &effects.volume {
            // The offset is 0: every axis has a cell here.
            let scale = volume.scale.map(|x| x as f32);
            let q = [p[0] * s(scale[0]), p[1] * s(scale[1]), p[2] * s(scale[2])];
            if let Some(transmittance) = &volume.transmittance {
                count::shadow();
                let transmittance = coarse::<L>(volume.dims, transmittance, q);
                shadow = s(1.0) - s(effects.shadows as f32) * (s(1.0) - transmittance);
            }
            if let Some(openness) = &volume.openness {
                count::occlusion();
                open = s(1.0) - s(effects.ambient_occlusion as f32) * (s(1.0) - coarse::<L>(volume.dims, openness, q));
            }
        }
        // Shade by the gradient (Blinn-Phong).
        let (mut scale, mut highlight) = (open * shadow, s(0.0));
        if let Some(shading) = &effects.shading {
            count::gradient();
            let g = self.gradient(p);
            let size = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
            let sloped = s(0.0).lt(size);
            let share = size.div(size + s(WEAK_GRADIENT as f32)).zero_unless(sloped);
            let along = s(1.0).div(size.max(s(f32::MIN_POSITIVE)));
            let light = lane_effects.light;
            let toward = (g[0] * s(light[0]) + g[1] * s(light[1]) + g[2] * s(light[2])) * along;
            let mut gloss = ((g[0] * self.half[0] + g[1] * self.half[1] + g[2] * self.half[2]) * along).abs();
            for _ in 0..shading.shininess.trailing_zeros() {
                gloss = gloss * gloss;
            }
            let lit = s(shading.ambient as f32) * open + s(shading.diffuse as f32) * toward.abs() * shadow;
            let mixed = (s(1.0) - share) * scale + share * lit;
            scale = L::F::select(sloped, mixed, scale);
            highlight = (share * s(shading.specular as f32) * gloss * shadow).zero_unless(sloped);
        }
        // Apply light, then the depth cue.
        if effects.volume.is_some() || effects.shading.is_some() {
            for c in color.iter_mut() {
                *c = (*c * scale + highlight).max(s(0.0)).min(s(1.0));
            }
        }
        if let (Some((_, per_step)), Some(cue)) = (lane_effects.cue, &effects.cue) {
            let w = ((self.entry + t) * s(per_step)).max(s(0.0)).min(s(cue.strength as f32));
            for (c, far) in color.iter_mut().zip(cue.color) {
                *c = *c + w * (s(far as f32) - *c);
            }
        }
    }

    /// Gradient by central differences over one voxel to either side, in shares of the range per voxel length.
    #[inline(always)]
    fn gradient(&self, p: [L::F; 3]) -> [L::F; 3] {
        let mut gradient = [L::F::splat(0.0); 3];
        for side in [-1.0, 1.0] {
            for a in 0..3 {
                let mut q = p;
                q[a] = q[a] + L::F::splat(side);
                let scale = L::F::splat(side * self.effects.gradient[a]);
                gradient[a] = gradient[a] + scale * self.sampler.sample::<L>(q);
            }
        }
        gradient
    }
}

/// Trilinear interpolation of a coarse grid at `q`, in that grid's units; clamped into it.
#[inline(always)]
fn coarse<L: Lanes>(dims: [usize; 3], field: &[f32], q: [L::F; 3]) -> L::F {
    let s = L::F::splat;
    let inside = |a: usize, x: L::F| x.max(s(0.0)).min(s(((dims[a] - 1) as f32).next_down()));
    let x = [inside(0, q[0]), inside(1, q[1]), inside(2, q[2])];
    let cell = [x[0].to_int(), x[1].to_int(), x[2].to_int()];
    let w = [x[0] - L::F::from(cell[0]), x[1] - L::F::from(cell[1]), x[2] - L::F::from(cell[2])];
    let (row, slice) = (dims[0], dims[0] * dims[1]);
    let index = ((cell[2] * L::I::splat(dims[1] as i32) + cell[1]) * L::I::splat(row as i32) + cell[0]).to_indices();
    let mut corners = [s(0.0); 4];
    for (corner, offset) in corners.iter_mut().zip([0, row, slice, slice + row]) {
        // SAFETY: cells are at most dims - 2 on every axis, so an index plus a row, a slice, or both, plus one, lies inside.
        #[expect(unsafe_code, reason = "indices were clamped at once")]
        let (a, b) = unsafe { L::pairs(&field[offset..], &index) };
        *corner = a + w[0] * (b - a);
    }
    let [near, far] = [corners[0] + w[1] * (corners[1] - corners[0]), corners[2] + w[1] * (corners[3] - corners[2])];
    near + w[2] * (far - near)
}
