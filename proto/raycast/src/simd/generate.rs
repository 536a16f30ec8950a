//! VDI generation, eight rays at a time; counterpart of `reference/generate.rs`.

use super::effects::{EffectsSource, LaneEffects, SampleSource, TransferSource};
use super::march::{SampleSink, VolumeSampler};
use super::rays::{RayPacket, RaySetup};
use super::shaded_sample::ShadedSample;
use super::tile::Tile;
use crate::Field;
use crate::vdi::assemble::{RowBand, VdiBuilder, header, in_order};
use crate::vdi::segmentation::Segmenter;
use crate::volume::transfer_lut::TransferLut;
use lamina_compute::simd::{Lanes, Level, SimdF32, SimdI32, SimdKernel, SimdMask, WIDTH, opacity};
use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::{Invalid, Segmentation, Supersegment, Vdi, VdiHeader, VdiParams};
use std::ops::Range;

/// Generates the VDI of `field`, which must [fit](super::march::fits), with `segmentation`.
///
/// # Errors
/// As [`crate::Backend::generate`].
pub fn generate(level: Level, field: &Field, params: &VdiParams, segmentation: Segmentation) -> Result<Vdi, Invalid> {
    let header = header(field.grid(), field.scene(), params)?;
    let fit = Segmenter::new(&header, segmentation, field.unit_length());
    let table = TransferLut::new(&field.scene().transfer, field.unit_length(), header.step_length);
    let rays = VdiRays::new(field, &header);
    let effects = LaneEffects::new(field, &header.camera, &table, header.step_length);
    let effects = effects.as_ref();
    let gamma = fit.initial_gamma(params.gamma()) as f32;
    let mut join = VdiBuilder::new((params.resolution() as usize).pow(2));
    let sampler = VolumeSampler::new(field, &table);
    let rows = |n: usize| {
        let first_row = Tile::ROWS * n as u32;
        let rows = rays
            .empty(first_row)
            .unwrap_or_else(|| level.run(GenerateRows { sampler: &sampler, rays: &rays, effects, gamma, first_row }));
        let mut number = first_row..;
        rows.map(|row| fit.rows(number.next().unwrap_or_default(), row))
    };
    in_order(rays.bands(), rows, |rows: [RowBand; 2]| rows.into_iter().for_each(|row| join.add(row)));
    join.finish(header)
}

/// The rays of a VDI.
pub(super) struct VdiRays {
    /// Their directions.
    pub setup: RaySetup,
    /// Optical depth at which a ray ends; infinite without a cutoff.
    pub cutoff: f32,
    resolution: u32,
    /// Columns and rows of those that may meet the field's own cells.
    met: [Range<u32>; 2],
}

impl VdiRays {
    /// The rays of the VDI with `header`.
    pub(super) fn new(field: &Field, header: &VdiHeader) -> Self {
        let (resolution, cutoff) = (header.params.resolution(), header.params.opacity_cutoff());
        Self {
            setup: RaySetup::new(field, &header.camera, [resolution; 2], header.step_length),
            cutoff: optical_depth_from_opacity(cutoff) as f32,
            resolution,
            met: field.grid_part().pixels(field.grid(), &header.camera, resolution),
        }
    }

    /// Number of pairs of rows.
    pub(super) fn bands(&self) -> usize {
        self.resolution.div_ceil(Tile::ROWS) as usize
    }

    /// Rows without a supersegment, if no ray of the pair of rows that starts at `first_row` meets the field.
    fn empty(&self, first_row: u32) -> Option<[RowBand; 2]> {
        let [_, rows] = &self.met;
        let end = self.resolution.min(first_row + Tile::ROWS);
        let row = |j: u32| if j < end { vec![0; self.resolution as usize] } else { Vec::new() };
        let band = |j: u32| RowBand { counts: row(j), segments: Vec::new() };
        (end <= rows.start || first_row >= rows.end).then(|| [band(first_row), band(first_row + 1)])
    }

    /// True if no ray of `tile` meets the field.
    #[inline(always)]
    fn misses(&self, tile: &Tile) -> bool {
        let [columns, _] = &self.met;
        let (first, last) = (tile.pixels()[0].0, tile.pixels()[tile.pixels().len() - 1].0);
        last < columns.start || first >= columns.end
    }

    /// The tiles of the pair of rows that starts at `first_row`.
    #[inline(always)]
    pub(super) fn tiles(&self, first_row: u32) -> impl Iterator<Item = Tile> + use<> {
        Tile::across(self.resolution, first_row, Tile::ROWS.min(self.resolution - first_row))
    }
}

