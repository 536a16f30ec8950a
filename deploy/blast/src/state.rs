//! The five conserved quantities of every cell, and their primitive counterparts.
//!
//! Conserved: density rho, momentum rho (u, v, w), total energy E = p / (gamma - 1) + rho (u^2 + v^2 + w^2) / 2, per
//! volume. Primitive: rho, u, v, w, pressure p. Single precision: the scheme's own error is far above 1e-7, and twice as
//! many cells fit a vector register.
//!
//! In memory a layer of constant z holds its five quantities one after the other, each with x fastest: a layer is one
//! contiguous piece that one thread can own, and rows of one quantity are contiguous too.

use std::ops::{AddAssign, Range};

/// Quantities per cell.
pub(crate) const QUANTITIES: usize = 5;
/// Index of density, conserved and primitive.
pub(crate) const DENSITY: usize = 0;
/// Indices of momentum.
pub(crate) const MOMENTUM: [usize; 3] = [1, 2, 3];
/// Index of total energy (conserved) or pressure (primitive).
pub(crate) const ENERGY: usize = 4;
/// Cells that are worked on side by side, so that the compiler can use vector registers: one cache line of each quantity.
pub(crate) const LANES: usize = 16;

/// One number for each of [`LANES`] cells.
pub(crate) type LaneValues = [f32; LANES];
/// The quantities of [`LANES`] cells.
pub(crate) type LaneBlock = [LaneValues; QUANTITIES];
/// One cell's rho, u, v, w, p.
pub(crate) type Primitive = [f64; QUANTITIES];

/// The gas law and the least density and pressure that a cell may have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GasLaw {
    /// Ratio of specific heats.
    pub gamma: f32,
    /// Below this a cell's density is raised.
    pub least_density: f32,
    /// Below this a cell's pressure is raised.
    pub least_pressure: f32,
}

/// Departures from the second-order scheme, counted per cell and sweep (a cycle has three sweeps).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Reconstructed at first order because second order would have given a face a negative density or pressure.
    pub first_order: u64,
    /// Density or pressure raised to its floor after a sweep: the only repair that breaks conservation.
    pub floored: u64,
}

impl AddAssign for Repairs {
    fn add_assign(&mut self, other: Self) {
        self.first_order += other.first_order;
        self.floored += other.floored;
    }
}

/// Every cell's conserved quantities.
#[derive(Debug)]
pub(crate) struct State {
    shape: [usize; 3],
    values: Vec<f32>,
}

impl State {
    /// All zero, to be overwritten.
    pub(crate) fn new(shape: [usize; 3]) -> Self {
        Self { shape, values: vec![0.0; QUANTITIES * shape.iter().product::<usize>()] }
    }

    /// Cells along x, y, z.
    pub(crate) fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Numbers in one layer of constant z.
    pub(crate) fn layer_len(&self) -> usize {
        QUANTITIES * self.plane_len()
    }

    /// Cells in one layer of constant z.
    pub(crate) fn plane_len(&self) -> usize {
        self.shape[0] * self.shape[1]
    }

    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// One quantity in the layers `z`, x fastest, then y, then z.
    pub(crate) fn component(&self, quantity: usize, z: Range<usize>) -> Vec<f32> {
        let (layer, plane) = (self.layer_len(), self.plane_len());
        let layers = &self.values[z.start * layer..z.end * layer];
        let mut out = Vec::with_capacity(z.len() * plane);
        for values in layers.chunks_exact(layer) {
            out.extend_from_slice(&values[quantity * plane..][..plane]);
        }
        out
    }
}

/// The conserved quantities of one cell.
pub(crate) fn conserved(gamma: f64, [rho, u, v, w, p]: Primitive) -> [f32; QUANTITIES] {
    let energy = p / (gamma - 1.0) + 0.5 * rho * (u * u + v * v + w * w);
    [rho, rho * u, rho * v, rho * w, energy].map(|value| value as f32)
}

/// The primitive quantities of a block. Pressure is at least its floor: that of a cold and fast cell is a small difference
/// of large numbers, which rounding may turn negative.
#[inline]
pub(crate) fn primitives(conserved: &LaneBlock, law: &GasLaw, out: &mut LaneBlock) {
    for l in 0..LANES {
        let rho = conserved[0][l];
        let per_rho = 1.0 / rho;
        let (u, v, w) = (conserved[1][l] * per_rho, conserved[2][l] * per_rho, conserved[3][l] * per_rho);
        let kinetic = 0.5 * rho * (u * u + v * v + w * w);
        out[0][l] = rho;
        out[1][l] = u;
        out[2][l] = v;
        out[3][l] = w;
        out[4][l] = most((law.gamma - 1.0) * (conserved[4][l] - kinetic), law.least_pressure);
    }
}

/// No energy in a cell comes near this; infinity and what is not a number fail the comparison with it.
const ABSURD_ENERGY: f32 = 1e30;

/// Raises densities and pressures of a conserved block to their floors, and says how many cells it changed.
///
/// A cell without density loses its momentum: keeping it would mean a velocity without bound, and a time step without
/// end. A cell whose numbers are none becomes such a cell too.
#[inline]
pub(crate) fn raise_to_floors(cells: &mut LaneBlock, law: &GasLaw) -> u32 {
    let mut raised = 0;
    let least_internal = law.least_pressure / (law.gamma - 1.0);
    for l in 0..LANES {
        let [rho, mx, my, mz, energy] = lane(cells, l);
        let kinetic = 0.5 * (mx * mx + my * my + mz * mz) / rho;
        let dense = rho >= law.least_density && rho < ABSURD_ENERGY;
        let moves = dense && kinetic < ABSURD_ENERGY && energy < ABSURD_ENERGY;
        let warm = moves && energy - kinetic >= least_internal;
        raised += u32::from(!warm);
        let coldest = if moves { kinetic + least_internal } else { least_internal };
        cells[0][l] = if dense { rho } else { law.least_density };
        cells[1][l] = if moves { mx } else { 0.0 };
        cells[2][l] = if moves { my } else { 0.0 };
        cells[3][l] = if moves { mz } else { 0.0 };
        cells[4][l] = if warm { energy } else { coldest };
    }
    raised
}

/// One cell of a block.
#[inline(always)]
pub(crate) fn lane(block: &LaneBlock, l: usize) -> [f32; QUANTITIES] {
    // Written out: `array::map` was measured not to be inlined in the kernels, which then lose their vector registers.
    [block[0][l], block[1][l], block[2][l], block[3][l], block[4][l]]
}

/// The reverse of [`lane`].
#[inline(always)]
pub(crate) fn set_lane(block: &mut LaneBlock, l: usize, cell: [f32; QUANTITIES]) {
    for q in 0..QUANTITIES {
        block[q][l] = cell[q];
    }
}

/// The smaller of two numbers that are numbers. Unlike `f32::min` one instruction, as it ignores the case of NaN.
#[inline(always)]
pub(crate) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two numbers that are numbers.
#[inline(always)]
pub(crate) fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
