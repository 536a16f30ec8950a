//! Residual coder: binarizes residuals, block flags and weights, and codes each bit by context mixing.
use super::grid::{BLOCK, PointClass};
use super::mixer::{INPUTS, Mixer, TEMPORAL_INPUTS, code_mixed_bit};
use super::multigrid::WEIGHTS;
use super::multigrid::{LatticePart, MultigridField};
use super::predict::{SCALE, cubic};
use super::temporal::OCTAVES;
use crate::entropy::logistic::{BitModel, LogisticTables, code_bit};
use crate::entropy::range_coder::Coder;
use std::ops::Range;

/// Escape residual: the value itself follows, as an `f32`.
pub(super) const RAW_VALUE: i32 = 1 << RAW_LENGTH;
/// Residuals are below 2^this.
const RAW_LENGTH: u32 = 20;
/// Magnitude at which stored residuals saturate.
pub(super) const SATURATED: u8 = 127;
/// Contexts of the first input: magnitudes at the nearest neighbors, and of previous residuals of the class.
const MAGNITUDE_CONTEXTS: usize = 9 * 8 * 8;
/// Contexts of the second input: slope and bend of the surroundings.
const SMOOTHNESS_CONTEXTS: usize = 3 * 16 * 16;
/// Contexts of the third input: class, level, and a fine sum of magnitudes.
const CLASS_CONTEXTS: usize = 7 * 4 * 16;
/// Contexts of the fourth input: bend, and the total of magnitudes.
const BEND_CONTEXTS: usize = 3 * 16 * 8;
/// Contexts of the fifth input: the pattern of previous residuals along each axis.
const PATTERN_CONTEXTS: usize = 3 * 27 * 4 * 2;
/// Contexts of the sixth input: what was missed in the volume before, and the total of magnitudes.
const TEMPORAL_CONTEXTS: usize = 3 * OCTAVES * 8;
/// Kinds of mixers.
const MIXERS: usize = 9 * 2;
/// Context-mixed bits of a magnitude: is it above 0, above 1, above 2.
const STAGES: usize = 3;

/// One model for each context-mixed bit.
type StageModels = [BitModel; STAGES];

/// All models of a band.
#[derive(Debug)]
pub(super) struct VolumeModels {
    tables: &'static LogisticTables,
    by_magnitude: Box<[StageModels; MAGNITUDE_CONTEXTS]>,
    by_smoothness: Box<[StageModels; SMOOTHNESS_CONTEXTS]>,
    by_class: Box<[StageModels; CLASS_CONTEXTS]>,
    by_bend: Box<[StageModels; BEND_CONTEXTS]>,
    by_pattern: Box<[StageModels; PATTERN_CONTEXTS]>,
    mixers: Box<[[Mixer; STAGES]; MIXERS]>,
    temporal: Option<Box<TemporalModels>>,
    signs: Vec<BitModel>,
    exponents: [[BitModel; RAW_LENGTH as usize + 1]; 4],
    leading: [BitModel; RAW_LENGTH as usize + 1],
    flags: [BitModel; 128],
    own: BitModel,
}

/// What is mixed where there is a volume before.
#[derive(Debug)]
struct TemporalModels {
    by_missed: [StageModels; TEMPORAL_CONTEXTS],
    mixers: [[Mixer<TEMPORAL_INPUTS>; STAGES]; MIXERS],
}

impl Default for TemporalModels {
    fn default() -> Self {
        let mixers = std::array::from_fn(|_| Default::default());
        Self { by_missed: [StageModels::default(); TEMPORAL_CONTEXTS], mixers }
    }
}

/// Contexts of one residual.
#[derive(Debug)]
pub(super) struct ResidualContext {
    at: [usize; INPUTS],
    missed: usize,
    mixer: usize,
    sign: usize,
    total: usize,
}

impl Default for VolumeModels {
    fn default() -> Self {
        Self {
            tables: LogisticTables::get(),
            by_magnitude: Box::new([StageModels::default(); MAGNITUDE_CONTEXTS]),
            by_smoothness: Box::new([StageModels::default(); SMOOTHNESS_CONTEXTS]),
            by_class: Box::new([StageModels::default(); CLASS_CONTEXTS]),
            by_bend: Box::new([StageModels::default(); BEND_CONTEXTS]),
            by_pattern: Box::new([StageModels::default(); PATTERN_CONTEXTS]),
            mixers: Box::new(std::array::from_fn(|_| Default::default())),
            temporal: None,
            signs: vec![BitModel::default(); 3 * 27],
            exponents: Default::default(),
            leading: Default::default(),
            flags: [BitModel::default(); 128],
            own: BitModel::default(),
        }
    }
}

