//! How residuals and flags become decisions, and what the probability of each is learnt from.
use super::grid::{BLOCK, Class};
use super::mixer::{Mixer, OPINIONS, mixed};
use super::multigrid::{Field, Part};
use super::predict::{SCALE, WEIGHTS, cubic};
use crate::entropy::logistic::{Chance, Tables, single};
use crate::entropy::range_coder::Coder;
use std::ops::Range;

/// A residual that is not a number of steps: the value follows as it is.
pub const RAW: i32 = 1 << TOP;
/// Residuals are below this power of two.
const TOP: u32 = 20;
/// A mark of this magnitude stands for it and all beyond.
pub const LARGE: u8 = 127;
/// Contexts of the five opinions.
const A: usize = 9 * 8 * 8;
const B: usize = 3 * 16 * 16;
const C: usize = 7 * 4 * 16;
const D: usize = 3 * 16 * 8;
const E: usize = 3 * 27 * 4 * 2;
/// Mixed decisions: is it 0, beyond 1, beyond 2.
const STAGES: usize = 3;

/// The models of an opinion in one context.
type Stages = [Chance; STAGES];

/// All that is learnt on the way.
#[derive(Debug)]
pub struct Models {
    tables: &'static Tables,
    a: Box<[Stages; A]>,
    b: Box<[Stages; B]>,
    c: Box<[Stages; C]>,
    d: Box<[Stages; D]>,
    e: Box<[Stages; E]>,
    mixers: Box<[[Mixer; STAGES]; 9 * 2]>,
    signs: Vec<Chance>,
    exponents: [[Chance; TOP as usize + 1]; 4],
    leading: [Chance; TOP as usize + 1],
    flags: [Chance; 128],
    own: Chance,
}

/// What a point's decisions depend on.
#[derive(Debug)]
pub struct Context {
    at: [usize; OPINIONS],
    mixer: usize,
    sign: usize,
    total: usize,
}

impl Default for Models {
    fn default() -> Self {
        Self {
            tables: Tables::get(),
            a: Box::new([Stages::default(); A]),
            b: Box::new([Stages::default(); B]),
            c: Box::new([Stages::default(); C]),
            d: Box::new([Stages::default(); D]),
            e: Box::new([Stages::default(); E]),
            mixers: Box::new(std::array::from_fn(|_| Default::default())),
            signs: vec![Chance::default(); 3 * 27],
            exponents: Default::default(),
            leading: Default::default(),
            flags: [Chance::default(); 128],
            own: Chance::default(),
        }
    }
}

impl Models {
    /// Codes the residual `steps` of a point, or reads it.
    #[inline]
    pub fn residual(&mut self, coder: &mut impl Coder, context: &Context, steps: i32) -> i32 {
        let magnitude = self.magnitude(coder, context, steps.unsigned_abs());
        if magnitude == 0 || magnitude == RAW as u32 {
            return magnitude as i32;
        }
        let negative = single(coder, &mut self.signs[context.sign], steps < 0);
        if negative { -(magnitude as i32) } else { magnitude as i32 }
    }

    #[inline(always)]
    fn magnitude(&mut self, coder: &mut impl Coder, context: &Context, magnitude: u32) -> u32 {
        let [a, b, c, d, e] = context.at;
        let (a, b, c) = (&mut self.a[a], &mut self.b[b], &mut self.c[c]);
        let (d, e) = (&mut self.d[d], &mut self.e[e]);
        for stage in 0..STAGES {
            let mixer = &mut self.mixers[context.mixer][stage];
            let beyond = magnitude > stage as u32;
            let models = [&mut a[stage], &mut b[stage], &mut c[stage], &mut d[stage], &mut e[stage]];
            if !mixed(coder, self.tables, mixer, models, beyond) {
                return stage as u32;
            }
        }
        self.rest(coder, context.total, magnitude.wrapping_sub(STAGES as u32)) + STAGES as u32
    }

