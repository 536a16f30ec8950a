//! R for many gammas at once: one march, its samples clustered for every gamma.
//!
//! Sampling is most of the cost of one VDI, and all gammas share it. They share clustering too: an open supersegment is
//! known by where it starts, so gammas whose open supersegments start at the same sample share one state, and one
//! comparison with the next sample tells all of them whether it joins. Those that it does not join part from the others,
//! and meet again in the state that starts there. The results are bit for bit those of one generation per gamma.

use super::generate::{Rays, Seen, reciprocal};
use super::march::{Packet, View, Visit};
use super::tile::Tile;
use crate::Field;
use crate::vdi::assemble::{Band, Join, header, in_order};
use crate::vdi::segmentation::Fit;
use crate::volume::field::{Stored, for_stored};
use crate::volume::transfer_lut::TransferTable;
use lamina_compute::simd::{Floats, Ints, Job, Lanes, Level, Masks, Pair, WIDTH, opacity};
use lamina_model::{GenerationParams, Invalid, Segmentation, Supersegment, Vdi};

/// Gammas that share one march: one bit each.
pub const MOST_GAMMAS: usize = 128;

/// The VDI of `field`, which [fits](super::march::fits), for each of `gammas` (ascending, at most [`MOST_GAMMAS`]); the
/// other parameters are those of `params`; with `segmentation`.
///
/// # Errors
/// As [`super::generate`].
pub fn generate_all(
    level: Level,
    field: &Field,
    params: &GenerationParams,
    gammas: &[f64],
    segmentation: Segmentation,
) -> Result<Vec<Vdi>, Invalid> {
    assert!(gammas.len() <= MOST_GAMMAS && gammas.is_sorted());
    let headers: Vec<_> =
        gammas.iter().map(|&gamma| header(field, &params.with_gamma(gamma)?)).collect::<Result<_, _>>()?;
    let Some(first) = headers.first() else { return Ok(Vec::new()) };
    let table = TransferTable::new(&field.scene().transfer, field.unit_length(), first.step_length);
    let rays = Rays::new(field, first);
    let fits: Vec<Fit> = headers.iter().map(|h| Fit::new(h, segmentation, field.unit_length())).collect();
    let gammas: Vec<f32> = gammas.iter().zip(&fits).map(|(&g, fit)| fit.finer(g) as f32).collect();
    // Of many VDIs one at a time outgrows its room: none is kept for each.
    let mut joins: Vec<Join> = gammas.iter().map(|_| Join::new(0)).collect();
    for_stored!(field.stored(), v => {
        let view = View::new(field, v, &table);
        let rows = |n: usize| {
            let first_row = Tile::ROWS * n as u32;
            let rows = level.run(Rows { view: &view, rays: &rays, gammas: &gammas, first_row });
            let mut number = first_row..;
            rows.map(|row| {
                let j = number.next().unwrap_or_default();
                row.into_iter().zip(&fits).map(|(band, fit)| fit.rows(j, band)).collect::<Vec<Band>>()
            })
        };
        in_order(rays.bands(), rows, |rows: [Vec<Band>; 2]| {
            for row in rows {
                row.into_iter().zip(&mut joins).for_each(|(band, join)| join.add(band));
            }
        });
    });
    drop(fits);
    joins.into_iter().zip(headers).map(|(join, header)| join.finish(header)).collect()
}

/// Two rows of rays, for each gamma.
struct Rows<'a, V> {
    view: &'a View<'a, V>,
    rays: &'a Rays,
    gammas: &'a [f32],
    first_row: u32,
}