/// Kernel: two rows of rays.
struct GenerateRows<'a> {
    sampler: &'a VolumeSampler<'a>,
    rays: &'a VdiRays,
    effects: Option<&'a LaneEffects<'a>>,
    gamma: f32,
    first_row: u32,
}

impl SimdKernel for GenerateRows<'_> {
    type Output = [RowBand; 2];
    #[inline(always)]
    fn run<L: Lanes>(self) -> [RowBand; 2] {
        match self.effects {
            None => self.cluster::<L>(TransferSource(self.sampler.table)),
            Some(effects) => self.cluster::<L>(EffectsSource::new(self.sampler, effects)),
        }
    }
}

impl GenerateRows<'_> {
    #[inline(always)]
    fn cluster<L: Lanes>(&self, source: impl SampleSource<L>) -> [RowBand; 2] {
        let mut rows = [RowBand::default(), RowBand::default()];
        let mut cluster = SegmentClusterer::new(source, self.sampler.table.unit_steps, self.gamma, self.rays.cutoff);
        for tile in self.rays.tiles(self.first_row) {
            if self.rays.misses(&tile) {
                tile.pixels().iter().for_each(|&(_, j)| rows[(j - self.first_row) as usize].counts.push(0));
                continue;
            }
            let mut packet = RayPacket::<L>::new(&self.rays.setup, tile.pixels());
            cluster.source.begin(&self.rays.setup, tile.pixels(), &mut packet);
            self.sampler.march(&packet, &mut cluster);
            cluster.finish();
            cluster.closed.hand_over(tile.pixels().iter().map(|&(_, j)| (j - self.first_row) as usize), &mut rows);
        }
        rows
    }
}

/// Clusters the samples of eight rays: eight open supersegments, and the closed ones.
struct SegmentClusterer<L: Lanes, S> {
    source: S,
    gamma: f32,
    /// Steps in a unit length.
    unit_steps: f32,
    /// Optical depth at which a ray ends.
    cutoff: f32,
    start: L::I,
    /// First step beyond the open supersegment; -1 if none is open.
    end: L::I,
    /// Length in steps.
    length: L::F,
    /// Accumulated opacity and premultiplied color: sums of contributions, so that faint ones keep their digits.
    opacity: L::F,
    color: [L::F; 3],
    optical_depth: L::F,
    /// Opacity of the open supersegment at unit length.
    unit: L::F,
    /// Optical depth of the whole ray so far.
    ray_depth: L::F,
    closed: ClosedSegments,
}

impl<L: Lanes, S: SampleSource<L>> SegmentClusterer<L, S> {
    #[inline(always)]
    fn new(source: S, unit_steps: f32, gamma: f32, cutoff: f32) -> Self {
        let zero = L::F::splat(0.0);
        Self {
            source,
            gamma,
            unit_steps,
            cutoff,
            start: L::I::splat(0),
            end: L::I::splat(-1),
            length: L::F::splat(1.0),
            opacity: zero,
            color: [zero; 3],
            optical_depth: zero,
            unit: zero,
            ray_depth: zero,
            closed: ClosedSegments::default(),
        }
    }

    /// Closes the open supersegments of `lanes`.
    #[inline(always)]
    fn close(&mut self, lanes: L::M) {
        self.closed.records.push(ClosedRecord {
            lanes: lanes.bits() as u8,
            start: self.start.to_array(),
            end: self.end.to_array(),
            opacity: self.opacity.to_array(),
            color: [self.color[0].to_array(), self.color[1].to_array(), self.color[2].to_array()],
            optical_depth: self.optical_depth.to_array(),
        });
    }

    /// Closes all open supersegments and resets the state for the next packet.
    #[inline(always)]
    fn finish(&mut self) {
        self.close(self.end.gt(L::I::splat(0)));
        self.end = L::I::splat(-1);
        self.ray_depth = L::F::splat(0.0);
    }
}

/// The state of all lanes at a step where some supersegments closed.
struct ClosedRecord {
    lanes: u8,
    start: [i32; WIDTH],
    end: [i32; WIDTH],
    opacity: [f32; WIDTH],
    color: [[f32; WIDTH]; 3],
    optical_depth: [f32; WIDTH],
}

/// Closed supersegments of a packet, in order.
#[derive(Default)]
struct ClosedSegments {
    records: Vec<ClosedRecord>,
}

