//! Terms beyond the Euler equations, each its own pass over the cells after the sweeps (Godunov splitting). A term that is
//! off has no pass.

use crate::config::{Boundary, Config};
use crate::state::State;
use rayon::prelude::*;

/// Momentum and energy of gas that falls for `dt`: velocity gains `gravity` dt, internal energy stays.
pub(crate) fn fall(state: &mut State, gravity: [f64; 3], dt: f64) {
    let gain = gravity.map(|g| (g * dt) as f32);
    each_cell(state, |cell| {
        let rho = cell[0];
        let kinetic = |c: &[f32; 5]| 0.5 * (c[1] * c[1] + c[2] * c[2] + c[3] * c[3]) / rho;
        let before = kinetic(cell);
        for axis in 0..3 {
            cell[1 + axis] += rho * gain[axis];
        }
        cell[4] += kinetic(cell) - before;
    });
}

/// Internal energy lost in `dt`: it decays at `rate` times density, so dense gas cools fastest.
pub(crate) fn cool(state: &mut State, rate: f64, dt: f64) {
    let (rate, dt) = (rate as f32, dt as f32);
    each_cell(state, |cell| {
        let kinetic = 0.5 * (cell[1] * cell[1] + cell[2] * cell[2] + cell[3] * cell[3]) / cell[0];
        cell[4] = kinetic + (cell[4] - kinetic) * (-rate * cell[0] * dt).exp();
    });
}

/// Applies `change` to the conserved quantities of every cell.
fn each_cell(state: &mut State, change: impl Fn(&mut [f32; 5]) + Sync) {
    let (layer, plane) = (state.layer_len(), state.plane_len());
    state.values_mut().par_chunks_mut(layer).for_each(|values| {
        for n in 0..plane {
            let mut cell = std::array::from_fn(|q| values[q * plane + n]);
            change(&mut cell);
            for (q, value) in cell.into_iter().enumerate() {
                values[q * plane + n] = value;
            }
        }
    });
}

/// Cells around one, on a grid with a boundary.
struct Around {
    shape: [usize; 3],
    boundary: Boundary,
}

impl Around {
    /// The neighbor of cell `p` one step up or down `axis`; itself at a face through which gas leaves.
    fn beside(&self, p: [usize; 3], axis: usize, up: bool) -> [usize; 3] {
        let (n, mut q) = (self.shape[axis], p);
        q[axis] = match (self.boundary, up) {
            (Boundary::Periodic, true) => (p[axis] + 1) % n,
            (Boundary::Periodic, false) => (p[axis] + n - 1) % n,
            (Boundary::Outflow, true) => (p[axis] + 1).min(n - 1),
            (Boundary::Outflow, false) => p[axis].saturating_sub(1),
        };
        q
    }
}

/// Writes to `to` what `from` becomes in `dt` under a constant dynamic `viscosity`: momentum diffuses between neighbors,
/// and energy with it, so that both totals stay and what motion is lost is heat.
pub(crate) fn rub(from: &State, to: &mut State, config: &Config, dt: f64) {
    let (around, plane, layer) =
        (Around { shape: from.shape(), boundary: config.boundary }, from.plane_len(), from.layer_len());
    let [nx, _, _] = from.shape();
    let share = (config.viscosity * dt / config.spacing().powi(2)) as f32;
    let values = from.values();
    let velocity = |[x, y, z]: [usize; 3]| -> [f32; 3] {
        let n = z * layer + y * nx + x;
        std::array::from_fn(|a| values[n + (1 + a) * plane] / values[n])
    };
    to.values_mut().par_chunks_mut(layer).enumerate().for_each(|(z, out)| {
        out.copy_from_slice(&values[z * layer..(z + 1) * layer]);
        for n in 0..plane {
            let p = [n % nx, n / nx, z];
            let own = velocity(p);
            for (axis, up) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
                let other = velocity(around.beside(p, axis, up));
                for a in 0..3 {
                    let gain = share * (other[a] - own[a]);
                    out[(1 + a) * plane + n] += gain;
                    out[4 * plane + n] += gain * 0.5 * (other[a] + own[a]);
                }
            }
        }
    });
}

/// A share of each cell's gas, 0 to 1, that moves with it.
#[derive(Debug)]
pub(crate) struct Tracer {
    values: Vec<f32>,
    spare: Vec<f32>,
}

impl Tracer {
    pub(crate) fn new(values: Vec<f32>) -> Self {
        Self { spare: values.clone(), values }
    }

    /// One value a cell, x fastest.
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// Carries it with the gas for `dt`, first order upwind: it stays within the values around it while the Courant
    /// numbers of the three axes add up to 1 or less, so a longer step is taken in parts.
    pub(crate) fn carry(&mut self, state: &State, config: &Config, dt: f64) {
        let (around, plane, layer) =
            (Around { shape: state.shape(), boundary: config.boundary }, state.plane_len(), state.layer_len());
        let [nx, _, _] = state.shape();
        const PARTS: usize = 3;
        let dt_dx = (dt / (PARTS as f64 * config.spacing())) as f32;
        for _ in 0..PARTS {
            let (gas, old) = (state.values(), &self.values);
            let at = |[x, y, z]: [usize; 3]| old[z * plane + y * nx + x];
            self.spare.par_chunks_mut(plane).enumerate().for_each(|(z, out)| {
                for (n, new) in out.iter_mut().enumerate() {
                    let p = [n % nx, n / nx, z];
                    let cell = z * layer + n;
                    *new = at(p);
                    for axis in 0..3 {
                        let speed = gas[cell + (1 + axis) * plane] / gas[cell] * dt_dx;
                        let upwind = at(around.beside(p, axis, speed < 0.0));
                        *new += speed.abs().min(1.0 / 3.0) * (upwind - at(p));
                    }
                }
            });
            std::mem::swap(&mut self.values, &mut self.spare);
        }
    }
}
