//! The state at time 0: a hot, dented sphere near the center of a cold box full of dense clumps.
//!
//! Ambient density is 1. Clumps are in pressure equilibrium with the ambient gas and at rest, so that nothing happens to
//! them before the blast arrives. Edges are smooth over a few cells of the default grid and do not depend on the grid, so
//! that runs of different resolution show the same scene.

use crate::config::Config;
use crate::state::Primitive;

const AMBIENT_PRESSURE: f64 = 0.02;
const BLAST_PRESSURE: f64 = 200.0;
const BLAST_RADIUS: f64 = 0.2;
/// Width of the blast's edge.
const BLAST_EDGE: f64 = 0.04;
/// Bumps on the blast, and the most that each adds to its radius, as a share of it.
const BUMPS: usize = 12;
const BUMP_HEIGHT: f64 = 0.05;
/// Clumps lie up to here from the blast's center; what sticks out of the box is cut off.
const FARTHEST_CLUMP: f64 = 1.1;

/// What fills the box at time 0.
pub(crate) struct InitialState {
    blast: [f64; 3],
    /// No point of the blast is farther than this from its center.
    blast_reach: f64,
    bumps: [Bump; BUMPS],
    clumps: Vec<Clump>,
}

/// A ripple over the sphere of directions n: height sin(wave . n + phase).
#[derive(Clone, Copy)]
struct Bump {
    wave: [f64; 3],
    phase: f64,
    height: f64,
}

struct Clump {
    center: [f64; 3],
    /// Where its density is half way between ambient and peak.
    radius: f64,
    /// Peak density.
    density: f64,
}

impl InitialState {
    /// The scene that belongs to the seed.
    pub(crate) fn new(config: &Config) -> Self {
        let mut random = Random(config.seed);
        let blast = std::array::from_fn(|_| random.between(-0.08, 0.08));
        let bumps: [Bump; BUMPS] = std::array::from_fn(|_| {
            let frequency = random.between(2.0, 9.0);
            let wave = random.direction().map(|c| c * frequency);
            Bump { wave, phase: random.between(0.0, std::f64::consts::TAU), height: random.between(0.0, BUMP_HEIGHT) }
        });
        let clumps = (0..config.clumps).map(|_| Clump::new(&mut random, blast)).collect();
        let tallest: f64 = bumps.iter().map(|b| b.height).sum();
        Self { blast, blast_reach: BLAST_RADIUS * (1.0 + tallest) + BLAST_EDGE, bumps, clumps }
    }

    /// rho, u, v, w, p at a position in the box.
    pub(crate) fn at(&self, position: [f64; 3]) -> Primitive {
        let density = self.clumps.iter().fold(1.0_f64, |density, clump| density.max(clump.density_at(position)));
        let pressure = AMBIENT_PRESSURE + (BLAST_PRESSURE - AMBIENT_PRESSURE) * self.blast_share(position);
        [density, 0.0, 0.0, 0.0, pressure]
    }

    /// How far a position lies in the blast: 1 inside, 0 outside.
    pub(crate) fn blast_share(&self, position: [f64; 3]) -> f64 {
        let offset = difference(position, self.blast);
        let distance = length(offset);
        let direction = offset.map(|c| c / distance.max(1e-9));
        if distance > self.blast_reach {
            return 0.0;
        }
        let dent: f64 = self.bumps.iter().map(|b| b.height * (dot(b.wave, direction) + b.phase).sin()).sum();
        1.0 - ramp((distance - BLAST_RADIUS * (1.0 + dent)) / BLAST_EDGE + 0.5)
    }
}

impl Clump {
    /// Somewhere around the blast, closer together near it: evenly in area rather than in volume.
    fn new(random: &mut Random, blast: [f64; 3]) -> Self {
        // Many small ones, few large ones.
        let radius = 0.045 + 0.085 * random.unit().powi(2);
        let density = random.between(10.0, 30.0);
        let nearest = 1.5 * BLAST_RADIUS + radius;
        let distance = random.between(nearest * nearest, FARTHEST_CLUMP * FARTHEST_CLUMP).sqrt();
        let direction = random.direction();
        let center = std::array::from_fn(|axis| blast[axis] + distance * direction[axis]);
        Self { center, radius, density }
    }

    fn density_at(&self, position: [f64; 3]) -> f64 {
        let reach = 1.3 * self.radius;
        let offset = difference(position, self.center);
        if offset.iter().any(|c| c.abs() > reach) {
            return 1.0;
        }
        let share = (length(offset) / self.radius - 0.7) / 0.6;
        1.0 + (self.density - 1.0) * (1.0 - ramp(share))
    }
}

/// 0 below 0, 1 above 1, and twice continuously differentiable between.
fn ramp(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): small, and good from any seed.
struct Random(u64);

impl Random {
    /// Evenly from 0 up to, not including, 1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Evenly over the unit sphere.
    fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }
}
