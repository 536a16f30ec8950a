//! Samples of a ray with all effects of a scene: clipping, pre-integration, isosurfaces, light, depth cueing.

use super::march::{RayMarcher, RaySample};
use crate::volume::effects::{FEWEST_ROWS, FieldEffects, SHORTEST, WEAK_GRADIENT, cue_range};
use crate::volume::transfer_lut::{OPAQUE, PreintegrationTable};
use crate::{Field, count};
use glam::DVec3;
use lamina_model::Ray;
use lamina_model::composite::{Accumulator, opacity_from_optical_depth};
use lamina_model::effects::DepthCue;
use lamina_model::transfer::Classified;
use lamina_model::vdi;
use std::ops::ControlFlow;

/// A ray in units of sample points, with the effects that apply to it.
struct ClippedRay<'a> {
    field: &'a Field,
    effects: &'a FieldEffects,
    ray: &'a Ray,
    origin: DVec3,
    direction: DVec3,
    /// Depth cue, and the world distances between which it fades colors.
    cue: Option<(DepthCue, f64, f64)>,
}

impl RayMarcher<'_> {
    /// As [`RayMarcher::samples`], for a field with `effects`; `integral` is present if they are pre-integrated.
    pub(super) fn samples_with(
        &self,
        effects: &FieldEffects,
        integral: Option<&PreintegrationTable>,
        ray: &Ray,
        mut visit: impl FnMut(RaySample) -> ControlFlow<()>,
    ) {
        let (field, unit_length, step_length) = (self.field, self.unit_length, self.step_length);
        let Some((t_in, t_out)) = self.bounds.clip(ray) else { return };
        let (origin, direction) = (field.index_from_world(ray.origin), ray.direction / field.grid().spacing());
        let (near, far) = cue_range(field.grid(), ray.origin);
        let cue = effects.cue.map(|cue| (cue, near, far));
        let clipped = ClippedRay { field, effects, ray, origin, direction, cue };
        let (from, to) = effects.clip(origin, direction, t_in, t_out);
        let first = ((from - t_in) / step_length).max(0.0) as u32;
        for step in first..vdi::steps(t_out - t_in, step_length) {
            // Clip the step.
            let start = t_in + f64::from(step) * step_length;
            let (a, b) = (start.max(from), (start + step_length).min(t_out).min(to));
            if a >= to {
                return;
            }
            let (length, middle) = (b - a, 0.5 * (a + b));
            if length <= SHORTEST * step_length || !field.is_visible(clipped.at(middle)) {
                continue;
            }
            // Classify the middle of the step, or integrate between its ends.
            let ends = effects.needs_ends().then(|| [a, b].map(|t| clipped.value(t)));
            let whole = match (integral, ends) {
                (Some(integral), Some([u, v])) if ((v - u) * integral.bins() as f64).abs() >= FEWEST_ROWS => {
                    let (color, depth) = integral.between(u, v);
                    Classified { color, opacity: 0.0, extinction: depth / step_length }
                }
                _ => field.scene().transfer.classify(field.sample(clipped.at(middle)), unit_length),
            };
            // Apply the color field, light, and isosurfaces.
            let whole = Classified { color: clipped.own_color(whole, middle), ..whole };
            let extinction = clipped.light_and_surfaces(whole, [a, b], ends);
            let Some((color, optical_depth)) = extinction else { continue };
            let extinction = optical_depth / length;
            let opacity = opacity_from_optical_depth(extinction * unit_length);
            let classified = Classified { color, opacity, extinction };
            if visit(RaySample { step, length, classified }).is_break() {
                return;
            }
        }
    }
}

