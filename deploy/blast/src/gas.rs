//! The whole solver: three sweeps make a cycle, and waves say how long a cycle may be.
//!
//! Strang splitting (SIAM J. Numer. Anal. 5, 1968; Toro, chapter 16): one-dimensional sweeps in an order that the next
//! cycle reverses are together second order. All six orders take turns, so that no axis is preferred in the long run.
//! A split scheme is stable up to Courant number 1 on each axis by itself, which an unsplit one is not.

use crate::config::Config;
use crate::state::{
    DENSITY, GasLaw, LANES, LaneBlock, LaneValues, Primitive, QUANTITIES, Repairs, State, conserved, most, primitives,
};
use crate::sweep::{GridLine, Sweep};
use crate::terms::{self, Tracer};
use rayon::prelude::*;

/// Each second order is the one before it, reversed.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [2, 1, 0], [1, 2, 0], [0, 2, 1], [2, 0, 1], [1, 0, 2]];

/// Cycles at the start that go at [`CAUTION`] times the time step: a jump at rest does not yet show how fast its waves
/// will be (Toro, section 6.3.2).
const CAUTIOUS_CYCLES: u64 = 5;
const CAUTION: f64 = 0.2;

/// A gas in a box.
#[derive(Debug)]
pub(crate) struct Gas {
    state: State,
    /// Where the next sweep writes.
    spare: State,
    law: GasLaw,
    config: Config,
    cycles: u64,
    repairs: Repairs,
    tracer: Option<Tracer>,
}

impl Gas {
    /// A box of `shape` cells whose edge, gas law, boundary and Courant number `config` gives (its `cells` set the edge
    /// only). It is centered on the origin, and `initial` gives the primitive quantities at a cell's center.
    pub(crate) fn new(
        shape: [usize; 3],
        config: &Config,
        initial: impl Fn([f64; 3]) -> Primitive + Send + Sync,
    ) -> Self {
        let law = GasLaw { gamma: config.gamma as f32, least_density: 1e-5, least_pressure: 1e-7 };
        let (mut state, spare) = (State::new(shape), State::new(shape));
        let (layer, plane, nx) = (state.layer_len(), state.plane_len(), shape[0]);
        let center = |i: usize, axis: usize| (i as f64 + 0.5 - 0.5 * shape[axis] as f64) * config.spacing();
        state.values_mut().par_chunks_mut(layer).enumerate().for_each(|(z, values)| {
            for cell in 0..plane {
                let position = [center(cell % nx, 0), center(cell / nx, 1), center(z, 2)];
                for (q, value) in conserved(config.gamma, initial(position)).into_iter().enumerate() {
                    values[q * plane + cell] = value;
                }
            }
        });
        Self { state, spare, law, config: *config, cycles: 0, repairs: Repairs::default(), tracer: None }
    }

    /// Follows the gas of the cells for which `share` gives more than 0.
    pub(crate) fn follow(&mut self, share: impl Fn([f64; 3]) -> f64) {
        let [nx, ny, nz] = self.state.shape();
        let center = |i: usize, n: usize| (i as f64 + 0.5 - 0.5 * n as f64) * self.config.spacing();
        let at = |n: usize| [center(n % nx, nx), center(n / nx % ny, ny), center(n / (nx * ny), nz)];
        self.tracer = Some(Tracer::new((0..nx * ny * nz).map(|n| share(at(n)) as f32).collect()));
    }

    pub(crate) fn tracer(&self) -> Option<&Tracer> {
        self.tracer.as_ref()
    }

    pub(crate) fn state(&self) -> &State {
        &self.state
    }

    pub(crate) fn repairs(&self) -> Repairs {
        self.repairs
    }

    /// The longest stable time step.
    pub(crate) fn stable_dt(&self) -> f64 {
        let caution = if self.cycles < CAUTIOUS_CYCLES { CAUTION } else { 1.0 };
        let waves = caution * self.config.courant * self.config.spacing() / f64::from(self.fastest_wave());
        if self.config.viscosity == 0.0 {
            return waves;
        }
        // Diffusion along three axes is stable while a sixth of the velocity's difference is given away at most.
        let least = self.state.component(DENSITY, 0..self.state.shape()[2]).into_iter().fold(f32::MAX, f32::min);
        waves.min(f64::from(least) * self.config.spacing().powi(2) / (6.0 * self.config.viscosity))
    }

    /// One time step of every cell.
    pub(crate) fn cycle(&mut self, dt: f64) {
        let dt_dx = (dt / self.config.spacing()) as f32;
        for axis in ORDERS[(self.cycles % 6) as usize] {
            let sweep = Sweep { axis, dt_dx, law: self.law, boundary: self.config.boundary };
            self.repairs += sweep.run(&self.state, &mut self.spare);
            std::mem::swap(&mut self.state, &mut self.spare);
        }
        let config = &self.config;
        if config.viscosity > 0.0 {
            terms::rub(&self.state, &mut self.spare, config, dt);
            std::mem::swap(&mut self.state, &mut self.spare);
        }
        if config.gravity != [0.0; 3] {
            terms::fall(&mut self.state, config.gravity, dt);
        }
        if config.cooling > 0.0 {
            terms::cool(&mut self.state, config.cooling, dt);
        }
        if let Some(tracer) = &mut self.tracer {
            tracer.carry(&self.state, config, dt);
        }
        self.cycles += 1;
    }

    /// The sum of a conserved quantity over all cells, times a cell's volume; in double precision, layer by layer in
    /// order, so that it does not depend on the number of threads.
    pub(crate) fn total(&self, quantity: usize) -> f64 {
        let plane = self.state.plane_len();
        let layers = self.state.values().par_chunks(self.state.layer_len());
        let sums: Vec<f64> =
            layers.map(|layer| layer[quantity * plane..][..plane].iter().map(|&v| f64::from(v)).sum()).collect();
        sums.iter().sum::<f64>() * self.config.spacing().powi(3)
    }

    /// The largest |velocity| + sound speed along any axis. A maximum does not depend on the order in which it is taken.
    fn fastest_wave(&self) -> f32 {
        let (layer, plane) = (self.state.layer_len(), self.state.plane_len());
        let fastest = |values: &[f32]| {
            let mut speeds = [0.0; LANES];
            let (mut cells, mut w): (LaneBlock, LaneBlock) = ([[0.0; LANES]; QUANTITIES], [[0.0; LANES]; QUANTITIES]);
            for first in (0..plane).step_by(LANES) {
                let line = GridLine { first, step: 0, lane_step: 1, width: LANES.min(plane - first), plane };
                line.load(values, 0, [0, 1, 2, 3, 4], &mut cells);
                primitives(&cells, &self.law, &mut w);
                faster(&mut speeds, &w, self.law.gamma, line.width);
            }
            speeds.into_iter().fold(0.0, most)
        };
        self.state.values().par_chunks(layer).map(fastest).reduce(|| 0.0, most)
    }
}

/// Raises `speeds` to those of `w` where they are higher, in the first `width` lanes.
#[inline]
fn faster(speeds: &mut LaneValues, w: &LaneBlock, gamma: f32, width: usize) {
    let mut block = [0.0; LANES];
    for l in 0..LANES {
        let fastest = most(most(w[1][l].abs(), w[2][l].abs()), w[3][l].abs());
        block[l] = fastest + (gamma * w[4][l] / w[0][l]).sqrt();
    }
    for l in 0..width {
        speeds[l] = most(speeds[l], block[l]);
    }
}
