//! Effects of a scene, eight rays at a time; counterpart of `reference/effects.rs`.
//!
//! A kernel is compiled twice, without effects and with all of them; effects that a scene lacks are skipped by branches that
//! go the same way for all samples. Sixty-four specialized kernels per voxel type gained nothing more.

mod integration;
mod light;
mod surfaces;

use super::march::VolumeSampler;
use super::rays::{RayPacket, RaySetup};
use super::shaded_sample::ShadedSample;
use crate::volume::effects::{FieldEffects, SHORTEST, cue_range};
use crate::volume::transfer_lut::{OPAQUE, PreintegrationTable, TransferLut};
use crate::{Field, count};
use glam::DVec3;
use lamina_compute::simd::{Lanes, SMALL_OPTICAL_DEPTH, SimdF32, SimdI32, SimdMask, WIDTH, opacity, small_opacity};
use lamina_model::Camera;

/// A source of shaded samples: the transfer function alone, or with effects.
pub(super) trait SampleSource<L: Lanes> {
    /// Prepares for the rays of `packet`, which pass through `pixels`; may shorten them.
    fn begin(&mut self, setup: &RaySetup, pixels: &[(u32, u32)], packet: &mut RayPacket<L>);
    /// Shades step `step`, whose middle lies at row `at` of the table; `None` if it is transparent in all lanes of `live`.
    fn shade(&self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> Option<ShadedSample<L>>;
}

/// Samples without effects.
pub(super) struct TransferSource<'a>(pub &'a TransferLut);

impl<L: Lanes> SampleSource<L> for TransferSource<'_> {
    #[inline(always)]
    fn begin(&mut self, _: &RaySetup, _: &[(u32, u32)], _: &mut RayPacket<L>) {}
    #[inline(always)]
    fn shade(&self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> Option<ShadedSample<L>> {
        ShadedSample::new(self.0, packet, step, at, live)
    }
}

/// The effects of a field for one camera and step length, in units of the kernels: values in table rows, lengths in steps.
pub(super) struct LaneEffects<'a> {
    effects: &'a FieldEffects,
    integral: Option<LanePreintegration>,
    /// Isosurfaces: level in table rows, color, optical depth.
    surfaces: Vec<(f32, [f32; 3], f32)>,
    /// Factors from differences over two voxels, in table rows, to the gradient per voxel length.
    gradient: [f32; 3],
    /// Unit vector towards the light.
    light: [f32; 3],
    /// Steps from the eye to where the depth cue begins, and its increase per step.
    cue: Option<(f64, f32)>,
    colors: Option<LaneColorChannel<'a>>,
}

/// The color field, and its color map.
struct LaneColorChannel<'a> {
    sampler: VolumeSampler<'a>,
    /// Control points: position and color.
    corners: Vec<(f32, [f32; 3])>,
}

/// [`PreintegrationTable`] in single precision, and the exact one.
struct LanePreintegration {
    rows: Vec<[f32; 4]>,
    ends: [[f32; 4]; 2],
    exact: PreintegrationTable,
}

impl<'a> LaneEffects<'a> {
    /// The effects of `field`; `None` if its scene has none.
    pub(super) fn new(field: &'a Field, camera: &Camera, table: &'a TransferLut, step_length: f64) -> Option<Self> {
        let effects = field.effects()?;
        let integral = effects.pre_integrated.then(|| {
            let exact = PreintegrationTable::new(&field.scene().transfer, field.unit_length(), step_length);
            let narrow = |row: [f64; 4]| row.map(|x| x as f32);
            LanePreintegration {
                rows: exact.sums.iter().copied().map(narrow).collect(),
                ends: exact.ends.map(narrow),
                exact,
            }
        });
        let rows = table.bins() as f64;
        let surface = |s: &crate::volume::effects::Surface| {
            (
                (s.at * rows + f64::from(table.below)) as f32,
                s.color.map(|c| c as f32),
                s.optical_depth.min(OPAQUE) as f32,
            )
        };
        let (near, far) = cue_range(field.grid(), camera.position());
        let per_step = |strength: f64| (strength * step_length / (far - near)) as f32;
        Some(Self {
            effects,
            integral,
            surfaces: effects.surfaces.iter().map(surface).collect(),
            gradient: (0.5 * field.grid().voxel_length() / (rows * field.grid().spacing())).as_vec3().to_array(),
            light: effects.light.as_vec3().to_array(),
            cue: effects.cue.map(|cue| (near / step_length, per_step(cue.strength))),
            colors: effects.colors.as_ref().map(|colors| LaneColorChannel {
                sampler: VolumeSampler::of_units(field, &colors.units, table),
                corners: colors.points().iter().map(|p| (p.at as f32, p.color.map(|c| c as f32))).collect(),
            }),
        })
    }
}

/// Samples with effects.
pub(super) struct EffectsSource<'a, L: Lanes> {
    sampler: &'a VolumeSampler<'a>,
    effects: &'a LaneEffects<'a>,
    /// Ends of the part of each ray that is not clipped, in steps from its entry.
    kept: [L::F; 2],
    /// Steps from where the depth cue begins to the entry of each ray.
    entry: L::F,
    /// Half vector between light and eye, of length 1.
    half: [L::F; 3],
}

impl<'a, L: Lanes> EffectsSource<'a, L> {
    /// Samples of `sampler`'s field with `effects`.
    #[inline(always)]
    pub(super) fn new(sampler: &'a VolumeSampler<'a>, effects: &'a LaneEffects<'a>) -> Self {
        let zero = L::F::splat(0.0);
        Self { sampler, effects, kept: [zero; 2], entry: zero, half: [zero; 3] }
    }
}

