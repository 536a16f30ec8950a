//! VDI generation for many gammas in a single march, whose samples are clustered once for every gamma.
//!
//! Sampling is most of the cost of a VDI, and all gammas share it. They share clustering too: gammas whose open supersegments
//! start at the same step have identical ones, so they share one state, and one comparison with the next sample decides for
//! all of them. Gammas that the sample does not join leave the state and meet in the state that starts at that sample. The
//! results equal those of one generation per gamma, bit for bit.

use super::generate::{VdiRays, reciprocal};
use super::march::{SampleSink, VolumeSampler};
use super::rays::RayPacket;
use super::shaded_sample::ShadedSample;
use super::tile::Tile;
use crate::Field;
use crate::vdi::assemble::{RowBand, VdiBuilder, header, in_order};
use crate::vdi::segmentation::Segmenter;
use crate::volume::transfer_lut::TransferLut;
use lamina_compute::simd::{Lanes, Level, SimdF32, SimdI32, SimdKernel, SimdMask, WIDTH, opacity};
use lamina_model::{Invalid, Segmentation, Supersegment, Vdi, VdiParams};

/// The most gammas of one march: one bit each.
pub const MOST_GAMMAS: usize = 128;

/// Generates the VDI of `field`, which must [fit](super::march::fits), for each of `gammas` (ascending, at most
/// [`MOST_GAMMAS`]) with `segmentation`; the other parameters are those of `params`.
///
/// # Errors
/// As [`super::generate`].
pub fn generate_all(
    level: Level,
    field: &Field,
    params: &VdiParams,
    gammas: &[f64],
    segmentation: Segmentation,
) -> Result<Vec<Vdi>, Invalid> {
    assert!(gammas.len() <= MOST_GAMMAS && gammas.is_sorted());
    let headers: Vec<_> = gammas
        .iter()
        .map(|&gamma| header(field.grid(), field.scene(), &params.with_gamma(gamma)?))
        .collect::<Result<_, _>>()?;
    let Some(first) = headers.first() else { return Ok(Vec::new()) };
    let table = TransferLut::new(&field.scene().transfer, field.unit_length(), first.step_length);
    let rays = VdiRays::new(field, first);
    let fits: Vec<Segmenter> = headers.iter().map(|h| Segmenter::new(h, segmentation, field.unit_length())).collect();
    let gammas: Vec<f32> = gammas.iter().zip(&fits).map(|(&g, fit)| fit.initial_gamma(g) as f32).collect();
    // No capacity is reserved: of many VDIs only a few outgrow it.
    let mut joins: Vec<VdiBuilder> = gammas.iter().map(|_| VdiBuilder::new(0)).collect();
    let sampler = VolumeSampler::new(field, &table);
    let rows = |n: usize| {
        let first_row = Tile::ROWS * n as u32;
        let rows = level.run(GenerateAllRows { sampler: &sampler, rays: &rays, gammas: &gammas, first_row });
        let mut number = first_row..;
        rows.map(|row| {
            let j = number.next().unwrap_or_default();
            row.into_iter().zip(&fits).map(|(band, fit)| fit.rows(j, band)).collect::<Vec<RowBand>>()
        })
    };
    in_order(rays.bands(), rows, |rows: [Vec<RowBand>; 2]| {
        for row in rows {
            row.into_iter().zip(&mut joins).for_each(|(band, join)| join.add(band));
        }
    });
    drop(fits);
    joins.into_iter().zip(headers).map(|(join, header)| join.finish(header)).collect()
}

/// Kernel: two rows of rays, for each gamma.
struct GenerateAllRows<'a> {
    sampler: &'a VolumeSampler<'a>,
    rays: &'a VdiRays,
    gammas: &'a [f32],
    first_row: u32,
}