impl ClosedSegments {
    /// Appends each ray's list to its row and clears them. `row_of` gives the row of each lane.
    fn hand_over(&mut self, row_of: impl Iterator<Item = usize>, rows: &mut [RowBand; 2]) {
        let mut counts = [0; WIDTH];
        for record in &self.records {
            for (l, count) in counts.iter_mut().enumerate() {
                *count += usize::from(record.lanes >> l & 1);
            }
        }
        // Position at which each lane's list continues: lists of one row follow each other.
        let (mut place, mut row) = ([0; WIDTH], [0; WIDTH]);
        for (l, r) in row_of.enumerate() {
            let band = &mut rows[r];
            (place[l], row[l]) = (band.segments.len(), r);
            band.counts.push(counts[l] as u32);
            band.segments.resize(place[l] + counts[l], NONE);
        }
        for record in self.records.drain(..) {
            let mut lanes = record.lanes;
            while lanes != 0 {
                let l = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                rows[row[l]].segments[place[l]] = record.supersegment(l);
                place[l] += 1;
            }
        }
    }
}

const NONE: Supersegment = Supersegment { start: 0, end: 0, color: [0.0; 3], optical_depth: 0.0 };

impl ClosedRecord {
    #[inline(always)]
    fn supersegment(&self, l: usize) -> Supersegment {
        let straight = reciprocal(self.opacity[l]);
        Supersegment {
            start: self.start[l] as u32,
            end: self.end[l] as u32,
            color: self.color.map(|c| (c[l] * straight).clamp(0.0, 1.0)),
            optical_depth: self.optical_depth[l],
        }
    }
}

impl<L: Lanes, S: SampleSource<L>> SampleSink<L> for SegmentClusterer<L, S> {
    #[inline(always)]
    fn sample(&mut self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let Some(ShadedSample { shown, color: [r, g, b], unit, depth, ratio, length }) =
            self.source.shade(packet, step, at, live)
        else {
            return live;
        };
        // Compare the open supersegment and the sample at unit length, both times the open one's opacity, which saves a division.
        let open = self.unit;
        let difference = ((open - unit) * self.opacity).abs();
        let difference = difference.max((self.color[0] * open - r * self.opacity).abs());
        let difference = difference.max((self.color[1] * open - g * self.opacity).abs());
        let difference = difference.max((self.color[2] * open - b * self.opacity).abs());
        let alike = difference.lt(L::F::splat(self.gamma) * self.opacity);
        // Close the supersegments that the sample does not join.
        let joins = shown & self.end.eq(step) & alike;
        let begins = shown & !joins;
        let closes = begins & self.end.gt(L::I::splat(0));
        if closes.any() {
            self.close(closes);
        }
        // Add the sample to lanes that keep their supersegment, start a new one in others; masks make both one expression.
        let kept = !begins;
        let shows = (L::F::splat(1.0) - self.opacity.zero_unless(kept)) * ratio.zero_unless(shown);
        self.color[0] = self.color[0].zero_unless(kept) + shows * r;
        self.color[1] = self.color[1].zero_unless(kept) + shows * g;
        self.color[2] = self.color[2].zero_unless(kept) + shows * b;
        self.opacity = self.opacity.zero_unless(kept) + shows * unit;
        // Compute the unit opacity for the case that the next sample joins, ahead of time, to shorten the dependency chain.
        let (depths, lengths) = (self.optical_depth + depth, self.length + length);
        let joined = opacity::<L>(depths * L::F::splat(self.unit_steps).div(lengths));
        self.unit = L::F::select(joins, joined, L::F::select(begins, unit, self.unit));
        self.length = self.length.zero_unless(kept) + length.zero_unless(shown);
        self.optical_depth = self.optical_depth.zero_unless(kept) + depth.zero_unless(shown);
        self.start = L::I::select(begins, step, self.start);
        self.end = L::I::select(shown, step + L::I::splat(1), self.end);
        if self.cutoff == f32::INFINITY {
            return live;
        }
        self.ray_depth = self.ray_depth + depth.zero_unless(shown);
        live & self.ray_depth.lt(L::F::splat(self.cutoff))
    }
}

/// 1 / `opacity`, or 0 where that overflows: such a supersegment becomes black rather than NaN.
#[inline(always)]
pub(super) fn reciprocal(opacity: f32) -> f32 {
    if opacity > f32::MIN_POSITIVE { 1.0 / opacity } else { 0.0 }
}
