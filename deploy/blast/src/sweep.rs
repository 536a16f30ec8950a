//! One MUSCL-Hancock step of every cell along one axis.
//!
//! Toro, chapter 14.4: (1) linear reconstruction of the primitive quantities, slopes limited; (2) both face values of a
//! cell go forward by half a step with the 1-D primitive equations (chapter 3.2.3); (3) HLLC between neighbors. The
//! limiter is van Leer's monotonised central one (J. Comput. Phys. 23, 1977).
//!
//! All axes share one kernel. It walks along the axis, and [`LANES`] neighboring lines go side by side. Each thread
//! writes its own layers and may read everybody's, so that a face between two threads is computed twice, to the same bits.

use crate::config::Boundary;
use crate::riemann::hllc;
use crate::state::{
    GasLaw, LANES, LaneBlock, QUANTITIES, Repairs, State, lane, least, most, primitives, raise_to_floors,
};
use rayon::prelude::*;
use std::ops::Range;

/// What a sweep needs to know beside the state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sweep {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Time step over cell size.
    pub dt_dx: f32,
    pub law: GasLaw,
    pub boundary: Boundary,
}

impl Sweep {
    /// Writes to `to` what `from` becomes.
    pub(crate) fn run(&self, from: &State, to: &mut State) -> Repairs {
        let [_, _, nz] = from.shape();
        // Results do not depend on this: it only balances the threads against the layers read twice along z.
        let layers = nz.div_ceil(4 * rayon::current_num_threads()).max(4);
        let chunk = layers * from.layer_len();
        let repairs = to.values_mut().par_chunks_mut(chunk).enumerate().map(|(k, out)| {
            let first = k * layers;
            self.layers(from, first..(first + layers).min(nz), out)
        });
        repairs.reduce(Repairs::default, |mut sum, part| {
            sum += part;
            sum
        })
    }

    /// The layers `z`, into `out`.
    fn layers(&self, from: &State, z: Range<usize>, out: &mut [f32]) -> Repairs {
        let [nx, ny, nz] = from.shape();
        let (plane, layer) = (from.plane_len(), from.layer_len());
        // Offset of cell (x, y, z)'s density.
        let at = |x: usize, y: usize, z: usize| z * layer + y * nx + x;
        let mut walk = Walk::new(self, from, z.start * layer, out);
        match self.axis {
            0 => {
                for (z, y) in z.flat_map(|z| lane_starts(ny).map(move |y| (z, y))) {
                    let line = GridLine { first: at(0, y, z), step: 1, lane_step: nx, width: LANES.min(ny - y), plane };
                    walk.along(&line, 0..nx, nx);
                }
            }
            1 => {
                for (z, x) in z.flat_map(|z| lane_starts(nx).map(move |x| (z, x))) {
                    let line = GridLine { first: at(x, 0, z), step: nx, lane_step: 1, width: LANES.min(nx - x), plane };
                    walk.along(&line, 0..ny, ny);
                }
            }
            _ => {
                for (y, x) in (0..ny).flat_map(|y| lane_starts(nx).map(move |x| (y, x))) {
                    let line =
                        GridLine { first: at(x, y, 0), step: layer, lane_step: 1, width: LANES.min(nx - x), plane };
                    walk.along(&line, z.clone(), nz);
                }
            }
        }
        walk.repairs
    }
}

fn lane_starts(cells: usize) -> impl Iterator<Item = usize> {
    (0..cells).step_by(LANES)
}

/// Parallel lines of cells: cell i of lane l has quantity q at `first + i * step + l * lane_step + q * plane`.
pub(crate) struct GridLine {
    pub first: usize,
    pub step: usize,
    pub lane_step: usize,
    /// Lanes in use.
    pub width: usize,
    pub plane: usize,
}

impl GridLine {
    /// Cell `i`, its quantities in the given order. LaneValues beyond `width` get a gas at rest.
    #[inline]
    pub(crate) fn load(&self, values: &[f32], i: usize, order: [usize; QUANTITIES], block: &mut LaneBlock) {
        if self.width < LANES {
            *block = [[1.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES], [1.0; LANES]];
        }
        for (lanes, q) in block.iter_mut().zip(order) {
            let start = self.first + i * self.step + q * self.plane;
            if self.lane_step == 1 && self.width == LANES {
                lanes.copy_from_slice(&values[start..start + LANES]);
            } else {
                let lane_values = values[start..].iter().step_by(self.lane_step);
                lanes[..self.width].iter_mut().zip(lane_values).for_each(|(lane, &value)| *lane = value);
            }
        }
    }

    /// The reverse of [`GridLine::load`], into memory that begins `skipped` numbers later.
    #[inline]
    fn store(&self, values: &mut [f32], skipped: usize, i: usize, order: [usize; QUANTITIES], block: &LaneBlock) {
        for (lanes, q) in block.iter().zip(order) {
            let start = self.first + i * self.step + q * self.plane - skipped;
            if self.lane_step == 1 && self.width == LANES {
                values[start..start + LANES].copy_from_slice(lanes);
            } else {
                let lane_values = values[start..].iter_mut().step_by(self.lane_step);
                lanes[..self.width].iter().zip(lane_values).for_each(|(&lane, value)| *value = lane);
            }
        }
    }
}

const EMPTY: LaneBlock = [[0.0; LANES]; QUANTITIES];