impl SimdKernel for GenerateAllRows<'_> {
    type Output = [Vec<RowBand>; 2];
    #[inline(always)]
    fn run<L: Lanes>(self) -> [Vec<RowBand>; 2] {
        let mut rows = [0, 1].map(|_| self.gammas.iter().map(|_| RowBand::default()).collect::<Vec<_>>());
        let mut clusters = MultiGammaClusterer {
            table: self.sampler.table,
            gammas: self.gammas,
            cutoff: self.rays.cutoff,
            ray_depth: L::F::splat(0.0),
            states: std::array::from_fn(|_| OpenSegments::new()),
            closed: Default::default(),
        };
        for tile in self.rays.tiles(self.first_row) {
            let packet = RayPacket::<L>::new(&self.rays.setup, tile.pixels());
            clusters.ray_depth = L::F::splat(0.0);
            self.sampler.march(&packet, &mut clusters);
            for (l, &(_, j)) in tile.pixels().iter().enumerate() {
                clusters.states[l].close_all(&mut clusters.closed[l]);
                let row = &mut rows[(j - self.first_row) as usize];
                let before: Vec<usize> = row.iter().map(|band| band.segments.len()).collect();
                for (mut gammas, segment) in clusters.closed[l].drain(..) {
                    while gammas != 0 {
                        row[gammas.trailing_zeros() as usize].segments.push(segment);
                        gammas &= gammas - 1;
                    }
                }
                for (band, before) in row.iter_mut().zip(before) {
                    band.counts.push((band.segments.len() - before) as u32);
                }
            }
        }
        rows
    }
}

/// Clusters the samples of eight rays for all gammas.
struct MultiGammaClusterer<'a, L: Lanes> {
    table: &'a TransferLut,
    gammas: &'a [f32],
    /// Optical depth at which a ray ends.
    cutoff: f32,
    ray_depth: L::F,
    states: [OpenSegments; WIDTH],
    closed: [Vec<(u128, Supersegment)>; WIDTH],
}

impl<L: Lanes> SampleSink<L> for MultiGammaClusterer<'_, L> {
    #[inline(always)]
    fn sample(&mut self, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let Some(ShadedSample { shown, color: [r, g, b], unit, depth, ratio, length }) =
            ShadedSample::new(self.table, packet, step, at, live)
        else {
            return live;
        };
        let (steps, unit, ratio) = (step.to_array(), unit.to_array(), ratio.to_array());
        let (depths, lengths) = (depth.to_array(), length.to_array());
        let color = [r.to_array(), g.to_array(), b.to_array()];
        let mut lanes = shown.bits();
        while lanes != 0 {
            let l = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let sample = LaneSample {
                step: steps[l] as u32,
                color: [color[0][l], color[1][l], color[2][l]],
                unit: unit[l],
                ratio: ratio[l],
                depth: depths[l],
                length: lengths[l],
            };
            self.states[l].add::<L>(&sample, self.gammas, self.table.unit_steps, &mut self.closed[l]);
        }
        if self.cutoff == f32::INFINITY {
            return live;
        }
        self.ray_depth = self.ray_depth + depth.zero_unless(shown);
        live & self.ray_depth.lt(L::F::splat(self.cutoff))
    }
}

/// One sample of one ray.
struct LaneSample {
    step: u32,
    /// Premultiplied color and opacity of one unit length.
    color: [f32; 3],
    unit: f32,
    /// Opacity of the sample's length over that of a unit length.
    ratio: f32,
    depth: f32,
    /// Length in steps.
    length: f32,
}

const CHUNKS: usize = MOST_GAMMAS / WIDTH;

/// The open supersegments of one ray, in chunks of eight. No two start at the same step, so there are at most as many as gammas.
struct OpenSegments {
    count: usize,
    /// First step beyond all of them.
    end: u32,
    start: [u32; MOST_GAMMAS],
    /// The gammas that share each state: bit n is gamma n.
    gammas: [u128; MOST_GAMMAS],
    /// The smallest of these gammas.
    least_gamma: [[f32; WIDTH]; CHUNKS],
    /// As in [`super::generate`], which clusters for one gamma.
    opacity: [[f32; WIDTH]; CHUNKS],
    color: [[[f32; WIDTH]; 3]; CHUNKS],
    optical_depth: [[f32; WIDTH]; CHUNKS],
    length: [[f32; WIDTH]; CHUNKS],
    unit: [[f32; WIDTH]; CHUNKS],
}

