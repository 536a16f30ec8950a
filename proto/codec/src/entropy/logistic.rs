//! Adaptive bit models, and the logistic domain in which a mixer averages several of them.
//!
//! M. Mahoney, "Adaptive Weighing of Context Models for Lossless Data Compression", Florida Tech CS-2005-16, section 3.
//! Everything but the construction of the tables is integer arithmetic. The tables come from products and quotients of
//! `f64` in a fixed order, so encoder and decoder hold the same tables on every machine.
use super::range_coder::Coder;
use std::sync::LazyLock;

/// Fixed-point scale of the logistic domain: ln(p / (1 - p)) = 1 is stored as 256.
const UNIT: i32 = 256;
/// Largest |ln(p / (1 - p))| that is represented, in units of 1 / [`UNIT`].
const LIMIT: i32 = 2047;

/// Lookup tables of the logistic function (`squash`) and of its inverse (`stretch`).
#[derive(Debug)]
pub(crate) struct LogisticTables {
    squash: [u16; 2 * LIMIT as usize + 1],
    stretch: [i16; 4096],
}

impl LogisticTables {
    /// The tables, computed at the first call and shared from then on.
    pub(crate) fn get() -> &'static Self {
        static TABLES: LazyLock<LogisticTables> = LazyLock::new(LogisticTables::new);
        &TABLES
    }

    fn new() -> Self {
        let powers = powers();
        let squash: [u16; 2 * LIMIT as usize + 1] = std::array::from_fn(|x| logistic(x as i32 - LIMIT, &powers));
        let inverse = |p: usize| squash.partition_point(|&s| usize::from(s) < p * 16 + 8) as i32 - LIMIT;
        let stretch = std::array::from_fn(|p| inverse(p).min(LIMIT) as i16);
        Self { squash, stretch }
    }

    /// ln(p / (1 - p)), in units of 1 / [`UNIT`], of a probability in 1/4096.
    #[inline(always)]
    pub(crate) fn stretch(&self, probability: u32) -> i16 {
        self.stretch[(probability & 4095) as usize]
    }

    /// The probability in 1/65536, 32..=65504, whose ln(p / (1 - p)) is `x` (in units of 1 / [`UNIT`]).
    #[inline(always)]
    pub(crate) fn squash(&self, x: i32) -> u32 {
        u32::from(self.squash[(x.clamp(-LIMIT, LIMIT) + LIMIT) as usize])
    }
}

/// e^(i / UNIT) for i in 0..=LIMIT, by repeated products of e^(1 / UNIT).
fn powers() -> Vec<f64> {
    let step = 1.0 / f64::from(UNIT);
    // Taylor series of e^step, in Horner form.
    let root = 1.0 + step * (1.0 + step / 2.0 * (1.0 + step / 3.0 * (1.0 + step / 4.0)));
    std::iter::successors(Some(1.0), |power| Some(power * root)).take(LIMIT as usize + 1).collect()
}

/// 65536 / (1 + e^(-x / UNIT)), rounded down and kept within 32..=65504.
fn logistic(x: i32, powers: &[f64]) -> u16 {
    let power = powers[x.unsigned_abs() as usize];
    let share = if x < 0 { 1.0 / (1.0 + power) } else { power / (1.0 + power) };
    (share * 65536.0).clamp(32.0, 65504.0) as u16
}

/// Adaptive probability of one binary decision. At first it is the mean of the bits seen, later an exponential average
/// with a fixed rate. The highest 22 bits hold the probability of a set bit, the lowest ten count the bits seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BitModel(u32);

/// Adaptation rate after n bits: 16384 / (n + 1.5) / 2.
const RATES: [u16; 256] = rates();

const fn rates() -> [u16; 256] {
    let (mut rates, mut n) = ([0; 256], 0);
    while n < 256 {
        rates[n] = (16384 / (2 * n + 3)) as u16;
        n += 1;
    }
    rates
}

/// Bits after which the adaptation rate of a model that is used alone stays constant.
const COUNT_LIMIT: u8 = 24;

impl Default for BitModel {
    fn default() -> Self {
        Self(1 << 31)
    }
}

impl BitModel {
    /// Probability of a set bit in 1/65536, 32..=65504.
    #[inline(always)]
    fn probability(self) -> u32 {
        (self.0 >> 16).clamp(32, 65504)
    }

    /// Probability of a set bit in 1/4096.
    #[inline(always)]
    pub(crate) fn probability_12bit(self) -> u32 {
        self.0 >> 20
    }

    /// Moves the probability towards `bit`. The rate falls with each bit until `count_limit` of them were seen.
    #[inline(always)]
    pub(crate) fn update(&mut self, bit: bool, count_limit: u8) {
        let count = (self.0 & 255) as u8;
        let goal = if bit { (1 << 22) - 1 } else { 0 };
        let change = ((goal - (self.0 >> 10) as i32) >> 3).wrapping_mul(i32::from(RATES[usize::from(count)]));
        let moved = self.0.wrapping_add_signed(change) & !1023;
        self.0 = moved | u32::from(count + u8::from(count < count_limit));
    }
}

/// Codes or reads one bit with the probability of a single model, and updates the model. Returns the bit.
#[inline]
pub(crate) fn code_bit<C: Coder>(coder: &mut C, model: &mut BitModel, bit: bool) -> bool {
    let bit = coder.code_bit(model.probability(), bit);
    model.update(bit, COUNT_LIMIT);
    bit
}
