//! The built-in example: a blast wave that runs into dense clumps, in the manner of a young supernova remnant.
//!
//! It stands for somebody's simulation. It therefore knows nothing of Lamina: no camera, no picture, no message, and no
//! crate of this workspace. What it solves are the 3-D Euler equations of an ideal gas in the box [-1, 1]^3:
//!
//! - `riemann`: the HLLC flux (Toro, *Riemann Solvers and Numerical Methods for Fluid Dynamics*, 3rd ed., chapter 10);
//! - `sweep`: MUSCL-Hancock along one axis (Toro, chapter 14.4), second order, first order where that would turn negative;
//! - `gas`: the three axes put together by Strang splitting (Toro, chapter 16; Strang 1968), and the time step;
//! - `terms`: gravity, cooling, viscosity and a tracer, each only in runs that ask for it;
//! - `state`: how the five conserved quantities lie in memory, and floors;
//! - `setup`: the blast and its clumps.
//!
//! Units are arbitrary but consistent: length in half box edges, density in ambient densities, time such that the
//! blast meets the faces of the box after about 50 output steps of the default interval and has left it after about 200.
//!
//! Results are the same to the bit for any number of threads: a cell depends on its neighbors only, and the one
//! reduction across threads is a maximum.
//!
//! A run does not restart by itself. A caller that never stops asks [`Simulation::finished`] and begins anew:
//!
//! ```
//! # use lamina_blast::{Config, ConfigError, Simulation};
//! # fn watch(_: &[f32]) {}
//! # fn run(mut simulation: Simulation, steps: u64) -> Result<Simulation, ConfigError> {
//! for _ in 0..steps {
//!     simulation.advance();
//!     watch(&simulation.density());
//!     if simulation.finished() {
//!         simulation = Simulation::new(simulation.config().reseeded())?;
//!     }
//! }
//! # Ok(simulation)
//! # }
//! # let config = Config { cells: 16, ..Config::default() };
//! # assert_eq!(run(Simulation::new(config)?, 2)?.step(), 2);
//! # Ok::<(), ConfigError>(())
//! ```

mod config;
mod gas;
mod riemann;
mod setup;
mod state;
mod sweep;
mod terms;

#[cfg(test)]
mod tests;

pub use config::{Boundary, Config, ConfigError};
pub use state::Repairs;

use gas::Gas;
use std::ops::Range;

/// A blast into clumps, and where it stands.
#[derive(Debug)]
pub struct Simulation {
    config: Config,
    gas: Gas,
    step: u64,
    cycles: u64,
    initial_energy: f64,
}

impl Simulation {
    /// The share of the initial energy below which a run counts as finished: the blast has left the box.
    pub const FINISHED_BELOW: f64 = 0.25;

    /// The state at time 0.
    ///
    /// # Errors
    /// If a value of `config` is out of its range.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let scene = setup::InitialState::new(&config);
        let mut gas = Gas::new([config.cells; 3], &config, |position| scene.at(position));
        if config.tracer {
            gas.follow(|position| scene.blast_share(position));
        }
        let initial_energy = gas.total(state::ENERGY);
        Ok(Self { config, gas, step: 0, cycles: 0, initial_energy })
    }

    /// Goes on by one output step, that is by [`Config::interval`] of simulated time, in as many cycles of the solver as
    /// stability asks for.
    pub fn advance(&mut self) {
        let mut remaining = self.config.interval;
        while remaining > 0.0 {
            let limit = self.gas.stable_dt();
            // Equal parts of what remains, so that no sliver is left for the last cycle.
            let parts = (remaining / limit).ceil().max(1.0);
            self.gas.cycle(remaining / parts);
            self.cycles += 1;
            remaining = if parts > 1.0 { remaining - remaining / parts } else { 0.0 };
        }
        self.step += 1;
    }

    /// What it was made from.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Output steps done.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Simulated time.
    pub fn time(&self) -> f64 {
        self.step as f64 * self.config.interval
    }

    /// Cycles of the solver done: each is one time step of every cell.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Cells per side of the cube.
    pub fn cells(&self) -> usize {
        self.config.cells
    }

    /// The edge of a cell; the box has edge 2.
    pub fn spacing(&self) -> f64 {
        self.config.spacing()
    }

    /// The coordinate of the first cell's center, the same on each axis.
    pub fn origin(&self) -> f64 {
        0.5 * self.spacing() - 1.0
    }

    /// Density in each cell, above 0, in ambient densities: `cells`^3 values, x fastest, then y, then z.
    pub fn density(&self) -> Vec<f32> {
        self.density_slab(0..self.cells())
    }

    /// Density in the cells of layers `z`, as [`Simulation::density`] orders them: what one rank of several would hold.
    ///
    /// # Panics
    /// If `z` goes beyond the last layer or ends before it starts.
    pub fn density_slab(&self, z: Range<usize>) -> Vec<f32> {
        self.gas.state().component(state::DENSITY, z)
    }

    /// Momentum in each cell along x, y and z, ordered as [`Simulation::density`].
    pub fn momentum(&self) -> [Vec<f32>; 3] {
        state::MOMENTUM.map(|quantity| self.gas.state().component(quantity, 0..self.cells()))
    }

    /// Energy in each cell, thermal and kinetic, ordered as [`Simulation::density`].
    pub fn energy(&self) -> Vec<f32> {
        self.gas.state().component(state::ENERGY, 0..self.cells())
    }

    /// The share of each cell's gas that was in the blast, 0 to 1, ordered as [`Simulation::density`]; `None` unless the run
    /// follows it.
    pub fn tracer(&self) -> Option<&[f32]> {
        self.gas.tracer().map(terms::Tracer::values)
    }

    /// The share of the initial energy that is still in the box. Constant (to rounding) until the blast meets the
    /// boundary, and falling from then on.
    pub fn energy_left(&self) -> f64 {
        self.gas.total(state::ENERGY) / self.initial_energy
    }

    /// Whether the blast has left the box: [`Simulation::energy_left`] is below [`Simulation::FINISHED_BELOW`]. What
    /// remains thins out slowly. Advancing further stays safe. Never true in a periodic box.
    pub fn finished(&self) -> bool {
        self.energy_left() < Self::FINISHED_BELOW
    }

    /// How often the solver had to depart from its second-order scheme to keep density and pressure positive, since
    /// time 0.
    pub fn repairs(&self) -> Repairs {
        self.gas.repairs()
    }
}