impl<L: Lanes> SampleSource<L> for EffectsSource<'_, L> {
    #[inline(always)]
    fn begin(&mut self, setup: &RaySetup, pixels: &[(u32, u32)], packet: &mut RayPacket<L>) {
        let effects = self.effects.effects;
        let near = self.effects.cue.map_or(0.0, |(near, _)| near);
        let (mut from, mut to, mut entry) = ([0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]);
        let (mut first, mut end, mut half) = ([0; WIDTH], [0; WIDTH], [[0.0; WIDTH]; 3]);
        let steps = packet.steps.to_array();
        for (l, &(i, j)) in pixels.iter().enumerate().take(WIDTH) {
            if steps[l] == 0 {
                continue;
            }
            // Clip the ray in double precision.
            let world = setup.direction(i, j);
            let (start, direction, rate) = (DVec3::from_array(setup.eye), setup.per_spacing(world), setup.rate(world));
            let enters = packet.entry_at[l];
            let length = f64::from(steps[l] - 1) + f64::from(packet.last_length[l]);
            let (a, b) = effects.clip(start, direction / rate, enters, enters + length);
            (from[l], to[l], entry[l]) = ((a - enters) as f32, (b - enters) as f32, (enters - near) as f32);
            (first[l], end[l]) = ((a - enters) as i32, (b - enters).ceil() as i32);
            let middle = (effects.light - world.normalize()).normalize_or_zero();
            for (half, x) in half.iter_mut().zip(middle.to_array()) {
                half[l] = x as f32;
            }
        }
        packet.first = L::I::from_array(first);
        packet.steps = packet.steps.min(L::I::from_array(end));
        self.kept = [L::F::from_array(from), L::F::from_array(to)];
        self.entry = L::F::from_array(entry);
        self.half = half.map(L::F::from_array);
    }

    #[inline(always)]
    fn shade(&self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> Option<ShadedSample<L>> {
        let s = L::F::splat;
        let (effects, table) = (self.effects.effects, self.sampler.table);
        // Clip the step.
        let k = L::F::from(step);
        let (from, to) = (k.max(self.kept[0]), (k + s(1.0)).min(self.kept[1]));
        let length = to - from;
        let live = live & s(SHORTEST as f32).lt(length);
        if !live.any() {
            return None;
        }
        // Classify the middle of the step.
        let middle = from + s(0.5) * length;
        let at = if effects.half_spaces.is_empty() {
            at
        } else {
            count::value();
            self.sampler.sample::<L>(packet.at(middle))
        };
        let [r, g, b, unit, depth, _] = L::rows6(&table.unit, at);
        let shown = live & table.shown::<L>(at) & s(0.0).lt(unit);
        let straight = s(1.0).div(unit.max(s(f32::MIN_POSITIVE)));
        let mut color =
            [(r * straight).zero_unless(shown), (g * straight).zero_unless(shown), (b * straight).zero_unless(shown)];
        let mut depth = (depth * length).zero_unless(shown);
        // Pre-integrate between the ends of the step.
        let mut ends = [s(0.0); 2];
        if effects.needs_ends() {
            count::value();
            for (end, t) in ends.iter_mut().zip([from, to]) {
                *end = self.sampler.sample::<L>(packet.at(t));
            }
            self.integrate(ends, length, live, &mut color, &mut depth);
        } else if !shown.any() {
            return None;
        }
        // Light the medium and composite it with isosurfaces.
        if s(0.0).lt(depth).any() {
            self.own_color(packet.at(middle), &mut color);
        }
        self.light_and_surfaces(packet, [from, length], ends, live, &mut color, &mut depth);
        // Convert to the unit length.
        let unit = exact_opacity::<L>(depth * s(table.unit_steps).div(length));
        let shown = live & s(0.0).lt(unit);
        if !shown.any() {
            return None;
        }
        let ratio = exact_opacity::<L>(depth).div(unit);
        let color = [color[0] * unit, color[1] * unit, color[2] * unit];
        Some(ShadedSample { shown, color, unit, depth, ratio, length })
    }
}

impl<L: Lanes> EffectsSource<'_, L> {
    /// Replaces `color` by the color field's at position `p`, before lighting, if there is one.
    #[inline(always)]
    fn own_color(&self, p: [L::F; 3], color: &mut [L::F; 3]) {
        let Some(LaneColorChannel { sampler, corners }) = &self.effects.colors else { return };
        count::color();
        let u = sampler.sample::<L>(p);
        // False for NaN.
        let there = L::F::splat(0.0).le(u.abs());
        let mut before = corners[0].0;
        let mut mapped = corners[0].1.map(L::F::splat);
        for &(at, next) in &corners[1..] {
            let w = (u - L::F::splat(before)) * L::F::splat((at - before).recip());
            let w = w.max(L::F::splat(0.0)).min(L::F::splat(1.0));
            for (mapped, next) in mapped.iter_mut().zip(next) {
                *mapped = *mapped + w * (L::F::splat(next) - *mapped);
            }
            before = at;
        }
        for (color, mapped) in color.iter_mut().zip(mapped) {
            *color = L::F::select(there, mapped, *color);
        }
    }
}

/// 1 - exp(-x) without cancellation for small x.
#[inline(always)]
fn exact_opacity<L: Lanes>(x: L::F) -> L::F {
    L::F::select(x.lt(L::F::splat(SMALL_OPTICAL_DEPTH)), small_opacity::<L>(x), opacity::<L>(x))
}