impl VolumeModels {
    /// Models of a band that is coded after another one.
    pub(super) fn temporal() -> Self {
        Self { temporal: Some(Box::default()), ..Self::default() }
    }

    /// Codes the weight of the volume before, in 1 / [`SCALE`].
    pub(super) fn temporal_weight(&mut self, coder: &mut impl Coder, weight: i8) -> f32 {
        f32::from(self.bits(coder, 8, u32::from(weight as u8)) as u8 as i8) / SCALE
    }

    /// Codes the residual `steps` of a point, or reads one. Returns it.
    #[inline]
    pub(super) fn residual(&mut self, coder: &mut impl Coder, context: &ResidualContext, steps: i32) -> i32 {
        let magnitude = self.magnitude(coder, context, steps.unsigned_abs());
        if magnitude == 0 || magnitude == RAW_VALUE as u32 {
            return magnitude as i32;
        }
        let negative = code_bit(coder, &mut self.signs[context.sign], steps < 0);
        if negative { -(magnitude as i32) } else { magnitude as i32 }
    }

    #[inline(always)]
    fn magnitude(&mut self, coder: &mut impl Coder, context: &ResidualContext, magnitude: u32) -> u32 {
        let [magnitudes, smoothness, class, bend, pattern] = context.at;
        let a = &mut self.by_magnitude[magnitudes];
        let b = &mut self.by_smoothness[smoothness];
        let c = &mut self.by_class[class];
        let (d, e) = (&mut self.by_bend[bend], &mut self.by_pattern[pattern]);
        for stage in 0..STAGES {
            let beyond = magnitude > stage as u32;
            let [a, b, c, d, e] = [&mut a[stage], &mut b[stage], &mut c[stage], &mut d[stage], &mut e[stage]];
            let beyond = if let Some(temporal) = &mut self.temporal {
                let TemporalModels { by_missed, mixers } = &mut **temporal;
                let models = [a, b, c, d, e, &mut by_missed[context.missed][stage]];
                code_mixed_bit(coder, self.tables, &mut mixers[context.mixer][stage], models, beyond)
            } else {
                let mixer = &mut self.mixers[context.mixer][stage];
                code_mixed_bit(coder, self.tables, mixer, [a, b, c, d, e], beyond)
            };
            if !beyond {
                return stage as u32;
            }
        }
        self.rest(coder, context.total, magnitude.wrapping_sub(STAGES as u32)) + STAGES as u32
    }

    /// Codes a magnitude's excess over [`STAGES`] in Exp-Golomb code: the length of its successor in binary, then its digits.
    fn rest(&mut self, coder: &mut impl Coder, total: usize, rest: u32) -> u32 {
        let wanted = rest.wrapping_add(1);
        let length = 31 - wanted.max(1).leading_zeros();
        let models = &mut self.exponents[total / 4];
        let mut n = 0;
        while n < RAW_LENGTH && code_bit(coder, &mut models[n as usize], length > n) {
            n += 1;
        }
        if n == RAW_LENGTH {
            return RAW_VALUE as u32 - STAGES as u32;
        }
        if n == 0 {
            return 0;
        }
        let below = n - 1;
        let first = code_bit(coder, &mut self.leading[n as usize], wanted >> below & 1 == 1);
        let digits = (2 | u32::from(first)) << below;
        (digits | code_uniform(coder, below, wanted)) - 1
    }

    /// Codes whether a block has nonzero residuals; `context` in 0..128.
    pub(super) fn flag(&mut self, coder: &mut impl Coder, context: usize, active: bool) -> bool {
        code_bit(coder, &mut self.flags[context], active)
    }

    /// Codes the lowest `count` bits of `number` as uniform.
    pub(super) fn bits(&mut self, coder: &mut impl Coder, count: u32, number: u32) -> u32 {
        code_uniform(coder, count, number)
    }

    /// Codes the fitted weights of a class with `odd_axes` odd axes, if it has any. Returns them, or cubic interpolation.
    pub(super) fn weights(
        &mut self,
        coder: &mut impl Coder,
        odd_axes: usize,
        own: Option<[i8; WEIGHTS]>,
    ) -> [f32; WEIGHTS] {
        let mut weights = own.unwrap_or(cubic(odd_axes));
        if code_bit(coder, &mut self.own, own.is_some()) {
            for weight in &mut weights[..super::predict::weights(odd_axes)] {
                *weight = self.bits(coder, 8, u32::from(*weight as u8)) as u8 as i8;
            }
        }
        weights.map(|w| f32::from(w) / SCALE)
    }
}

