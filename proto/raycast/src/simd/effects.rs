//! What a scene asks for, eight rays at a time: the fast twin of `scalar::effects`.
//!
//! A kernel is compiled twice, without effects and with them; with them, what a scene does not ask for is passed over
//! by a branch that goes the same way for all samples. Sixty-four kernels for every kind of voxels would save nothing more.

mod integration;
mod light;
mod surfaces;

use super::generate::Seen;
use super::march::{Lens, Packet, View};
use crate::volume::effects::{Effects, SHORTEST, cue_range};
use crate::volume::transfer_lut::{Integral, OPAQUE, TransferTable};
use crate::{Field, count};
use glam::DVec3;
use lamina_compute::simd::{Floats, Ints, Lanes, Masks, Pair, SMALL, WIDTH, opacity, small_opacity};
use lamina_model::Camera;

/// Where samples come from: from the transfer function alone, or with effects.
pub trait Source<L: Lanes> {
    /// Makes ready for the rays of `packet` through `pixels`.
    fn begin(&mut self, lens: &Lens, pixels: &[(u32, u32)], packet: &mut Packet<L>);
    /// What there is to see at step `step`, whose middle lies at row `at` of the table; `None` if no lane of `live` sees any.
    fn seen(&self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> Option<Seen<L>>;
}

/// No effects.
pub struct Plain<'a>(pub &'a TransferTable);

impl<L: Lanes> Source<L> for Plain<'_> {
    #[inline(always)]
    fn begin(&mut self, _: &Lens, _: &[(u32, u32)], _: &mut Packet<L>) {}
    #[inline(always)]
    fn seen(&self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> Option<Seen<L>> {
        Seen::new(self.0, packet, step, at, live)
    }
}

/// The effects of a field for one camera and step length, as lanes count: values in rows of the table, lengths in steps.
pub struct Prepared<'a> {
    effects: &'a Effects,
    integral: Option<Sums>,
    /// Level, colour, optical depth.
    surfaces: Vec<(f32, [f32; 3], f32)>,
    /// From differences over two voxels, in rows, to the gradient per voxel length.
    gradient: [f32; 3],
    /// Towards the light.
    light: [f32; 3],
    /// Steps from the eye to where colours begin to fade, and how much they do in a step.
    cue: Option<(f64, f32)>,
    colors: Option<Mapped<'a>>,
}

/// A second field, and how it maps to colour.
struct Mapped<'a> {
    view: View<'a, f32>,
    /// Position and colour.
    corners: Vec<(f32, [f32; 3])>,
}

/// [`Integral`] in single precision, and as it is.
struct Sums {
    rows: Vec<[f32; 4]>,
    ends: [[f32; 4]; 2],
    exact: Integral,
}

impl<'a> Prepared<'a> {
    /// `None` if the scene asks for nothing.
    pub fn new(field: &'a Field, camera: &Camera, table: &'a TransferTable, step_length: f64) -> Option<Self> {
        let effects = field.effects()?;
        let integral = effects.pre_integrated.then(|| {
            let exact = Integral::new(&field.scene().transfer, field.unit_length(), step_length);
            let narrow = |row: [f64; 4]| row.map(|x| x as f32);
            Sums { rows: exact.sums.iter().copied().map(narrow).collect(), ends: exact.ends.map(narrow), exact }
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
            colors: effects.colors.as_ref().map(|colors| Mapped {
                view: View::scaled(field, &colors.units, table, [1.0, 0.0]),
                corners: colors.points().iter().map(|p| (p.at as f32, p.color.map(|c| c as f32))).collect(),
            }),
        })
    }
}

/// Samples with effects.
pub struct WithEffects<'a, L: Lanes, V> {
    view: &'a View<'a, V>,
    prepared: &'a Prepared<'a>,
    /// The part of each ray that is not clipped, steps from its entry.
    kept: [L::F; 2],
    /// Steps from where colours begin to fade to the entry.
    entry: L::F,
    /// Halfway between light and eye, length 1.
    half: [L::F; 3],
}