impl ClippedRay<'_> {
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    fn value(&self, t: f64) -> f64 {
        count::value();
        f64::from(self.field.sample(self.at(t)))
    }

    /// Color of the medium at ray distance `t`, before lighting.
    fn own_color(&self, medium: Classified, t: f64) -> [f64; 3] {
        let Some(colors) = self.effects.colors.as_ref().filter(|_| medium.extinction > 0.0) else {
            return medium.color;
        };
        count::color();
        colors.at(self.field.grid_part().local(self.at(t))).unwrap_or(medium.color)
    }

    /// Straight color and optical depth of the step from `a` to `b`; `None` if it is transparent.
    fn light_and_surfaces(
        &self,
        medium: Classified,
        [a, b]: [f64; 2],
        ends: Option<[f64; 2]>,
    ) -> Option<([f64; 3], f64)> {
        // Finite, as in the tables of the fast levels: a share of it may be 0.
        let (depth, mut met) = ((medium.extinction * (b - a)).min(OPAQUE), 0.0);
        let color = if depth > 0.0 { self.shade(medium.color, 0.5 * (a + b)) } else { [0.0; 3] };
        let (mut light, mut sum) = (Accumulator::default(), 0.0);
        let [u, v] = ends.unwrap_or_default();
        let surfaces = &self.effects.surfaces;
        for n in 0..surfaces.len() {
            let surface = &surfaces[if v < u { surfaces.len() - 1 - n } else { n }];
            if !((u < surface.at && surface.at <= v) || (v < surface.at && surface.at <= u)) {
                continue;
            }
            let share = self.crossing([a, b], [u, v], surface.at);
            light.add(color, depth * (share - met).max(0.0));
            light.add(self.shade(surface.color, a + share * (b - a)), surface.optical_depth);
            (met, sum) = (share.max(met), sum + surface.optical_depth);
        }
        if sum == 0.0 {
            return (depth > 0.0).then_some((color, depth));
        }
        light.add(color, depth * (1.0 - met));
        let opacity = opacity_from_optical_depth(depth + sum);
        Some((light.color.map(|c| (c / opacity).min(1.0)), depth + sum))
    }

    /// Position of the crossing of `level` between `a` and `b`, as a share of the step: two steps of the secant method.
    fn crossing(&self, [a, b]: [f64; 2], [u, v]: [f64; 2], level: f64) -> f64 {
        let first = (level - u) / (v - u);
        let w = self.value(a + first * (b - a));
        if w.is_nan() {
            return first;
        }
        let (x, y, p, q) = if (w < level) == (u < level) { (first, 1.0, w, v) } else { (0.0, first, u, w) };
        if p == q { first } else { (x + (level - p) / (q - p) * (y - x)).clamp(0.0, 1.0) }
    }

    /// A straight color at ray distance `t` with shadow, occlusion, shading and depth cue applied.
    fn shade(&self, color: [f64; 3], t: f64) -> [f64; 3] {
        let (effects, mut color) = (self.effects, color);
        // Look the light volume up.
        let (mut shadow, mut open) = (1.0, 1.0);
        if let Some(volume) = &effects.volume {
            if let Some(transmittance) = &volume.transmittance {
                count::shadow();
                shadow = 1.0 - effects.shadows * (1.0 - volume.at(transmittance, self.at(t)));
            }
            if let Some(openness) = &volume.openness {
                count::occlusion();
                open = 1.0 - effects.ambient_occlusion * (1.0 - volume.at(openness, self.at(t)));
            }
        }
        // Shade by the gradient (Blinn-Phong).
        let (mut scale, mut highlight) = (open * shadow, 0.0);
        if let Some(s) = &effects.shading {
            let gradient = self.gradient(self.at(t));
            let size = gradient.length();
            // False for NaN, which leaves the color as it is.
            if size > 0.0 {
                let per_voxel = size * self.field.grid().voxel_length();
                let share = per_voxel / (per_voxel + WEAK_GRADIENT);
                let normal = gradient / size;
                let half = (effects.light - self.ray.direction).normalize_or_zero();
                let diffuse = s.diffuse * normal.dot(effects.light).abs();
                let specular = s.specular * normal.dot(half).abs().powi(s.shininess as i32);
                scale = (1.0 - share) * scale + share * (s.ambient * open + diffuse * shadow);
                highlight = share * specular * shadow;
            }
        }
        // Apply light, then the depth cue.
        if effects.volume.is_some() || effects.shading.is_some() {
            color = color.map(|c| (c * scale + highlight).clamp(0.0, 1.0));
        }
        if let Some((cue, near, far)) = &self.cue {
            let w = cue.strength * ((t - near) / (far - near)).clamp(0.0, 1.0);
            color = std::array::from_fn(|c| color[c] + w * (cue.color[c] - color[c]));
        }
        color
    }

    /// Gradient by central differences over one voxel to either side, per world length.
    fn gradient(&self, at: DVec3) -> DVec3 {
        count::gradient();
        let value = |p: DVec3| f64::from(self.field.sample(p));
        let along = |axis: DVec3| 0.5 * (value(at + axis) - value(at - axis));
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) / self.field.grid().spacing()
    }
}