/// Codes the lowest `count` (at most 32) bits of `number` as uniform.
#[inline]
fn code_uniform(coder: &mut impl Coder, count: u32, number: u32) -> u32 {
    if count <= 16 {
        return coder.code_uniform(count, number);
    }
    let high = coder.code_uniform(count - 16, number >> 16);
    high << 16 | coder.code_uniform(16, number)
}

/// Bins of a sum: 0, 1, 2, 3..4, 5..7, 8..12, 13..20, more.
#[inline]
pub(super) fn bin(sum: u32) -> usize {
    const BINS: [u8; 22] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    usize::from(BINS[sum.min(21) as usize])
}

/// 0, 1, 2 for negative, zero, positive.
#[inline]
fn sign(x: i32) -> usize {
    (x.signum() + 1) as usize
}

/// Residuals around the points of a row that are known before the row is coded.
#[derive(Debug, Default)]
pub(super) struct ResidualNeighborhood {
    /// Sums of the magnitudes at the nearest neighbors, saturated to 255.
    near: Vec<u8>,
    /// Signs of the sums of the residuals at the nearest neighbors, as `sign` gives them.
    sign_of_sum: Vec<u8>,
    /// Residuals of the previous rows along y and z, and the next point's on the former (on the latter in the first row).
    y: Vec<i8>,
    z: Vec<i8>,
    diagonal: Vec<i8>,
}

impl ResidualNeighborhood {
    /// Gathers the residuals around row (`y`, `z`) of `class`, whose `part` has been taken out of the field.
    pub(super) fn gather(&mut self, field: &MultigridField, part: &LatticePart, class: PointClass, [y, z]: [usize; 2]) {
        let n = part.grid.dims[0];
        [&mut self.near, &mut self.sign_of_sum].into_iter().for_each(|row| row.resize(n, 0));
        let none = |row: &mut Vec<i8>| {
            row.clear();
            row.resize(n, 0);
        };
        [&mut self.y, &mut self.z, &mut self.diagonal].into_iter().for_each(none);
        if y > 0 {
            self.y.copy_from_slice(part.residuals([y - 1, z]));
        }
        if z > 0 {
            self.z.copy_from_slice(part.residuals([y, z - 1]));
        }
        let diagonal = if y > 0 { &self.y } else { &self.z };
        self.diagonal[..n - 1].copy_from_slice(&diagonal[1..]);
        let mut sums = NeighborSums { near: &mut self.near, sign_of_sum: &mut self.sign_of_sum };
        let from = |axis: usize| &field.parts[class.part() ^ 1 << axis];
        let rows = |axis: usize| {
            let (i, dims) = ([0, y, z][axis], from(axis).grid.dims);
            let next = if i + 1 < dims[axis] { i + 1 } else { i };
            if axis == 1 {
                [from(1).residuals([y, z]), from(1).residuals([next, z])]
            } else {
                [from(2).residuals([y, z]), from(2).residuals([y, next])]
            }
        };
        let none: &[i8] = &[];
        let x = if class.odd[0] { from(0).residuals([y, z]) } else { none };
        match class.odd {
            [true, false, false] => sums.add(x, []),
            [true, true, false] => sums.add(x, rows(1)),
            [true, false, true] => sums.add(x, rows(2)),
            [true, true, true] => {
                let ([a, b], [c, d]) = (rows(1), rows(2));
                sums.add(x, [a, b, c, d]);
            }
            [false, true, false] => sums.add(x, rows(1)),
            [false, false, true] => sums.add(x, rows(2)),
            _ => {
                let ([a, b], [c, d]) = (rows(1), rows(2));
                sums.add(x, [a, b, c, d]);
            }
        }
    }
}

/// Destination of sums over neighbors.
struct NeighborSums<'a> {
    near: &'a mut [u8],
    sign_of_sum: &'a mut [u8],
}

