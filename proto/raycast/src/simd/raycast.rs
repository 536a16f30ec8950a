//! The reference in lanes: the fast twin of `scalar::raycast`.

use super::effects::{Prepared, Source, WithEffects};
use super::march::{Lens, Packet, View, Visit};
use super::tile::Tile;
use crate::Field;
use crate::volume::field::{Stored, for_stored};
use crate::volume::transfer_lut::TransferTable;
use lamina_compute::simd::{Floats, Ints, Job, Lanes, Level, Masks, Pair, WIDTH};
use lamina_model::Camera;
use rayon::prelude::*;

/// A picture to be taken.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// From where.
    pub camera: &'a Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Rays end below this transmittance; 0 never.
    pub floor: f32,
}

/// All pixels of a picture, row by row. The field [fits](super::march::fits).
pub fn raycast(level: Level, field: &Field, shot: &Shot) -> Vec<[f32; 3]> {
    let [width, height] = shot.size;
    if field.effects().is_some() {
        return by_lists(level, field, shot);
    }
    let mut image = vec![[0.0; 3]; width as usize * height as usize];
    let table = table(field);
    let lens = Lens::new(field, shot.camera, shot.size, step_length(field));
    let cast = Cast { lens: &lens, effects: None, floor: shot.floor, background: field.scene().background };
    for_stored!(field.stored(), v => {
        let view = View::new(field, v, &table);
        let band = |(band, out)| level.run(Band { view: &view, cast: &cast, width, first_row: 2 * band as u32, out });
        image.par_chunks_mut(2 * width as usize).enumerate().for_each(band);
    });
    image
}

/// The same, tile by tile as lists of pixels: with effects kernels are long, and one of them is enough.
fn by_lists(level: Level, field: &Field, shot: &Shot) -> Vec<[f32; 3]> {
    let [width, height] = shot.size;
    let rows = (0..height).step_by(Tile::ROWS as usize);
    let tiles = rows.flat_map(|j| Tile::across(width, j, Tile::ROWS.min(height - j)));
    let pixels: Vec<(u32, u32)> = tiles.flat_map(|tile| tile.pixels().to_vec()).collect();
    let mut image = vec![[0.0; 3]; pixels.len()];
    for (color, (i, j)) in raycast_pixels(level, field, shot, &pixels).into_iter().zip(&pixels) {
        image[(j * width + i) as usize] = color;
    }
    image
}

/// The colours of some `pixels` (column, row) of it.
pub fn raycast_pixels(level: Level, field: &Field, shot: &Shot, pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let mut colors = vec![[0.0; 3]; pixels.len()];
    let table = table(field);
    let lens = Lens::new(field, shot.camera, shot.size, step_length(field));
    let effects = Prepared::new(field, shot.camera, &table, step_length(field));
    let (effects, background) = (effects.as_ref(), field.scene().background);
    let cast = Cast { lens: &lens, effects, floor: shot.floor, background };
    for_stored!(field.stored(), v => {
        let view = View::new(field, v, &table);
        let list = |(pixels, out): (&[_], &mut [_])| level.run(List { view: &view, cast: &cast, pixels, out });
        pixels.par_chunks(256).zip(colors.par_chunks_mut(256)).for_each(list);
    });
    colors
}

fn step_length(field: &Field) -> f64 {
    field.scene().step_length(field.grid())
}

fn table(field: &Field) -> TransferTable {
    TransferTable::new(&field.scene().transfer, field.unit_length(), step_length(field))
}

/// Two rows of a picture.
struct Band<'a, V> {
    view: &'a View<'a, V>,
    cast: &'a Cast<'a>,
    width: u32,
    first_row: u32,
    out: &'a mut [[f32; 3]],
}

impl<V: Pair> Job for Band<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let width = self.width;
        for tile in Tile::across(width, self.first_row, self.out.len() as u32 / width) {
            let colors = cast::<L, V>(self.view, self.cast, tile.pixels());
            for (&(i, j), color) in tile.pixels().iter().zip(colors) {
                self.out[((j - self.first_row) * width + i) as usize] = color;
            }
        }
    }
}

/// Pixels here and there.
struct List<'a, V> {
    view: &'a View<'a, V>,
    cast: &'a Cast<'a>,
    pixels: &'a [(u32, u32)],
    out: &'a mut [[f32; 3]],
}

impl<V: Pair> Job for List<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (pixels, out) in self.pixels.chunks(WIDTH).zip(self.out.chunks_mut(WIDTH)) {
            let colors = match self.cast.effects {
                None => cast::<L, V>(self.view, self.cast, pixels),
                Some(effects) => cast_with::<L, V>(self.view, self.cast, effects, pixels),
            };
            out.copy_from_slice(&colors[..out.len()]);
        }
    }
}