impl<'a, L: Lanes, V: Pair> WithEffects<'a, L, V> {
    /// The effects of `view`'s field.
    #[inline(always)]
    pub fn new(view: &'a View<'a, V>, prepared: &'a Prepared<'a>) -> Self {
        let zero = L::F::splat(0.0);
        Self { view, prepared, kept: [zero; 2], entry: zero, half: [zero; 3] }
    }
}

impl<L: Lanes, V: Pair> Source<L> for WithEffects<'_, L, V> {
    #[inline(always)]
    fn begin(&mut self, lens: &Lens, pixels: &[(u32, u32)], packet: &mut Packet<L>) {
        let effects = self.prepared.effects;
        let near = self.prepared.cue.map_or(0.0, |(near, _)| near);
        let (mut from, mut to, mut entry) = ([0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]);
        let (mut first, mut end, mut half) = ([0; WIDTH], [0; WIDTH], [[0.0; WIDTH]; 3]);
        let steps = packet.steps.to_array();
        for (l, &(i, j)) in pixels.iter().enumerate().take(WIDTH) {
            if steps[l] == 0 {
                continue;
            }
            let world = lens.direction(i, j);
            let (start, direction, rate) = (DVec3::from_array(lens.eye), lens.per_spacing(world), lens.rate(world));
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
    fn seen(&self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> Option<Seen<L>> {
        let s = L::F::splat;
        let (effects, table) = (self.prepared.effects, self.view.table);
        let k = L::F::from(step);
        let (from, to) = (k.max(self.kept[0]), (k + s(1.0)).min(self.kept[1]));
        let length = to - from;
        let live = live & s(SHORTEST as f32).lt(length);
        if !live.any() {
            return None;
        }
        let middle = from + s(0.5) * length;
        let at = if effects.half_spaces.is_empty() {
            at
        } else {
            count::value();
            self.view.sample::<L>(packet.at(middle))
        };
        let [r, g, b, unit, depth, _] = L::rows6(&table.unit, at);
        let shown = live & table.shown::<L>(at) & s(0.0).lt(unit);
        let straight = s(1.0).div(unit.max(s(f32::MIN_POSITIVE)));
        let mut color = [(r * straight).only(shown), (g * straight).only(shown), (b * straight).only(shown)];
        let mut depth = (depth * length).only(shown);
        let mut ends = [s(0.0); 2];
        if effects.needs_ends() {
            count::value();
            for (end, t) in ends.iter_mut().zip([from, to]) {
                *end = self.view.sample::<L>(packet.at(t));
            }
            self.integrate(ends, length, live, &mut color, &mut depth);
        } else if !shown.any() {
            return None;
        }
        if s(0.0).lt(depth).any() {
            self.own_color(packet.at(middle), &mut color);
        }
        self.light_and_surfaces(packet, [from, length], ends, live, &mut color, &mut depth);
        let unit = exact_opacity::<L>(depth * s(table.unit_steps).div(length));
        let shown = live & s(0.0).lt(unit);
        if !shown.any() {
            return None;
        }
        let ratio = exact_opacity::<L>(depth).div(unit);
        let color = [color[0] * unit, color[1] * unit, color[2] * unit];
        Some(Seen { shown, color, unit, depth, ratio, length })
    }
}

impl<L: Lanes, V: Pair> WithEffects<'_, L, V> {
    /// The medium's colour at `p`, before light, where a second field gives it.
    #[inline(always)]
    fn own_color(&self, p: [L::F; 3], color: &mut [L::F; 3]) {
        let Some(Mapped { view, corners }) = &self.prepared.colors else { return };
        count::color();
        let u = view.sample::<L>(p);
        // Fails for NaN.
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

/// 1 - exp(-x), small ones with all their digits.
#[inline(always)]
fn exact_opacity<L: Lanes>(x: L::F) -> L::F {
    L::F::select(x.lt(L::F::splat(SMALL)), small_opacity::<L>(x), opacity::<L>(x))
}