impl<V: Pair> Job for Rows<'_, V> {
    type Output = [Vec<Band>; 2];
    #[inline(always)]
    fn run<L: Lanes>(self) -> [Vec<Band>; 2] {
        let mut rows = [0, 1].map(|_| self.gammas.iter().map(|_| Band::default()).collect::<Vec<_>>());
        let mut clusters = Clusters {
            table: self.view.table,
            gammas: self.gammas,
            cutoff: self.rays.cutoff,
            ray_depth: L::F::splat(0.0),
            states: std::array::from_fn(|_| States::new()),
            closed: Default::default(),
        };
        for tile in self.rays.tiles(self.first_row) {
            let packet = Packet::<L>::new(&self.rays.lens, tile.pixels());
            clusters.ray_depth = L::F::splat(0.0);
            self.view.march(&packet, &mut clusters);
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

/// The rays of a packet.
struct Clusters<'a, L: Lanes> {
    table: &'a TransferTable,
    gammas: &'a [f32],
    /// Optical depth at which a ray ends.
    cutoff: f32,
    ray_depth: L::F,
    states: [States; WIDTH],
    closed: [Vec<(u128, Supersegment)>; WIDTH],
}

impl<L: Lanes> Visit<L> for Clusters<'_, L> {
    #[inline(always)]
    fn sample(&mut self, packet: &Packet<L>, step: L::I, at: L::F, live: L::M) -> L::M {
        let Some(Seen { shown, color: [r, g, b], unit, depth, ratio, length }) =
            Seen::new(self.table, packet, step, at, live)
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
            let sample = Sample {
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
        self.ray_depth = self.ray_depth + depth.only(shown);
        live & self.ray_depth.lt(L::F::splat(self.cutoff))
    }
}

/// One sample of one ray.
struct Sample {
    step: u32,
    /// Premultiplied colour and opacity of one unit length.
    color: [f32; 3],
    unit: f32,
    /// Opacity of the sample's length over that of a unit length.
    ratio: f32,
    depth: f32,
    /// In steps.
    length: f32,
}

const CHUNKS: usize = MOST_GAMMAS / WIDTH;

/// The open supersegments of one ray, eight to a chunk. No two start at one step, so there are no more than gammas.
struct States {
    count: usize,
    /// First step beyond them all.
    end: u32,
    start: [u32; MOST_GAMMAS],
    /// Whose it is: bit n is the n-th gamma.
    gammas: [u128; MOST_GAMMAS],
    /// The least of these.
    least_gamma: [[f32; WIDTH]; CHUNKS],
    /// As in a [`super::generate`] of one gamma.
    opacity: [[f32; WIDTH]; CHUNKS],
    color: [[[f32; WIDTH]; 3]; CHUNKS],
    optical_depth: [[f32; WIDTH]; CHUNKS],
    length: [[f32; WIDTH]; CHUNKS],
    unit: [[f32; WIDTH]; CHUNKS],
}

impl States {
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
    fn add<L: Lanes>(&mut self, s: &Sample, gammas: &[f32], unit_steps: f32, closed: &mut Vec<(u128, Supersegment)>) {
        let mut parted = 0;
        if self.end != s.step {
            self.close_all(closed);
            parted = u128::MAX >> (MOST_GAMMAS - gammas.len());
        }
        let mut emptied = 0_u128;
        for chunk in 0..self.count.div_ceil(WIDTH) {
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
            // From the last one on, so that what moves into a gap stays.
            let n = 127 - emptied.leading_zeros() as usize;
            emptied &= !(1 << n);
            self.remove(n);
        }
        if parted != 0 {
            self.begin(s, parted, gammas[parted.trailing_zeros() as usize]);
        }
        self.end = s.step + 1;
    }

    /// How far a sample is from each open supersegment of a chunk, times its opacity; and bits of those it is alike for all
    /// of its gammas.
    #[inline(always)]
    fn compare<L: Lanes>(&self, chunk: usize, s: &Sample) -> (L::F, u32) {
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
    fn grow<L: Lanes>(&mut self, chunk: usize, s: &Sample, unit_steps: f32) {
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

    /// Opens a supersegment with one sample.
    fn begin(&mut self, s: &Sample, whose: u128, least_gamma: f32) {
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

    /// Puts the last one in place of number `n`.
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

    /// The supersegment that ends here for gammas `whose`.
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

    /// Ends all: what comes next adjoins nothing.
    fn close_all(&mut self, closed: &mut Vec<(u128, Supersegment)>) {
        for n in 0..self.count {
            self.close(n, self.gammas[n], closed);
        }
        (self.count, self.end) = (0, u32::MAX);
    }
}

/// The first `n` bits.
fn below(n: usize) -> u128 {
    if n >= MOST_GAMMAS { u128::MAX } else { (1 << n) - 1 }
}