/// What all packets of a picture share.
struct Cast<'a> {
    lens: &'a Lens,
    effects: Option<&'a Prepared<'a>>,
    floor: f32,
    background: [f32; 3],
}

#[inline(always)]
fn cast<L: Lanes, V: Pair>(view: &View<V>, cast: &Cast, pixels: &[(u32, u32)]) -> [[f32; 3]; WIDTH] {
    let packet = Packet::<L>::new(cast.lens, pixels);
    let zero = L::F::splat(0.0);
    let mut light =
        Light::<L> { table: view.table, floor: cast.floor, color: [zero; 3], transmittance: L::F::splat(1.0) };
    view.march(&packet, &mut light);
    over::<L>(cast, light.color, light.transmittance)
}

#[inline(always)]
fn cast_with<L: Lanes, V: Pair>(
    view: &View<V>,
    cast: &Cast,
    effects: &Prepared,
    pixels: &[(u32, u32)],
) -> [[f32; 3]; WIDTH] {
    let mut packet = Packet::<L>::new(cast.lens, pixels);
    let mut source = WithEffects::new(view, effects);
    source.begin(cast.lens, pixels, &mut packet);
    let zero = L::F::splat(0.0);
    let mut light = Lit { source, floor: cast.floor, color: [zero; 3], transmittance: L::F::splat(1.0) };
    view.march(&packet, &mut light);
    over::<L>(cast, light.color, light.transmittance)
}

#[inline(always)]
fn over<L: Lanes>(cast: &Cast, color: [L::F; 3], transmittance: L::F) -> [[f32; 3]; WIDTH] {
    let mut pixels = [[0.0; 3]; WIDTH];
    for c in 0..3 {
        let sum = color[c] + transmittance * L::F::splat(cast.background[c]);
        // Sums of what is white may round to a little more than white.
        for (pixel, x) in pixels.iter_mut().zip(sum.min(L::F::splat(1.0)).to_array()) {
            pixel[c] = x;
        }
    }
    pixels
}

/// What eight rays have gathered.
struct Light<'a, L: Lanes> {
    table: &'a TransferTable,
    floor: f32,
    color: [L::F; 3],
    transmittance: L::F,
}

impl<L: Lanes> Visit<L> for Light<'_, L> {
    #[inline(always)]
    fn sample(&mut self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let shown = live & self.table.shown::<L>(at);
        let [r, g, b, mut opacity] = L::rows4(&self.table.step, at);
        let mut color = [r, g, b];
        let last = shown & step.eq(packet.last);
        if last.any() {
            cut_short::<L>(last, &packet.last_length, &mut color, &mut opacity);
        }
        opacity = opacity.only(shown);
        let through = self.transmittance.only(shown);
        self.color[0] = self.color[0] + through * color[0];
        self.color[1] = self.color[1] + through * color[1];
        self.color[2] = self.color[2] + through * color[2];
        self.transmittance = self.transmittance - self.transmittance * opacity;
        live & L::F::splat(self.floor).le(self.transmittance)
    }
}

/// The same with effects.
struct Lit<L: Lanes, S> {
    source: S,
    floor: f32,
    color: [L::F; 3],
    transmittance: L::F,
}

impl<L: Lanes, S: Source<L>> Visit<L> for Lit<L, S> {
    #[inline(always)]
    fn sample(&mut self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let Some(seen) = self.source.seen(packet, step, at, live) else { return live };
        let weight = (self.transmittance * seen.ratio).only(seen.shown);
        self.color[0] = self.color[0] + weight * seen.color[0];
        self.color[1] = self.color[1] + weight * seen.color[1];
        self.color[2] = self.color[2] + weight * seen.color[2];
        self.transmittance = self.transmittance - weight * seen.unit;
        live & L::F::splat(self.floor).le(self.transmittance)
    }
}

/// The opacity of a share of a step, and the premultiplied colour with it. Rare: once a ray.
#[inline(always)]
fn cut_short<L: Lanes>(last: L::M, share: &[f32; WIDTH], color: &mut [L::F; 3], opacity: &mut L::F) {
    let whole = opacity.to_array();
    let part: [f32; WIDTH] = std::array::from_fn(|l| {
        (-(f64::from(share[l]) * (-f64::from(whole[l].clamp(0.0, 1.0))).ln_1p()).exp_m1()) as f32
    });
    // Of nothing there is nothing to take a share of.
    let ratio = std::array::from_fn(|l| if whole[l] > 0.0 { part[l] / whole[l] } else { 0.0 });
    let ratio = L::F::select(last, L::F::from_array(ratio), L::F::splat(1.0));
    *opacity = *opacity * ratio;
    *color = [color[0] * ratio, color[1] * ratio, color[2] * ratio];
}
