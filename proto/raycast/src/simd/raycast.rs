//! Ray casting, eight rays at a time; counterpart of `reference/raycast.rs`.

use super::effects::{EffectsSource, LaneEffects, SampleSource};
use super::march::{SampleSink, VolumeSampler};
use super::rays::{RayPacket, RaySetup};
use super::tile::Tile;
use crate::Field;
use crate::volume::transfer_lut::TransferLut;
use lamina_compute::simd::{Lanes, Level, SimdF32, SimdI32, SimdKernel, SimdMask, WIDTH};
use lamina_model::Camera;
use rayon::prelude::*;

/// View of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// Camera.
    pub camera: &'a Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Transmittance below which rays end; 0 for never.
    pub floor: f32,
}

/// Casts all pixels of a picture, row by row. The field must [fit](super::march::fits).
pub fn raycast(level: Level, field: &Field, shot: &Shot) -> Vec<[f32; 3]> {
    let [width, height] = shot.size;
    if field.effects().is_some() {
        return by_lists(level, field, shot);
    }
    let mut image = vec![[0.0; 3]; width as usize * height as usize];
    let table = table(field);
    let setup = RaySetup::new(field, shot.camera, shot.size, step_length(field));
    let cast = CastParams { setup: &setup, effects: None, floor: shot.floor };
    let background = field.scene().background;
    let sampler = VolumeSampler::new(field, &table);
    let band = |(band, out)| {
        level.run(PictureBand { sampler: &sampler, cast: &cast, background, width, first_row: 2 * band as u32, out })
    };
    image.par_chunks_mut(2 * width as usize).enumerate().for_each(band);
    image
}

/// Casts a picture by lists of pixels, tile by tile: kernels with effects are large, and this compiles only one of them.
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

/// Casts some `pixels` (column, row) of the picture; returns their colors in order.
pub fn raycast_pixels(level: Level, field: &Field, shot: &Shot, pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let background = field.scene().background;
    // Sums for white may round to slightly more than 1.
    let over = |[r, g, b, transmittance]: [f32; 4]| {
        std::array::from_fn(|c| ([r, g, b][c] + transmittance * background[c]).min(1.0))
    };
    raycast_layers(level, field, shot, pixels).into_iter().map(over).collect()
}

/// The same without a background: premultiplied color and transmittance of what the field has in its own cells.
pub fn raycast_layers(level: Level, field: &Field, shot: &Shot, pixels: &[(u32, u32)]) -> Vec<[f32; 4]> {
    let mut layers = vec![[0.0; 4]; pixels.len()];
    let table = table(field);
    let setup = RaySetup::new(field, shot.camera, shot.size, step_length(field));
    let effects = LaneEffects::new(field, shot.camera, &table, step_length(field));
    let effects = effects.as_ref();
    let cast = CastParams { setup: &setup, effects, floor: shot.floor };
    let sampler = VolumeSampler::new(field, &table);
    let list = |(pixels, out): (&[_], &mut [_])| level.run(PixelList { sampler: &sampler, cast: &cast, pixels, out });
    pixels.par_chunks(256).zip(layers.par_chunks_mut(256)).for_each(list);
    layers
}

fn step_length(field: &Field) -> f64 {
    field.scene().step_length(field.grid())
}

fn table(field: &Field) -> TransferLut {
    TransferLut::new(&field.scene().transfer, field.unit_length(), step_length(field))
}

/// Kernel: two rows of a picture.
struct PictureBand<'a> {
    sampler: &'a VolumeSampler<'a>,
    cast: &'a CastParams<'a>,
    background: [f32; 3],
    width: u32,
    first_row: u32,
    out: &'a mut [[f32; 3]],
}

impl SimdKernel for PictureBand<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let width = self.width;
        for tile in Tile::across(width, self.first_row, self.out.len() as u32 / width) {
            let (color, transmittance) = cast::<L>(self.sampler, self.cast, tile.pixels());
            let colors = over::<L>(color, transmittance, self.background);
            for (&(i, j), color) in tile.pixels().iter().zip(colors) {
                self.out[((j - self.first_row) * width + i) as usize] = color;
            }
        }
    }
}

/// Kernel: a list of pixels.
struct PixelList<'a> {
    sampler: &'a VolumeSampler<'a>,
    cast: &'a CastParams<'a>,
    pixels: &'a [(u32, u32)],
    out: &'a mut [[f32; 4]],
}

impl SimdKernel for PixelList<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (pixels, out) in self.pixels.chunks(WIDTH).zip(self.out.chunks_mut(WIDTH)) {
            let ([r, g, b], transmittance) = match self.cast.effects {
                None => cast::<L>(self.sampler, self.cast, pixels),
                Some(effects) => cast_with::<L>(self.sampler, self.cast, effects, pixels),
            };
            let layers = [r.to_array(), g.to_array(), b.to_array(), transmittance.to_array()];
            for (l, layer) in out.iter_mut().enumerate() {
                *layer = layers.map(|values| values[l]);
            }
        }
    }
}

