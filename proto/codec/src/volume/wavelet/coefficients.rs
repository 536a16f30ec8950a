//! Coding of quantized wavelet coefficients, coarse to fine, in mixed contexts: magnitudes already coded beside a coefficient, at
//! the same place of the next coarser level, and of the other orientations of its own level.
use crate::entropy::logistic::{BitModel, LogisticTables, code_bit};
use crate::entropy::range_coder::Coder;
use crate::volume::mixer::{Mixer, code_mixed_bit};
use crate::volume::symbols::bin;

/// Context-mixed bits of a magnitude: is it above 0, above 1, above 2, above 3.
const STAGES: usize = 4;
/// Longest excess over [`STAGES`], in binary digits.
const LONGEST: u32 = 29;
/// Orientations of a level in the order of coding: which axes have high coefficients, one bit an axis.
const ORIENTATIONS: [usize; 7] = [1, 2, 4, 3, 5, 6, 7];
/// Zeros around a subband on every side.
const PAD: usize = 2;

type StageModels = [BitModel; STAGES];

/// All models of a band.
struct CoefficientModels {
    tables: &'static LogisticTables,
    by_input: [Vec<StageModels>; 5],
    mixers: Vec<[Mixer; STAGES]>,
    signs: Vec<BitModel>,
    lengths: Vec<[BitModel; LONGEST as usize]>,
}

/// Contexts of one coefficient.
struct CoefficientContext {
    at: [usize; 5],
    mixer: usize,
    sign: usize,
    length: usize,
}

/// Coefficients of one orientation and level, saturated to -127..=127, or sums of magnitudes; zeros around them.
struct PaddedBox {
    sides: [usize; 3],
    strides: [usize; 3],
    values: Vec<i8>,
}

impl PaddedBox {
    fn new(sides: [usize; 3]) -> Self {
        let [x, y, z] = sides.map(|n| n + 2 * PAD);
        Self { sides, strides: [1, x, x * y], values: vec![0; x * y * z] }
    }

    fn index(&self, at: [usize; 3]) -> usize {
        (0..3).map(|axis| (at[axis] + PAD) * self.strides[axis]).sum()
    }

    #[inline(always)]
    fn magnitude(&self, n: usize) -> u32 {
        u32::from(self.values[n].unsigned_abs())
    }

    /// Sum of the magnitudes at the six neighbors.
    #[inline(always)]
    fn around(&self, n: usize) -> u32 {
        self.strides.iter().map(|s| self.magnitude(n - s) + self.magnitude(n + s)).sum()
    }
}

impl Default for CoefficientModels {
    fn default() -> Self {
        let models = |count| vec![StageModels::default(); count];
        Self {
            tables: LogisticTables::get(),
            by_input: [models(4 * 64), models(32 * 64), models(4 * 64 * 4), models(4 * 512), models(64 * 32)],
            mixers: (0..64 * 4).map(|_| Default::default()).collect(),
            signs: vec![BitModel::default(); 8 * 27],
            lengths: vec![[BitModel::default(); LONGEST as usize]; 8],
        }
    }
}

/// Codes `quantized`, laid out as the transform leaves it, or reads it in place.
pub(super) fn code(coder: &mut impl Coder, quantized: &mut [i32], dims: [usize; 3], levels: &[[usize; 3]]) {
    let mut models = CoefficientModels::default();
    let last = levels.len() - 1;
    // What is left of the low coefficients has no orientation.
    let low = Subband { orientation: 0, level: last, depth: 0, origin: [0; 3], sides: levels[last] };
    low.code(coder, &mut models, quantized, dims, None, None);
    let mut coarser: [Option<PaddedBox>; 8] = Default::default();
    for level in (0..last).rev() {
        let (whole, low) = (levels[level], levels[level + 1]);
        let mut seen = PaddedBox::new(low);
        let mut this: [Option<PaddedBox>; 8] = Default::default();
        for orientation in ORIENTATIONS {
            let high = |axis: usize| orientation >> axis & 1 == 1;
            if (0..3).any(|axis| high(axis) && low[axis] == whole[axis]) {
                continue;
            }
            let origin = [0, 1, 2].map(|axis| if high(axis) { low[axis] } else { 0 });
            let sides = [0, 1, 2].map(|axis| if high(axis) { whole[axis] - low[axis] } else { low[axis] });
            let band = Subband { orientation, level, depth: last - level, origin, sides };
            let halved = levels.get(level + 2).map(|coarse| [0, 1, 2].map(|axis| coarse[axis] != low[axis]));
            let parent = coarser[orientation].as_ref().zip(halved);
            let coded = band.code(coder, &mut models, quantized, dims, parent, Some(&seen));
            for z in 0..sides[2] {
                for y in 0..sides[1] {
                    let (to, from) = (seen.index([0, y, z]), coded.index([0, y, z]));
                    for (sum, c) in seen.values[to..to + sides[0]].iter_mut().zip(&coded.values[from..]) {
                        *sum = sum.saturating_add(c.saturating_abs());
                    }
                }
            }
            this[orientation] = Some(coded);
        }
        coarser = this;
    }
}

/// A box of coefficients.
struct Subband {
    orientation: usize,
    /// 0 is the finest.
    level: usize,
    /// 0 is the coarsest.
    depth: usize,
    origin: [usize; 3],
    sides: [usize; 3],
}

