//! What a scene asks for, eight rays at a time: the fast twin of `scalar::effects`.
//!
//! A kernel is compiled twice, without effects and with them; with them, what a scene does not ask for is passed over
//! by a branch that goes the same way for all samples. Sixty-four kernels for every kind of voxels would save nothing more.

use super::generate::Seen;
use super::march::{Lens, Packet, View};
use crate::effects::{Effects, FEWEST_ROWS, SHORTEST, WEAK_GRADIENT, cue_range};
use crate::table::{Integral, OPAQUE, TransferTable};
use crate::{Field, count};
use glam::DVec3;
use lamina_lanes::{Floats, Ints, Lanes, Masks, Pair, SMALL, WIDTH, opacity, small_opacity};
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
        let surface = |s: &crate::effects::Surface| {
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

    /// Where the ends of a step are apart, what the transfer function comes to between them.
    #[inline(always)]
    fn integrate(&self, [u, v]: [L::F; 2], length: L::F, live: L::M, color: &mut [L::F; 3], depth: &mut L::F) {
        let s = L::F::splat;
        let Some(Sums { rows: sums, ends: outside, exact }) = &self.prepared.integral else { return };
        let apart = live & s(FEWEST_ROWS as f32).le((v - u).abs());
        if !apart.any() {
            return;
        }
        let (u, v) = (u - s(self.view.table.below as f32), v - s(self.view.table.below as f32));
        let last = s((sums.len() - 1) as f32);
        let (mut low, mut high) = (L::rows4(sums, u), L::rows4(sums, v));
        for (row, x) in [(&mut low, u), (&mut high, v)] {
            let (before, beyond) = (x.min(s(0.0)), (x - last).max(s(0.0)));
            for c in 0..4 {
                row[c] = row[c] + before * s(outside[0][c]) + beyond * s(outside[1][c]);
            }
        }
        let whole = (high[3] - low[3]).div(v - u);
        let straight = s(1.0).div((high[3] - low[3]).abs().max(s(f32::MIN_POSITIVE)));
        let sign = L::F::select(u.lt(v), straight, s(0.0) - straight);
        for c in 0..3 {
            let mean = ((high[c] - low[c]) * sign).max(s(0.0)).min(s(1.0));
            color[c] = L::F::select(apart, mean, color[c]);
        }
        *depth = L::F::select(apart, (whole * length).max(s(0.0)), *depth);
        // Behind an opaque part of the range single precision has no digits left for a faint one; beyond all that shows there
        // is nothing to look for.
        let lost = apart & (high[3] - low[3]).abs().lt(high[3].max(low[3]) * s(1e-4));
        let lost = lost & u.min(v).le(s(self.view.table.visible[1]));
        if lost.any() {
            let mut arrays = (color.map(|c| c.to_array()), depth.to_array());
            exactly(exact, [u.to_array(), v.to_array()], length.to_array(), lost.bits(), &mut arrays);
            (*color, *depth) = (arrays.0.map(L::F::from_array), L::F::from_array(arrays.1));
        }
    }

    /// Lights the middle of a step, and puts the surfaces crossed between both `ends` into it. One loop, first the medium
    /// and then each surface, so that the code of light is there once.
    #[inline(always)]
    fn light_and_surfaces(
        &self,
        packet: &Packet<L>,
        [from, length]: [L::F; 2],
        [u, v]: [L::F; 2],
        live: L::M,
        color: &mut [L::F; 3],
        depth: &mut L::F,
    ) {
        let s = L::F::splat;
        let surfaces = &self.prepared.surfaces;
        let falls = v.lt(u);
        let (mut sum, mut through, mut at, mut met) = ([s(0.0); 3], s(1.0), s(0.0), s(0.0));
        let mut crossed = live & !live;
        for n in 0..=surfaces.len() {
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
                surface = L::F::select(falls, s(falling.2), s(rising.2)).only(hit);
            }
            self.light(packet, from + share * length, &mut own);
            if n == 0 {
                *color = own;
                continue;
            }
            // What of the medium lies before the surface, then the surface.
            let before = exact_opacity::<L>(*depth * (share - at).max(s(0.0))).only(hit);
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

    /// Where between both ends the field crosses `level`, as a share of the step.
    #[inline(always)]
    fn crossing(&self, packet: &Packet<L>, [from, length]: [L::F; 2], [u, v]: [L::F; 2], level: L::F) -> L::F {
        let s = L::F::splat;
        let first = (level - u).div(v - u);
        let w = self.view.sample::<L>(packet.at(from + first * length));
        let behind = (w.lt(level) & u.lt(level)) | (level.le(w) & level.le(u));
        let (x, y) = (L::F::select(behind, first, s(0.0)), L::F::select(behind, s(1.0), first));
        let (p, q) = (L::F::select(behind, w, u), L::F::select(behind, v, w));
        let second = (x + (level - p).div(q - p) * (y - x)).max(s(0.0)).min(s(1.0));
        // Fails where the field ends there, or is flat.
        L::F::select(s(0.0).lt((q - p).abs()), second, first)
    }

    /// Straight colours as light and distance let them be seen `t` steps from the entry.
    #[inline(always)]
    fn light(&self, packet: &Packet<L>, t: L::F, color: &mut [L::F; 3]) {
        let s = L::F::splat;
        let (effects, prepared) = (self.prepared.effects, self.prepared);
        let p = packet.at(t);
        let (mut shadow, mut open) = (s(1.0), s(1.0));
        if let Some(volume) = &effects.volume {
            // Every axis has a cell here: nothing is offset.
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
        let (mut scale, mut highlight) = (open * shadow, s(0.0));
        if let Some(shading) = &effects.shading {
            count::gradient();
            let g = self.gradient(p);
            let size = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
            let sloped = s(0.0).lt(size);
            let share = size.div(size + s(WEAK_GRADIENT as f32)).only(sloped);
            let along = s(1.0).div(size.max(s(f32::MIN_POSITIVE)));
            let light = prepared.light;
            let toward = (g[0] * s(light[0]) + g[1] * s(light[1]) + g[2] * s(light[2])) * along;
            let mut gloss = ((g[0] * self.half[0] + g[1] * self.half[1] + g[2] * self.half[2]) * along).abs();
            for _ in 0..shading.shininess.trailing_zeros() {
                gloss = gloss * gloss;
            }
            let lit = s(shading.ambient as f32) * open + s(shading.diffuse as f32) * toward.abs() * shadow;
            let mixed = (s(1.0) - share) * scale + share * lit;
            scale = L::F::select(sloped, mixed, scale);
            highlight = (share * s(shading.specular as f32) * gloss * shadow).only(sloped);
        }
        if effects.volume.is_some() || effects.shading.is_some() {
            for c in color.iter_mut() {
                *c = (*c * scale + highlight).max(s(0.0)).min(s(1.0));
            }
        }
        if let (Some((_, per_step)), Some(cue)) = (prepared.cue, &effects.cue) {
            let w = ((self.entry + t) * s(per_step)).max(s(0.0)).min(s(cue.strength as f32));
            for (c, far) in color.iter_mut().zip(cue.color) {
                *c = *c + w * (s(far as f32) - *c);
            }
        }
    }

    /// Central differences over a voxel to either side, shares of the range per voxel length.
    #[inline(always)]
    fn gradient(&self, p: [L::F; 3]) -> [L::F; 3] {
        let mut gradient = [L::F::splat(0.0); 3];
        for side in [-1.0, 1.0] {
            for a in 0..3 {
                let mut q = p;
                q[a] = q[a] + L::F::splat(side);
                let scale = L::F::splat(side * self.prepared.gradient[a]);
                gradient[a] = gradient[a] + scale * self.view.sample::<L>(q);
            }
        }
        gradient
    }
}

/// Colours and depths of steps between rows `u` and `v`, in double precision, for the lanes whose bits are set.
fn exactly(
    exact: &Integral,
    [u, v]: [[f32; WIDTH]; 2],
    length: [f32; WIDTH],
    lanes: u32,
    (colors, depths): &mut ([[f32; WIDTH]; 3], [f32; WIDTH]),
) {
    let rows = exact.bins() as f64;
    for l in (0..WIDTH).filter(|l| lanes >> l & 1 == 1) {
        let (color, whole) = exact.between(f64::from(u[l]) / rows, f64::from(v[l]) / rows);
        colors.iter_mut().zip(color).for_each(|(out, c)| out[l] = c.clamp(0.0, 1.0) as f32);
        depths[l] = whole as f32 * length[l];
    }
}

/// 1 - exp(-x), small ones with all their digits.
#[inline(always)]
fn exact_opacity<L: Lanes>(x: L::F) -> L::F {
    L::F::select(x.lt(L::F::splat(SMALL)), small_opacity::<L>(x), opacity::<L>(x))
}

/// A field on the coarse grid, interpolated trilinearly at `q`, in its own units; clamped into it.
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
        // SAFETY: cells are at most dims - 2 on every axis, so with a row, a slice, or both added, and one more, an
        // index lies inside.
        #[expect(unsafe_code, reason = "indices were clamped at once")]
        let (a, b) = unsafe { L::pairs(&field[offset..], &index) };
        *corner = a + w[0] * (b - a);
    }
    let [near, far] = [corners[0] + w[1] * (corners[1] - corners[0]), corners[2] + w[1] * (corners[3] - corners[2])];
    near + w[2] * (far - near)
}
