//! The solver against closed forms and symmetries; no number here was copied from an earlier run of the solver.

mod api;
mod blast;
mod conservation;
mod exact;
mod floors;
mod shock_tube;
mod smooth;
mod terms;
mod threads;

use crate::config::{Boundary, Config};
use crate::gas::Gas;
use crate::state::Primitive;

/// A configuration for a box whose cells have edge 2 / `cells`.
fn config(cells: usize, gamma: f64, boundary: Boundary) -> Config {
    Config { cells, gamma, boundary, ..Config::default() }
}

/// Advances to `end` exactly, and says in how many cycles.
fn run_until(gas: &mut Gas, end: f64) -> u32 {
    let (mut time, mut cycles) = (0.0, 0);
    while time < end {
        let dt = gas.stable_dt().min(end - time);
        gas.cycle(dt);
        cycles += 1;
        time = if dt < end - time { time + dt } else { end };
    }
    cycles
}

/// The mean over all cells of |density - expected density at the cell's center|.
fn density_error(gas: &Gas, config: &Config, expected: impl Fn([f64; 3]) -> f64) -> f64 {
    let [nx, ny, nz] = gas.state().shape();
    let density = gas.state().component(crate::state::DENSITY, 0..nz);
    let center = |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * config.spacing();
    let error = |(cell, &rho): (usize, &f32)| {
        let (x, y, z) = (cell % nx, cell / nx % ny, cell / (nx * ny));
        (f64::from(rho) - expected([center(x, nx), center(y, ny), center(z, nz)])).abs()
    };
    density.iter().enumerate().map(error).sum::<f64>() / density.len() as f64
}

/// A gas at rest.
fn at_rest(rho: f64, p: f64) -> Primitive {
    [rho, 0.0, 0.0, 0.0, p]
}