    /// A number by the length of its successor in binary, then its digits: Exp-Golomb.
    fn rest(&mut self, coder: &mut impl Coder, total: usize, rest: u32) -> u32 {
        let wanted = rest.wrapping_add(1);
        let length = 31 - wanted.max(1).leading_zeros();
        let models = &mut self.exponents[total / 4];
        let mut n = 0;
        while n < TOP && single(coder, &mut models[n as usize], length > n) {
            n += 1;
        }
        if n == TOP {
            return RAW as u32 - STAGES as u32;
        }
        if n == 0 {
            return 0;
        }
        let below = n - 1;
        let first = single(coder, &mut self.leading[n as usize], wanted >> below & 1 == 1);
        let digits = (2 | u32::from(first)) << below;
        (digits | even(coder, below, wanted)) - 1
    }

    /// Codes whether a block has residuals; `context` in 0..128.
    pub fn flag(&mut self, coder: &mut impl Coder, context: usize, active: bool) -> bool {
        single(coder, &mut self.flags[context], active)
    }

    /// Codes the lowest `count` bits of `number`, all as likely.
    pub fn bits(&mut self, coder: &mut impl Coder, count: u32, number: u32) -> u32 {
        even(coder, count, number)
    }

    /// Codes the weights of a class with `odds` odd axes, if it has its own; returns them, or the usual ones.
    pub fn weights(&mut self, coder: &mut impl Coder, odds: usize, own: Option<[i8; WEIGHTS]>) -> [f32; WEIGHTS] {
        let mut weights = own.unwrap_or(cubic(odds));
        if single(coder, &mut self.own, own.is_some()) {
            for weight in &mut weights[..super::predict::weights(odds)] {
                *weight = self.bits(coder, 8, u32::from(*weight as u8)) as u8 as i8;
            }
        }
        weights.map(|w| f32::from(w) / SCALE)
    }
}

/// Codes the lowest `count` bits of `number`, at most 32, all as likely.
#[inline]
fn even(coder: &mut impl Coder, count: u32, number: u32) -> u32 {
    if count <= 16 {
        return coder.even(count, number);
    }
    let high = coder.even(count - 16, number >> 16);
    high << 16 | coder.even(16, number)
}

/// 0, 1, 2, 3..4, 5..7, 8..12, 13..20, more.
#[inline]
fn bin(sum: u32) -> usize {
    const BINS: [u8; 22] = [0, 1, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 7];
    usize::from(BINS[sum.min(21) as usize])
}

/// 0, 1, 2 for a negative number, 0, and a positive one.
#[inline]
fn sign(x: i32) -> usize {
    (x.signum() + 1) as usize
}

/// Marks around the points of a row that are known before it is coded.
#[derive(Debug, Default)]
pub struct Known {
    /// Sums of the magnitudes at the nearest neighbours, saturated.
    near: Vec<u8>,
    /// Signs of their sums, as `sign` has them.
    lean: Vec<u8>,
    /// Marks on the rows before along y and z, and next to the former, or the latter where there is none.
    y: Vec<i8>,
    z: Vec<i8>,
    beside: Vec<i8>,
}

impl Known {
    /// Looks at the marks around the row of `class` at `y`, `z`; `part` has been taken from the field.
    pub fn look(&mut self, field: &Field, part: &Part, class: Class, [y, z]: [usize; 2]) {
        let n = part.grid.dims[0];
        [&mut self.near, &mut self.lean].into_iter().for_each(|row| row.resize(n, 0));
        let none = |row: &mut Vec<i8>| {
            row.clear();
            row.resize(n, 0);
        };
        [&mut self.y, &mut self.z, &mut self.beside].into_iter().for_each(none);
        if y > 0 {
            self.y.copy_from_slice(part.marks([y - 1, z]));
        }
        if z > 0 {
            self.z.copy_from_slice(part.marks([y, z - 1]));
        }
        let beside = if y > 0 { &self.y } else { &self.z };
        self.beside[..n - 1].copy_from_slice(&beside[1..]);
        let mut sums = Sums { near: &mut self.near, lean: &mut self.lean };
        let from = |axis: usize| &field.parts[class.part() ^ 1 << axis];
        let rows = |axis: usize| {
            let (i, dims) = ([0, y, z][axis], from(axis).grid.dims);
            let next = if i + 1 < dims[axis] { i + 1 } else { i };
            if axis == 1 {
                [from(1).marks([y, z]), from(1).marks([next, z])]
            } else {
                [from(2).marks([y, z]), from(2).marks([y, next])]
            }
        };
        let none: &[i8] = &[];
        let x = if class.odd[0] { from(0).marks([y, z]) } else { none };
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

/// Where sums of marks go.
struct Sums<'a> {
    near: &'a mut [u8],
    lean: &'a mut [u8],
}

impl Sums<'_> {
    /// Sums the marks of neighbours on the row `x`, if it has any, and on `rows`.
    fn add<const R: usize>(&mut self, x: &[i8], rows: [&[i8]; R]) {
        let n = self.near.len();
        let rows = rows.map(|row| &row[..n]);
        let at = |i: usize| rows.map(|row| i16::from(row[i]));
        let Some(next) = x.get(1..) else {
            for (i, to) in self.near.iter_mut().zip(self.lean.iter_mut()).enumerate() {
                (*to.0, *to.1) = sums([], at(i));
            }
            return;
        };
        for (i, ((to, lean), (&a, &b))) in
            self.near.iter_mut().zip(self.lean.iter_mut()).zip(x.iter().zip(next)).enumerate()
        {
            (*to, *lean) = sums([i16::from(a), i16::from(b)], at(i));
        }
        if next.len() < n {
            let a = i16::from(x[n - 1]);
            (self.near[n - 1], self.lean[n - 1]) = sums([a, a], at(n - 1));
        }
    }
}