impl OpenSegments {
    fn new() -> Self {
        Self {
            count: 0,
            end: u32::MAX,
            start: [0; MOST_GAMMAS],
            gammas: [0; MOST_GAMMAS],
            least_gamma: [[0.0; WIDTH]; CHUNKS],
            opacity: [[1.0; WIDTH]; CHUNKS],
            color: [[[0.0; WIDTH]; 3]; CHUNKS],
            optical_depth: [[0.0; WIDTH]; CHUNKS],
            length: [[1.0; WIDTH]; CHUNKS],
            unit: [[0.0; WIDTH]; CHUNKS],
        }
    }

    #[inline(always)]
    fn add<L: Lanes>(
        &mut self,
        s: &LaneSample,
        gammas: &[f32],
        unit_steps: f32,
        closed: &mut Vec<(u128, Supersegment)>,
    ) {
        // Close everything before a gap.
        let mut parted = 0;
        if self.end != s.step {
            self.close_all(closed);
            parted = u128::MAX >> (MOST_GAMMAS - gammas.len());
        }
        let mut emptied = 0_u128;
        for chunk in 0..self.count.div_ceil(WIDTH) {
            // Split gammas that the sample does not join off their states, then add the sample to the states.
            let (differences, alike) = self.compare::<L>(chunk, s);
            let used = (self.count - chunk * WIDTH).min(WIDTH);
            let mut unlike = !alike & ((1 << used) - 1);
            if unlike != 0 {
                let differences = differences.to_array();
                while unlike != 0 {
                    let l = unlike.trailing_zeros() as usize;
                    unlike &= unlike - 1;
                    let opacity = self.opacity[chunk][l];
                    let joins = |gamma: f32| differences[l] < gamma * opacity;
                    let apart = gammas.partition_point(|&gamma| !joins(gamma));
                    let leaving = self.gammas[chunk * WIDTH + l] & below(apart);
                    self.close(chunk * WIDTH + l, leaving, closed);
                    parted |= leaving;
                    let staying = self.gammas[chunk * WIDTH + l] & !leaving;
                    self.gammas[chunk * WIDTH + l] = staying;
                    match gammas.get(staying.trailing_zeros() as usize) {
                        Some(&least) => self.least_gamma[chunk][l] = least,
                        None => emptied |= 1 << (chunk * WIDTH + l),
                    }
                }
            }
            self.grow::<L>(chunk, s, unit_steps);
        }
        while emptied != 0 {
            // From the last one on: `remove` moves the last state into the gap.
            let n = 127 - emptied.leading_zeros() as usize;
            emptied &= !(1 << n);
            self.remove(n);
        }
        // Open a supersegment for all gammas that were split off.
        if parted != 0 {
            self.begin(s, parted, gammas[parted.trailing_zeros() as usize]);
        }
        self.end = s.step + 1;
    }

    /// Differences between a sample and each open supersegment of a chunk, times its opacity; and, as bits, the supersegments
    /// that the sample joins for all of their gammas.
    #[inline(always)]
    fn compare<L: Lanes>(&self, chunk: usize, s: &LaneSample) -> (L::F, u32) {
        let (open, opacity) = (L::F::from_array(self.unit[chunk]), L::F::from_array(self.opacity[chunk]));
        let difference = ((open - L::F::splat(s.unit)) * opacity).abs();
        let color = &self.color[chunk];
        let difference = difference.max((L::F::from_array(color[0]) * open - L::F::splat(s.color[0]) * opacity).abs());
        let difference = difference.max((L::F::from_array(color[1]) * open - L::F::splat(s.color[1]) * opacity).abs());
        let difference = difference.max((L::F::from_array(color[2]) * open - L::F::splat(s.color[2]) * opacity).abs());
        let alike = difference.lt(L::F::from_array(self.least_gamma[chunk]) * opacity);
        (difference, alike.bits())
    }