/// A walk along lines, with what it has to remember of the last cells.
struct Walk<'a> {
    sweep: &'a Sweep,
    from: &'a [f32],
    skipped: usize,
    out: &'a mut [f32],
    order: [usize; QUANTITIES],
    repairs: Repairs,
    /// Conserved and primitive quantities of cell i at index i mod 4.
    u: [LaneBlock; 4],
    w: [LaneBlock; 4],
    /// Face values of cell i at index i mod 2: towards lower, towards higher coordinates.
    low: [LaneBlock; 2],
    high: [LaneBlock; 2],
    /// Flux through the lower face of cell i at index i mod 2.
    flux: [LaneBlock; 2],
}

impl<'a> Walk<'a> {
    fn new(sweep: &'a Sweep, from: &'a State, skipped: usize, out: &'a mut [f32]) -> Self {
        let a = sweep.axis;
        let order = [0, 1 + a, 1 + (a + 1) % 3, 1 + (a + 2) % 3, 4];
        let (pairs, fours) = ([EMPTY; 2], [EMPTY; 4]);
        let repairs = Repairs::default();
        let from = from.values();
        Self { sweep, from, skipped, out, order, repairs, u: fours, w: fours, low: pairs, high: pairs, flux: pairs }
    }

    /// Updates the cells `range` of lines that have `len` cells. Cells are counted from two before `range`.
    fn along(&mut self, line: &GridLine, range: Range<usize>, len: usize) {
        let law = self.sweep.law;
        let updates = range.len();
        for i in 0..updates + 4 {
            self.load(line, range.start + i, i % 4, len);
            if i >= 2 {
                self.reconstruct(i - 1);
            }
            if i >= 3 {
                hllc(&self.high[i % 2], &self.low[(i - 1) % 2], law.gamma, &mut self.flux[(i - 1) % 2]);
            }
            if i >= 4 {
                let cells = &mut self.u[(i - 2) % 4];
                update(cells, &self.flux[i % 2], &self.flux[(i - 1) % 2], self.sweep.dt_dx);
                self.repairs.floored += u64::from(raise_to_floors(cells, &law));
                line.store(self.out, self.skipped, range.start + i - 4, self.order, cells);
            }
        }
    }

    /// Loads the cell two before `i`, which may lie outside.
    #[inline]
    fn load(&mut self, line: &GridLine, i: usize, slot: usize, len: usize) {
        let inside = match self.sweep.boundary {
            Boundary::Outflow => i.saturating_sub(2).min(len - 1),
            Boundary::Periodic => (i + 2 * len - 2) % len,
        };
        line.load(self.from, inside, self.order, &mut self.u[slot]);
        primitives(&self.u[slot], &self.sweep.law, &mut self.w[slot]);
        if self.sweep.boundary == Boundary::Outflow && inside + 2 != i {
            let outward = if i < 2 { least } else { most };
            self.w[slot][1].iter_mut().for_each(|u| *u = outward(*u, 0.0));
        }
    }

    #[inline]
    fn reconstruct(&mut self, i: usize) {
        let [minus, here, plus] = [i + 3, i, i + 1].map(|k| &self.w[k % 4]);
        let (low, high) = (&mut self.low[i % 2], &mut self.high[i % 2]);
        self.repairs.first_order += u64::from(face_values([minus, here, plus], self.sweep, low, high));
    }
}

/// What both faces of a cell see of it after half a step. Returns how many cells had to stay at first order.
#[inline]
fn face_values([minus, here, plus]: [&LaneBlock; 3], sweep: &Sweep, low: &mut LaneBlock, high: &mut LaneBlock) -> u32 {
    let law = sweep.law;
    let half_dt_dx = 0.5 * sweep.dt_dx;
    let mut first_order = 0;
    for l in 0..LANES {
        let (w, before, after) = (lane(here, l), lane(minus, l), lane(plus, l));
        let mut d = [0.0; QUANTITIES];
        for q in 0..QUANTITIES {
            d[q] = limited(w[q] - before[q], after[q] - w[q]);
        }
        let ([rho, u, _, _, p], [d_rho, d_u, d_v, d_w, d_p]) = (w, d);
        let change = [u * d_rho + rho * d_u, u * d_u + d_p / rho, u * d_v, u * d_w, u * d_p + law.gamma * p * d_u];
        let rho_least = rho - half_dt_dx * change[0] - 0.5 * d_rho.abs();
        let p_least = p - half_dt_dx * change[4] - 0.5 * d_p.abs();
        let second_order = rho_least >= law.least_density && p_least >= law.least_pressure;
        first_order += u32::from(!second_order);
        let keep = if second_order { 1.0 } else { 0.0 };
        for q in 0..QUANTITIES {
            let middle = w[q] - keep * half_dt_dx * change[q];
            low[q][l] = middle - keep * 0.5 * d[q];
            high[q][l] = middle + keep * 0.5 * d[q];
        }
    }
    first_order
}

/// The monotonised central slope: the mean of both differences, but at most twice the smaller, and 0 at an extremum.
#[inline(always)]
fn limited(a: f32, b: f32) -> f32 {
    let (a2, b2, mean) = (2.0 * a, 2.0 * b, 0.5 * (a + b));
    most(least(least(a2, b2), mean), 0.0) + least(most(most(a2, b2), mean), 0.0)
}

/// Conserved quantities after what flowed in through the low face and out through the high one.
#[inline]
fn update(cells: &mut LaneBlock, flux_low: &LaneBlock, flux_high: &LaneBlock, dt_dx: f32) {
    for q in 0..QUANTITIES {
        for l in 0..LANES {
            cells[q][l] += dt_dx * (flux_low[q][l] - flux_high[q][l]);
        }
    }
}
