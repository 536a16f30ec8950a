//! What a run is made from, with the ranges in which it makes sense.

/// What lies beyond the faces of the box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Boundary {
    /// Gas leaves and does not come back: the outermost cell goes on outside, without any inward velocity.
    #[default]
    Outflow,
    /// Gas that leaves enters on the opposite side: nothing is ever lost, and the run never finishes.
    Periodic,
}

/// What a run is made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// Cells per side, 8 to 1024. Memory is 40 bytes a cell: 35 MB for 96, 43 GB for 1024.
    pub cells: usize,
    /// Which clumps and which blast; every value is good, equal values give equal runs.
    pub seed: u64,
    /// Number of dense clumps, up to 1000.
    pub clumps: usize,
    /// Ratio of specific heats, 1.05 to 3: 5/3 for a monatomic gas, 7/5 for air.
    pub gamma: f64,
    /// Simulated time of one output step, 1e-6 to 1.
    pub interval: f64,
    /// Courant number, 0.05 to 0.9: how far a wave may go in a cycle, in cells.
    pub courant: f64,
    /// What lies beyond the faces of the box.
    pub boundary: Boundary,
    /// Acceleration, up to 1000 in size; none by default, like all terms below: a term that is off costs nothing.
    pub gravity: [f64; 3],
    /// Decay rate of internal energy in gas of density 1, up to 1000.
    pub cooling: f64,
    /// Dynamic viscosity, up to 1.
    pub viscosity: f64,
    /// Follows the gas that was in the blast.
    pub tracer: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            cells: 96,
            seed: 1,
            clumps: 80,
            gamma: 5.0 / 3.0,
            interval: 0.004,
            courant: 0.8,
            boundary: Boundary::Outflow,
            gravity: [0.0; 3],
            cooling: 0.0,
            viscosity: 0.0,
            tracer: false,
        }
    }
}

impl Config {
    /// Says whether every value lies in its range.
    ///
    /// # Errors
    /// Names the first value that does not.
    pub fn check(&self) -> Result<(), ConfigError> {
        if !(8..=1024).contains(&self.cells) {
            return Err(ConfigError::Cells(self.cells));
        }
        if self.clumps > 1000 {
            return Err(ConfigError::Clumps(self.clumps));
        }
        let ranges = [
            ("gamma", self.gamma, 1.05, 3.0),
            ("interval", self.interval, 1e-6, 1.0),
            ("courant", self.courant, 0.05, 0.9),
            ("gravity", self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt(), 0.0, 1e3),
            ("cooling", self.cooling, 0.0, 1e3),
            ("viscosity", self.viscosity, 0.0, 1.0),
        ];
        for (name, value, least, most) in ranges {
            // A NaN is in no range.
            if !(least..=most).contains(&value) {
                return Err(ConfigError::Range { name, value, least, most });
            }
        }
        Ok(())
    }

    /// The same with the next seed: another blast into other clumps.
    pub fn reseeded(&self) -> Self {
        Self { seed: self.seed.wrapping_add(1), ..*self }
    }

    /// The edge of a cell in a box of edge 2.
    pub(crate) fn spacing(&self) -> f64 {
        2.0 / self.cells as f64
    }
}

/// Why a [`Config`] was refused: change the value named.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// Too few cells to hold a blast, or more than memory will.
    #[error("{0} cells per side: choose 8 to 1024")]
    Cells(usize),
    /// So many clumps that no room is left between them.
    #[error("{0} clumps: choose at most 1000")]
    Clumps(usize),
    /// A real number outside its range.
    #[error("{name} = {value}: choose {least} to {most}")]
    Range {
        /// The field of [`Config`].
        name: &'static str,
        /// What it was.
        value: f64,
        /// The least it may be.
        least: f64,
        /// The most it may be.
        most: f64,
    },
}