impl Subband {
    /// Codes all coefficients; returns them. `parent` is the same orientation of the next coarser level, with the axes that
    /// level has halved, `seen` the sum over the orientations coded before.
    fn code(
        &self,
        coder: &mut impl Coder,
        models: &mut CoefficientModels,
        quantized: &mut [i32],
        dims: [usize; 3],
        parent: Option<(&PaddedBox, [bool; 3])>,
        seen: Option<&PaddedBox>,
    ) -> PaddedBox {
        let mut coded = PaddedBox::new(self.sides);
        for z in 0..self.sides[2] {
            for y in 0..self.sides[1] {
                let row = ((self.origin[2] + z) * dims[1] + self.origin[1] + y) * dims[0] + self.origin[0];
                let here = coded.index([0, y, z]);
                let beside = seen.map(|seen| (seen, seen.index([0, y, z])));
                for x in 0..self.sides[0] {
                    let above = parent.map(|(parent, halved)| {
                        let at = [x, y, z];
                        let place = |axis: usize| {
                            (if halved[axis] { at[axis] / 2 } else { at[axis] }).min(parent.sides[axis] - 1)
                        };
                        let n = parent.index([place(0), place(1), place(2)]);
                        [parent.magnitude(n), parent.around(n)]
                    });
                    let others = beside.map(|(seen, n)| [seen.magnitude(n + x), seen.around(n + x)]);
                    let context = self.context(&coded, here + x, above.unwrap_or_default(), others.unwrap_or_default());
                    let value = models.coefficient(coder, &context, quantized[row + x]);
                    quantized[row + x] = value;
                    coded.values[here + x] = value.clamp(-127, 127) as i8;
                }
            }
        }
        coded
    }

    #[inline(always)]
    fn context(&self, coded: &PaddedBox, n: usize, above: [u32; 2], others: [u32; 2]) -> CoefficientContext {
        let [sx, sy, sz] = coded.strides;
        let before = [n - sx, n - sy, n - sz];
        let near: u32 = before.iter().map(|&n| coded.magnitude(n)).sum();
        let diagonal = [n - sy + sx, n - sy - sx, n - sz + sx, n - sz + sy, n - sz - sx, n - sz - sy];
        let diagonal: u32 = diagonal.iter().map(|&n| coded.magnitude(n)).sum();
        let far: u32 = [n - 2 * sx, n - 2 * sy, n - 2 * sz].iter().map(|&n| coded.magnitude(n)).sum();
        let ([parent, parents], [other, around]) = (above, others);
        let (o, fine) = (self.orientation, self.level.min(3));
        let axes = o.count_ones() as usize;
        let total = 2 * near + diagonal + 2 * parent + parents + 2 * other + around;
        let kind = o * 8 + self.depth.min(7);
        let at = [
            (axes * 8 + bin(near)) * 8 + bin(diagonal),
            ((o * 4 + fine) * 8 + bin(parent)) * 8 + bin(parents),
            ((axes * 8 + bin(near + far)) * 8 + bin(2 * parent + parents)) * 4 + fine,
            ((axes * 8 + bin(other)) * 8 + bin(around)) * 8 + bin(near + diagonal),
            kind * 32 + (total / 2).min(31) as usize,
        ];
        let mixer = kind * 4 + usize::from(near + diagonal > 0) * 2 + usize::from(parent + parents > 0);
        let [x, y, z] = before.map(|n| (coded.values[n].signum() + 1) as usize);
        CoefficientContext { at, mixer, sign: ((o * 3 + x) * 3 + y) * 3 + z, length: bin(near) }
    }
}

impl CoefficientModels {
    /// Codes a coefficient, or reads one. Returns it.
    #[inline]
    fn coefficient(&mut self, coder: &mut impl Coder, context: &CoefficientContext, value: i32) -> i32 {
        let magnitude = self.magnitude(coder, context, value.unsigned_abs());
        if magnitude == 0 {
            return 0;
        }
        let negative = code_bit(coder, &mut self.signs[context.sign], value < 0);
        if negative { -(magnitude as i32) } else { magnitude as i32 }
    }

    #[inline(always)]
    fn magnitude(&mut self, coder: &mut impl Coder, context: &CoefficientContext, magnitude: u32) -> u32 {
        let [i, j, k, l, m] = context.at;
        let [a, b, c, d, e] = &mut self.by_input;
        let (a, b, c, d, e) = (&mut a[i], &mut b[j], &mut c[k], &mut d[l], &mut e[m]);
        for stage in 0..STAGES {
            let mixer = &mut self.mixers[context.mixer][stage];
            let models = [&mut a[stage], &mut b[stage], &mut c[stage], &mut d[stage], &mut e[stage]];
            if !code_mixed_bit(coder, self.tables, mixer, models, magnitude > stage as u32) {
                return stage as u32;
            }
        }
        // The excess in Exp-Golomb code: the length of its successor in binary, then its digits.
        let wanted = magnitude.wrapping_sub(STAGES as u32 - 1);
        let length = 31 - wanted.max(1).leading_zeros();
        let models = &mut self.lengths[context.length];
        let mut n = 0;
        while n < LONGEST && code_bit(coder, &mut models[n as usize], length > n) {
            n += 1;
        }
        let high = n.saturating_sub(16);
        let upper = coder.code_uniform(high, wanted >> 16);
        let lower = coder.code_uniform(n - high, wanted);
        ((1 << n) | upper << 16 | lower) + STAGES as u32 - 1
    }
}
