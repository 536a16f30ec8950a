//! Probabilities that learn, and the logistic domain, in which several of them are averaged to one.
//!
//! M. Mahoney, "Adaptive Weighing of Context Models for Lossless Data Compression", Florida Tech CS-2005-16, section 3.
//! All arithmetic after the tables is on integers; the tables come from products and quotients of `f64` in a fixed
//! order, so they are the same on every machine.
use super::range_coder::Coder;
use std::sync::LazyLock;

/// Units of ln(p / (1 - p)) = 1.
const UNIT: i32 = 256;
/// Largest |ln(p / (1 - p))| in units.
const LIMIT: i32 = 2047;

/// The logistic function and its inverse as tables.
#[derive(Debug)]
pub struct Tables {
    squash: [u16; 2 * LIMIT as usize + 1],
    stretch: [i16; 4096],
}

impl Tables {
    /// The tables, computed once.
    pub fn get() -> &'static Self {
        static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);
        &TABLES
    }

    fn new() -> Self {
        let powers = powers();
        let squash: [u16; 2 * LIMIT as usize + 1] = std::array::from_fn(|x| logistic(x as i32 - LIMIT, &powers));
        let inverse = |p: usize| squash.partition_point(|&s| usize::from(s) < p * 16 + 8) as i32 - LIMIT;
        let stretch = std::array::from_fn(|p| inverse(p).min(LIMIT) as i16);
        Self { squash, stretch }
    }

    /// ln(p / (1 - p)) of a probability in 1/4096.
    #[inline(always)]
    pub fn stretch(&self, probability: u32) -> i16 {
        self.stretch[(probability & 4095) as usize]
    }

    /// The probability in 1/65536, 32..=65504, whose ln(p / (1 - p)) is `x`.
    #[inline(always)]
    pub fn squash(&self, x: i32) -> u32 {
        u32::from(self.squash[(x.clamp(-LIMIT, LIMIT) + LIMIT) as usize])
    }
}

/// e^(i / UNIT) for i in 0..=LIMIT, by repeated products of e^(1 / UNIT).
fn powers() -> Vec<f64> {
    let step = 1.0 / f64::from(UNIT);
    // The series of e^step.
    let root = 1.0 + step * (1.0 + step / 2.0 * (1.0 + step / 3.0 * (1.0 + step / 4.0)));
    std::iter::successors(Some(1.0), |power| Some(power * root)).take(LIMIT as usize + 1).collect()
}

/// 65536 / (1 + e^(-x / UNIT)), rounded down and kept within 32..=65504.
fn logistic(x: i32, powers: &[f64]) -> u16 {
    let power = powers[x.unsigned_abs() as usize];
    let share = if x < 0 { 1.0 / (1.0 + power) } else { power / (1.0 + power) };
    (share * 65536.0).clamp(32.0, 65504.0) as u16
}

/// The probability of one kind of decision, learnt from its past: the mean at first, later with a fixed rate. The
/// highest 22 bits are the probability of a set bit, the lowest ten count decisions.
#[derive(Debug, Clone, Copy)]
pub struct Chance(u32);

/// Rates by number of decisions: 16384 / (n + 1.5) / 2.
const RATES: [u16; 256] = rates();

const fn rates() -> [u16; 256] {
    let (mut rates, mut n) = ([0; 256], 0);
    while n < 256 {
        rates[n] = (16384 / (2 * n + 3)) as u16;
        n += 1;
    }
    rates
}

/// Decisions after which the rate of a single model stays.
const SETTLED: u8 = 24;

impl Default for Chance {
    fn default() -> Self {
        Self(1 << 31)
    }
}

impl Chance {
    /// Probability of a set bit in 1/65536, 32..=65504.
    #[inline(always)]
    fn probability(self) -> u32 {
        (self.0 >> 16).clamp(32, 65504)
    }

    /// Probability of a set bit in 1/4096.
    #[inline(always)]
    pub fn coarse(self) -> u32 {
        self.0 >> 20
    }

    /// Moves the probability towards what was seen, at a rate that stays after so many decisions.
    #[inline(always)]
    pub fn learn(&mut self, bit: bool, settled: u8) {
        let count = (self.0 & 255) as u8;
        let goal = if bit { (1 << 22) - 1 } else { 0 };
        let change = ((goal - (self.0 >> 10) as i32) >> 3).wrapping_mul(i32::from(RATES[usize::from(count)]));
        let moved = self.0.wrapping_add_signed(change) & !1023;
        self.0 = moved | u32::from(count + u8::from(count < settled));
    }
}

/// A decision by a single model.
#[inline]
pub fn single<C: Coder>(coder: &mut C, model: &mut Chance, bit: bool) -> bool {
    let bit = coder.at(model.probability(), bit);
    model.learn(bit, SETTLED);
    bit
}
