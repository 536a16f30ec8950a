//! Effects of a scene: the switches of the kernel, and the data it reads.

use super::layout::EffectUniforms;
use super::view::nearest_depth;
use crate::Field;
use crate::volume::effects::cue_range;
use crate::volume::transfer_lut::{OPAQUE, PreintegrationTable};
use bytemuck::Zeroable;
use lamina_model::Camera;

/// The effects that a kernel is compiled with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct EffectSet {
    any: bool,
    clipped: bool,
    pre_integrated: bool,
    surfaces: u32,
    /// Base-2 logarithm of the shininess, if there is shading.
    shaded: Option<u32>,
    shadowed: bool,
    occluded: bool,
    cued: bool,
    colored: bool,
}

impl EffectSet {
    /// The effects of `field`'s scene.
    pub(crate) fn of(field: &Field) -> Self {
        let effects = field.effects();
        let volume = effects.and_then(|e| e.volume.as_ref());
        Self {
            any: effects.is_some(),
            clipped: effects.is_some_and(|e| !e.half_spaces.is_empty()),
            pre_integrated: effects.is_some_and(|e| e.pre_integrated),
            surfaces: effects.map_or(0, |e| e.surfaces.len() as u32),
            shaded: effects.and_then(|e| e.shading).map(|s| s.shininess.trailing_zeros()),
            shadowed: volume.is_some_and(|v| v.transmittance.is_some()),
            occluded: volume.is_some_and(|v| v.openness.is_some()),
            cued: effects.is_some_and(|e| e.cue.is_some()),
            colored: effects.is_some_and(|e| e.colors.is_some()),
        }
    }

    /// The values of the shader's override constants.
    pub(crate) fn constants(self) -> [(&'static str, f64); 10] {
        let on = |b: bool| f64::from(u8::from(b));
        [
            ("EFFECTS", on(self.any)),
            ("CLIPPED", on(self.clipped)),
            ("PRE_INTEGRATED", on(self.pre_integrated)),
            ("SURFACES", self.surfaces.into()),
            ("SHADED", on(self.shaded.is_some())),
            ("SHININESS", self.shaded.unwrap_or(0).into()),
            ("SHADOWED", on(self.shadowed)),
            ("OCCLUDED", on(self.occluded)),
            ("CUED", on(self.cued)),
            ("COLORED", on(self.colored)),
        ]
    }
}

/// The prefix sums of the pre-integration for steps of `step_length` (world units), if the scene asks for it.
pub(crate) fn integral(field: &Field, step_length: f64) -> Option<PreintegrationTable> {
    let asked = field.effects().filter(|e| e.pre_integrated);
    asked.map(|_| PreintegrationTable::new(&field.scene().transfer, field.unit_length(), step_length))
}

/// The prefix sums as the kernel reads them; a row of zeros if there are none.
pub(crate) fn sums(integral: Option<&PreintegrationTable>) -> Vec<[[f32; 4]; 3]> {
    integral.map_or_else(|| vec![[[0.0; 4]; 3]], PreintegrationTable::split)
}

/// The light volume as the kernel reads it, transmittance before openness; a single 0 if there is none.
pub(crate) fn light(field: &Field) -> Vec<f32> {
    let volume = field.effects().and_then(|e| e.volume.as_ref());
    volume.map_or_else(
        || vec![0.0],
        |v| [&v.transmittance, &v.openness].into_iter().flatten().flatten().copied().collect(),
    )
}

/// The effects seen from `camera`, sampled every `step_length` (world units).
pub(crate) fn uniform(
    field: &Field,
    integral: Option<&PreintegrationTable>,
    camera: &Camera,
    step_length: f64,
) -> EffectUniforms {
    let mut out = EffectUniforms::zeroed();
    let Some(effects) = field.effects() else { return out };
    let grid = field.grid();
    out.light = effects.light.as_vec3().to_array();
    (out.shadows, out.occlusion) = (effects.shadows as f32, effects.ambient_occlusion as f32);
    out.spacing = (grid.spacing() / grid.voxel_length()).as_vec3().to_array();
    out.gradient = (0.5 * grid.voxel_length() / grid.spacing()).as_vec3().to_array();
    if let Some(s) = effects.shading {
        (out.ambient, out.diffuse, out.specular) = (s.ambient as f32, s.diffuse as f32, s.specular as f32);
    }
    if let Some(volume) = &effects.volume {
        out.light_dims = volume.dims.map(|d| d as u32);
        out.light_scale = volume.scale.map(|s| s as f32);
        out.light_offset = volume.offset.map(|o| o as f32);
    }
    if let Some(cue) = effects.cue {
        let (near, far) = cue_range(grid, camera.position());
        out.cue = cue.color.map(|c| c as f32);
        out.cue_from = ((nearest_depth(field, camera) - near) / step_length) as f32;
        out.cue_per_step = (cue.strength * step_length / (far - near)) as f32;
        out.cue_strength = cue.strength as f32;
    }
    if let Some(integral) = integral {
        [out.before, out.beyond] = integral.ends.map(|row| row.map(|x| x as f32));
    }
    for (n, s) in effects.surfaces.iter().enumerate() {
        let [r, g, b] = s.color.map(|c| c as f32);
        out.levels[n][0] = s.at as f32;
        out.surfaces[n] = [r, g, b, s.optical_depth.min(OPAQUE) as f32];
    }
    if let Some(colors) = &effects.colors {
        out.color_points = colors.points().len() as u32;
        for (corner, p) in out.color_map.iter_mut().zip(colors.points()) {
            let [r, g, b] = p.color.map(|c| c as f32);
            *corner = [r, g, b, p.at as f32];
        }
    }
    out.planes = effects.half_spaces.len() as u32;
    for (plane, (normal, offset)) in out.half_spaces.iter_mut().zip(&effects.half_spaces) {
        let [x, y, z] = normal.as_vec3().to_array();
        *plane = [x, y, z, *offset as f32];
    }
    out
}