/// Sum of magnitudes, and sign of the sum.
#[inline(always)]
fn sums<const X: usize, const R: usize>(x: [i16; X], rows: [i16; R]) -> (u8, u8) {
    let near = x.iter().chain(&rows).map(|m| m.abs()).sum::<i16>().min(255);
    let lean: i16 = x.iter().chain(&rows).sum();
    (near as u8, (1 + i16::from(lean > 0) - i16::from(lean < 0)) as u8)
}

/// What the contexts of a class have in common.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    odds: usize,
    class: usize,
    level: usize,
}

impl Kind {
    /// The class on the level of this number.
    pub fn new(class: Class, level: usize) -> Self {
        Self { odds: class.odds() - 1, class: class.number, level }
    }
}

impl Context {
    /// The context of point `i` of a row, with `mark` at the point before it.
    #[inline(always)]
    pub fn new(kind: Kind, known: &Known, i: usize, mark: i8, surroundings: u16) -> Self {
        let (bx, by, bz) = (i32::from(mark), i32::from(known.y[i]), i32::from(known.z[i]));
        let beside = i32::from(known.beside[i]).unsigned_abs();
        let near = u32::from(known.near[i]);
        let (x, y, z) = (bx.unsigned_abs(), by.unsigned_abs(), bz.unsigned_abs());
        let back = x + y + z;
        let around = usize::from(surroundings);
        let (slope, bend, rising) = (around & 15, around >> 4 & 15, around >> 8);
        let Kind { odds, class, level } = kind;
        let kind = level.min(2) * 3 + odds;
        let total = bin(near + 2 * (back + beside));
        let fine = (near + 2 * back + beside).min(15) as usize;
        let (x, y, z) = (x.min(2) as usize, y.min(2) as usize, z.min(2) as usize);
        let a = (kind * 8 + bin(near)) * 8 + bin(back + beside);
        let b = (odds * 16 + slope) * 16 + bend;
        let c = (class * 4 + level.min(3)) * 16 + fine;
        let d = (odds * 16 + bend) * 8 + total;
        let e = (((odds * 3 + x) * 9 + 3 * y + z) * 4 + near.min(3) as usize) * 2 + beside.min(1) as usize;
        let at = [a, b, c, d, e];
        let sign = (rising * 9 + usize::from(known.lean[i]) * 3 + sign(bx + by + bz)) + 27 * odds;
        Self { at, mixer: kind * 2 + total.min(1), sign, total }
    }
}

/// The mark of a residual.
#[inline]
pub fn saturated(steps: i32) -> i8 {
    steps.clamp(-i32::from(LARGE), i32::from(LARGE)) as i8
}

/// Places on a row of `n` points within a block.
#[inline]
pub fn places(block: usize, n: usize) -> Range<usize> {
    block * BLOCK..n.min((block + 1) * BLOCK)
}