/// Parameters that all packets of a picture share.
struct CastParams<'a> {
    setup: &'a RaySetup,
    effects: Option<&'a LaneEffects<'a>>,
    floor: f32,
}

/// Premultiplied color and transmittance of eight rays.
type Layers<L> = ([<L as Lanes>::F; 3], <L as Lanes>::F);

#[inline(always)]
fn cast<L: Lanes>(sampler: &VolumeSampler, cast: &CastParams, pixels: &[(u32, u32)]) -> Layers<L> {
    let packet = RayPacket::<L>::new(cast.setup, pixels);
    let zero = L::F::splat(0.0);
    let mut sum = ColorAccumulator::<L> {
        table: sampler.table,
        floor: cast.floor,
        color: [zero; 3],
        transmittance: L::F::splat(1.0),
    };
    sampler.march(&packet, &mut sum);
    (sum.color, sum.transmittance)
}

#[inline(always)]
fn cast_with<L: Lanes>(
    sampler: &VolumeSampler,
    cast: &CastParams,
    effects: &LaneEffects,
    pixels: &[(u32, u32)],
) -> Layers<L> {
    let mut packet = RayPacket::<L>::new(cast.setup, pixels);
    let mut source = EffectsSource::new(sampler, effects);
    source.begin(cast.setup, pixels, &mut packet);
    let zero = L::F::splat(0.0);
    let mut sum = ShadedAccumulator { source, floor: cast.floor, color: [zero; 3], transmittance: L::F::splat(1.0) };
    sampler.march(&packet, &mut sum);
    (sum.color, sum.transmittance)
}

#[inline(always)]
fn over<L: Lanes>(color: [L::F; 3], transmittance: L::F, background: [f32; 3]) -> [[f32; 3]; WIDTH] {
    let mut pixels = [[0.0; 3]; WIDTH];
    for c in 0..3 {
        let sum = color[c] + transmittance * L::F::splat(background[c]);
        // Sums for white may round to slightly more than 1.
        for (pixel, x) in pixels.iter_mut().zip(sum.min(L::F::splat(1.0)).to_array()) {
            pixel[c] = x;
        }
    }
    pixels
}

/// Accumulated color and transmittance of eight rays, front to back.
struct ColorAccumulator<'a, L: Lanes> {
    table: &'a TransferLut,
    floor: f32,
    color: [L::F; 3],
    transmittance: L::F,
}

impl<L: Lanes> SampleSink<L> for ColorAccumulator<'_, L> {
    #[inline(always)]
    fn sample(&mut self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let shown = live & self.table.shown::<L>(at);
        let [r, g, b, mut opacity] = L::rows4(&self.table.step, at);
        let mut color = [r, g, b];
        let last = shown & step.eq(packet.last);
        if last.any() {
            cut_short::<L>(last, &packet.last_length, &mut color, &mut opacity);
        }
        opacity = opacity.zero_unless(shown);
        let through = self.transmittance.zero_unless(shown);
        self.color[0] = self.color[0] + through * color[0];
        self.color[1] = self.color[1] + through * color[1];
        self.color[2] = self.color[2] + through * color[2];
        self.transmittance = self.transmittance - self.transmittance * opacity;
        live & L::F::splat(self.floor).le(self.transmittance)
    }
}

/// Accumulated color and transmittance of eight rays with effects.
struct ShadedAccumulator<L: Lanes, S> {
    source: S,
    floor: f32,
    color: [L::F; 3],
    transmittance: L::F,
}

impl<L: Lanes, S: SampleSource<L>> SampleSink<L> for ShadedAccumulator<L, S> {
    #[inline(always)]
    fn sample(&mut self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let Some(seen) = self.source.shade(packet, step, at, live) else { return live };
        let weight = (self.transmittance * seen.ratio).zero_unless(seen.shown);
        self.color[0] = self.color[0] + weight * seen.color[0];
        self.color[1] = self.color[1] + weight * seen.color[1];
        self.color[2] = self.color[2] + weight * seen.color[2];
        self.transmittance = self.transmittance - weight * seen.unit;
        live & L::F::splat(self.floor).le(self.transmittance)
    }
}

/// Scales opacity and premultiplied color to a part of a step, for the lanes in `last`. Needed once per ray.
#[inline(always)]
fn cut_short<L: Lanes>(last: L::M, share: &[f32; WIDTH], color: &mut [L::F; 3], opacity: &mut L::F) {
    let whole = opacity.to_array();
    let part: [f32; WIDTH] = std::array::from_fn(|l| {
        (-(f64::from(share[l]) * (-f64::from(whole[l].clamp(0.0, 1.0))).ln_1p()).exp_m1()) as f32
    });
    // A transparent step stays transparent.
    let ratio = std::array::from_fn(|l| if whole[l] > 0.0 { part[l] / whole[l] } else { 0.0 });
    let ratio = L::F::select(last, L::F::from_array(ratio), L::F::splat(1.0));
    *opacity = *opacity * ratio;
    *color = [color[0] * ratio, color[1] * ratio, color[2] * ratio];
}