    /// Adds a sample to all open supersegments of a chunk.
    #[inline(always)]
    fn grow<L: Lanes>(&mut self, chunk: usize, s: &LaneSample, unit_steps: f32) {
        let before = L::F::from_array(self.opacity[chunk]);
        let shows = (L::F::splat(1.0) - before) * L::F::splat(s.ratio);
        let color = &mut self.color[chunk];
        color[0] = (L::F::from_array(color[0]) + shows * L::F::splat(s.color[0])).to_array();
        color[1] = (L::F::from_array(color[1]) + shows * L::F::splat(s.color[1])).to_array();
        color[2] = (L::F::from_array(color[2]) + shows * L::F::splat(s.color[2])).to_array();
        self.opacity[chunk] = (before + shows * L::F::splat(s.unit)).to_array();
        let depths = L::F::from_array(self.optical_depth[chunk]) + L::F::splat(s.depth);
        let lengths = L::F::from_array(self.length[chunk]) + L::F::splat(s.length);
        self.unit[chunk] = opacity::<L>(depths * L::F::splat(unit_steps).div(lengths)).to_array();
        self.optical_depth[chunk] = depths.to_array();
        self.length[chunk] = lengths.to_array();
    }

    /// Opens a supersegment with one sample, for gammas `whose`.
    fn begin(&mut self, s: &LaneSample, whose: u128, least_gamma: f32) {
        let (n, chunk, l) = (self.count, self.count / WIDTH, self.count % WIDTH);
        self.count += 1;
        (self.start[n], self.gammas[n]) = (s.step, whose);
        self.least_gamma[chunk][l] = least_gamma;
        self.opacity[chunk][l] = s.ratio * s.unit;
        for (sum, c) in self.color[chunk].iter_mut().zip(s.color) {
            sum[l] = s.ratio * c;
        }
        (self.optical_depth[chunk][l], self.length[chunk][l], self.unit[chunk][l]) = (s.depth, s.length, s.unit);
    }

    /// Removes state `n`; the last one takes its place.
    fn remove(&mut self, n: usize) {
        self.count -= 1;
        let last = self.count;
        (self.start[n], self.gammas[n]) = (self.start[last], self.gammas[last]);
        let ((to, m), (from, l)) = ((n / WIDTH, n % WIDTH), (last / WIDTH, last % WIDTH));
        for column in
            [&mut self.least_gamma, &mut self.opacity, &mut self.optical_depth, &mut self.length, &mut self.unit]
        {
            column[to][m] = column[from][l];
        }
        for c in 0..3 {
            self.color[to][c][m] = self.color[from][c][l];
        }
    }

    /// Closes supersegment `n` for gammas `whose`.
    fn close(&self, n: usize, whose: u128, closed: &mut Vec<(u128, Supersegment)>) {
        let (chunk, l) = (n / WIDTH, n % WIDTH);
        let straight = reciprocal(self.opacity[chunk][l]);
        let segment = Supersegment {
            start: self.start[n],
            end: self.end,
            color: self.color[chunk].map(|c| (c[l] * straight).clamp(0.0, 1.0)),
            optical_depth: self.optical_depth[chunk][l],
        };
        closed.push((whose, segment));
    }

    /// Closes all supersegments.
    fn close_all(&mut self, closed: &mut Vec<(u128, Supersegment)>) {
        for n in 0..self.count {
            self.close(n, self.gammas[n], closed);
        }
        (self.count, self.end) = (0, u32::MAX);
    }
}

/// The lowest `n` bits.
fn below(n: usize) -> u128 {
    if n >= MOST_GAMMAS { u128::MAX } else { (1 << n) - 1 }
}
