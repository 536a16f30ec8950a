//! Symbol coder: binarizes flags and integers, and codes each bit by context mixing of four models.
use super::mixer::{BitModel16, INPUTS, Mixer16, code_mixed_bit};
use crate::entropy::logistic::LogisticTables;
use crate::entropy::range_coder::Coder;

/// One hashed context for each model: see [`hash`].
pub(super) type Contexts = [u32; INPUTS];

/// Models that share a cache line: the nodes of five levels of a binary tree.
const NODES_PER_LINE: usize = 32;
/// Mixers of one kind of symbol.
const MIXERS_PER_KIND: usize = 64;
/// Largest number of binary digits after the first.
const MAX_LENGTH: u32 = 25;
/// Digits after the first that are modeled; the others are coded as uniform.
const MODELED_DIGITS: u32 = 3;

/// Coder of one kind of symbol, with its adaptive state.
pub(super) struct SymbolCoder {
    tables: &'static LogisticTables,
    /// Hash table of models, per input.
    models: [Vec<[BitModel16; NODES_PER_LINE]>; INPUTS],
    /// Base-2 logarithm of the number of lines of each table.
    bits: u32,
    mixers: Vec<[Mixer16; MIXERS_PER_KIND]>,
}

/// The models of one group of tree nodes in the given contexts.
struct NodeGroup<'a> {
    tables: &'static LogisticTables,
    lines: [&'a mut [BitModel16; NODES_PER_LINE]; INPUTS],
    mixers: &'a mut [Mixer16; MIXERS_PER_KIND],
}

impl NodeGroup<'_> {
    #[inline(always)]
    fn code_mixed_bit<C: Coder>(&mut self, coder: &mut C, node: u32, mixer: u32, bit: bool) -> bool {
        let models = self.lines.each_mut().map(|line| &mut line[node as usize % NODES_PER_LINE]);
        code_mixed_bit(coder, self.tables, &mut self.mixers[mixer as usize % MIXERS_PER_KIND], models, bit)
    }
}

/// Hash of three numbers.
#[inline(always)]
pub(super) fn hash(a: u32, b: u32, c: u32) -> u32 {
    let sum = a.wrapping_mul(0x9E37_79B1)
        ^ b.wrapping_mul(0x85EB_CA6B).rotate_left(13)
        ^ c.wrapping_mul(0xC2B2_AE35).rotate_left(7);
    (sum ^ sum >> 15).wrapping_mul(0x2C1B_3C6D)
}

/// Zigzag code: 0, -1, 1, -2, .. become 0, 1, 2, 3, ..
pub(super) fn fold(d: i32) -> u32 {
    (d << 1 ^ d >> 31) as u32
}

/// Undoes [`fold`].
pub(super) fn unfold(n: u32) -> i32 {
    (n >> 1) as i32 ^ -((n & 1) as i32)
}

impl SymbolCoder {
    /// Untrained models: tables of 2^`bits` lines per input, and mixers for `kinds` kinds of symbol.
    pub(super) fn new(bits: u32, kinds: usize) -> Self {
        let models = std::array::from_fn(|_| vec![[BitModel16::default(); NODES_PER_LINE]; 1 << bits]);
        let mixers = vec![std::array::from_fn(|_| Mixer16::default()); kinds];
        Self { tables: LogisticTables::get(), models, bits, mixers }
    }

    /// The models of tree group `group` in these contexts.
    #[inline(always)]
    fn group(&mut self, contexts: &Contexts, group: u32, kind: usize) -> NodeGroup<'_> {
        let place = |context: u32| (context ^ group.wrapping_mul(0x9E37_79B1)).wrapping_mul(0x85EB_CA6B);
        let bits = self.bits;
        let mut models = self.models.iter_mut().zip(contexts);
        let mut line = |_| {
            let (lines, &context) = models.next().expect("as many as inputs");
            &mut lines[(place(context) >> (32 - bits)) as usize]
        };
        NodeGroup { tables: self.tables, lines: std::array::from_fn(&mut line), mixers: &mut self.mixers[kind] }
    }

    /// Codes one bit.
    pub(super) fn code_flag<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, kind: usize, bit: bool) -> bool {
        self.group(contexts, 0, kind).code_mixed_bit(coder, 0, 0, bit)
    }

    /// Codes a number of `bits` (at most 24) bits as a path in a binary tree, the highest bit first.
    pub(super) fn code_tree<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: &Contexts,
        bits: u32,
        kind: usize,
        number: u32,
    ) -> u32 {
        let (mut node, mut left) = (1, bits);
        while left > 0 {
            let group = if left == bits { 0 } else { node };
            let mut group = self.group(contexts, group, kind);
            let mut within = 1;
            while left > 0 && within < NODES_PER_LINE as u32 {
                left -= 1;
                let bit = group.code_mixed_bit(coder, within, left, number >> left & 1 == 1);
                within = within << 1 | u32::from(bit);
                node = node << 1 | u32::from(bit);
            }
        }
        node ^ 1 << bits
    }

    /// Codes a number below 2^26 - 1 in Exp-Golomb code: the length of its successor in binary, then the digits, of which the
    /// first three after the leading one are modeled.
    pub(super) fn code_number<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: &Contexts,
        kind: usize,
        number: u32,
    ) -> u32 {
        let wanted = number.wrapping_add(1);
        let length = 31 - wanted.max(1).leading_zeros();
        let mut group = self.group(contexts, 0, kind);
        let mut n = 0;
        while n < MAX_LENGTH && group.code_mixed_bit(coder, (n + 1).min(15), n.min(15), length > n) {
            n += 1;
        }
        if n == 0 {
            return 0;
        }
        // Digits of numbers with up to three of them share the cache line of the lengths.
        let first = [0, 16, 17, 20].get(n as usize).copied();
        if first.is_none() {
            group = self.group(contexts, n, kind);
        }
        let (first, modeled) = (first.unwrap_or(0), n.min(MODELED_DIGITS));
        let mut found = 1;
        for digit in 0..modeled {
            let mixer = 16 + n.min(15) * MODELED_DIGITS + digit;
            let bit = group.code_mixed_bit(coder, first + found, mixer, wanted >> (n - 1 - digit) & 1 == 1);
            found = found << 1 | u32::from(bit);
        }
        let rest = n - modeled;
        let high = rest.saturating_sub(16);
        if high > 0 {
            found = found << high | coder.code_uniform(high, wanted >> 16);
        }
        let low = rest - high;
        if low > 0 {
            found = found << low | coder.code_uniform(low, wanted);
        }
        found - 1
    }
}