impl NeighborSums<'_> {
    /// Sums the residuals of the neighbors on row `x`, if it has any, and on `rows`.
    fn add<const R: usize>(&mut self, x: &[i8], rows: [&[i8]; R]) {
        let n = self.near.len();
        let rows = rows.map(|row| &row[..n]);
        let at = |i: usize| rows.map(|row| i16::from(row[i]));
        let Some(next) = x.get(1..) else {
            for (i, to) in self.near.iter_mut().zip(self.sign_of_sum.iter_mut()).enumerate() {
                (*to.0, *to.1) = sums([], at(i));
            }
            return;
        };
        for (i, ((to, sign_of_sum), (&a, &b))) in
            self.near.iter_mut().zip(self.sign_of_sum.iter_mut()).zip(x.iter().zip(next)).enumerate()
        {
            (*to, *sign_of_sum) = sums([i16::from(a), i16::from(b)], at(i));
        }
        if next.len() < n {
            let a = i16::from(x[n - 1]);
            (self.near[n - 1], self.sign_of_sum[n - 1]) = sums([a, a], at(n - 1));
        }
    }
}

/// Sum of magnitudes, and sign of the sum.
#[inline(always)]
fn sums<const X: usize, const R: usize>(x: [i16; X], rows: [i16; R]) -> (u8, u8) {
    let near = x.iter().chain(&rows).map(|m| m.abs()).sum::<i16>().min(255);
    let sign_of_sum: i16 = x.iter().chain(&rows).sum();
    (near as u8, (1 + i16::from(sign_of_sum > 0) - i16::from(sign_of_sum < 0)) as u8)
}

/// What the contexts of all points of a class have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClassContext {
    odd_axes: usize,
    class: usize,
    level: usize,
}

impl ClassContext {
    /// The class on level number `level`.
    pub(super) fn new(class: PointClass, level: usize) -> Self {
        Self { odd_axes: class.odd_axes() - 1, class: class.number, level }
    }
}

impl ResidualContext {
    /// Contexts of point `i` of a row. `residual` is that of the point before it, `surroundings` are the row's context bits,
    /// `missed` the octaves of [`TemporalRow`](super::temporal::TemporalRow), if there is a volume before.
    #[inline(always)]
    pub(super) fn new(
        kind: ClassContext,
        known: &ResidualNeighborhood,
        i: usize,
        residual: i8,
        surroundings: u16,
        missed: u8,
    ) -> Self {
        // Sum the magnitudes of residuals already coded around the point.
        let (bx, by, bz) = (i32::from(residual), i32::from(known.y[i]), i32::from(known.z[i]));
        let diagonal = i32::from(known.diagonal[i]).unsigned_abs();
        let near = u32::from(known.near[i]);
        let (x, y, z) = (bx.unsigned_abs(), by.unsigned_abs(), bz.unsigned_abs());
        let back = x + y + z;
        let around = usize::from(surroundings);
        let (slope, bend, rising) = (around & 15, around >> 4 & 15, around >> 8);
        let ClassContext { odd_axes, class, level } = kind;
        let kind = level.min(2) * 3 + odd_axes;
        let total = bin(near + 2 * (back + diagonal));
        let fine = (near + 2 * back + diagonal).min(15) as usize;
        let (x, y, z) = (x.min(2) as usize, y.min(2) as usize, z.min(2) as usize);
        // Compute the index into each input's table.
        let by_magnitude = (kind * 8 + bin(near)) * 8 + bin(back + diagonal);
        let by_smoothness = (odd_axes * 16 + slope) * 16 + bend;
        let by_class = (class * 4 + level.min(3)) * 16 + fine;
        let by_bend = (odd_axes * 16 + bend) * 8 + total;
        let by_pattern =
            (((odd_axes * 3 + x) * 9 + 3 * y + z) * 4 + near.min(3) as usize) * 2 + diagonal.min(1) as usize;
        let at = [by_magnitude, by_smoothness, by_class, by_bend, by_pattern];
        let sign = (rising * 9 + usize::from(known.sign_of_sum[i]) * 3 + sign(bx + by + bz)) + 27 * odd_axes;
        let missed = (odd_axes * OCTAVES + usize::from(missed)) * 8 + total;
        Self { at, missed, mixer: kind * 2 + total.min(1), sign, total }
    }
}

/// A residual as stored: saturated to -127..=127.
#[inline]
pub(super) fn saturated(steps: i32) -> i8 {
    steps.clamp(-i32::from(SATURATED), i32::from(SATURATED)) as i8
}

/// Indices of the points of a block on a row of `n` points.
#[inline]
pub(super) fn block_range(block: usize, n: usize) -> Range<usize> {
    block * BLOCK..n.min((block + 1) * BLOCK)
}
