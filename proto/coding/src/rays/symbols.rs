//! Numbers by decisions, each the mixed opinion of six models that know different things of what is around.
use crate::coder::Coder;
use crate::mix::{Chance, Mixer, Mixing, ONE, Tables, mixed};

/// Opinions a decision.
pub const OPINIONS: usize = 6;
/// How they are mixed.
const MIXING: Mixing<OPINIONS> = Mixing { settled: [40; OPINIONS], most: 2 * ONE, rate: 11 };

/// What each opinion goes by: see [`hash`].
pub type Contexts = [u32; OPINIONS];

/// Chances that lie together: the nodes of four levels of a binary tree.
const LINE: usize = 16;
/// Mixers of a number: of the decisions on its length, and of its first digits.
const NUMBER: usize = 64;
/// The longest number in binary, digits after the first.
const LONGEST: u32 = 25;
/// The most levels of a tree.
const TREE: usize = 24;

/// Learns the decisions of one kind of number.
pub struct Symbols {
    tables: &'static Tables,
    /// Chances of all opinions, by opinion.
    chances: [Vec<[Chance; LINE]>; OPINIONS],
    /// Lines of an opinion are two to this power.
    bits: u32,
    mixers: Vec<Mixer<OPINIONS>>,
}

/// Three numbers as one.
#[inline(always)]
pub fn hash(a: u32, b: u32, c: u32) -> u32 {
    let sum = a.wrapping_mul(0x9E37_79B1)
        ^ b.wrapping_mul(0x85EB_CA6B).rotate_left(13)
        ^ c.wrapping_mul(0xC2B2_AE35).rotate_left(7);
    (sum ^ sum >> 15).wrapping_mul(0x2C1B_3C6D)
}

/// 0, -1, 1, -2, .. as 0, 1, 2, 3, ..
pub fn fold(d: i32) -> u32 {
    (d << 1 ^ d >> 31) as u32
}

/// Undoes [`fold`].
pub fn unfold(n: u32) -> i32 {
    (n >> 1) as i32 ^ -((n & 1) as i32)
}

impl Symbols {
    /// For trees, with so many `kinds` of mixers, in two to the power of `bits` chances an opinion.
    pub fn of_trees(bits: u32, kinds: usize) -> Self {
        Self::new(bits, kinds * TREE)
    }

    /// The same for numbers without end.
    pub fn of_numbers(bits: u32, kinds: usize) -> Self {
        Self::new(bits, kinds * NUMBER)
    }

    fn new(bits: u32, mixers: usize) -> Self {
        let bits = bits - LINE.ilog2();
        let chances = std::array::from_fn(|_| vec![[Chance::default(); LINE]; 1 << bits]);
        Self { tables: Tables::get(), chances, bits, mixers: vec![Mixer::default(); mixers] }
    }

    /// Where the chances of a `group` of decisions lie, by opinion.
    #[inline(always)]
    fn lines(&self, contexts: &Contexts, group: u32) -> [usize; OPINIONS] {
        let mixed = |context: u32| (context ^ group.wrapping_mul(0x9E37_79B1)).wrapping_mul(0x85EB_CA6B);
        contexts.map(|context| (mixed(context) >> (32 - self.bits)) as usize)
    }

    #[inline(always)]
    fn decide<C: Coder>(
        &mut self,
        coder: &mut C,
        lines: &[usize; OPINIONS],
        node: u32,
        mixer: usize,
        bit: bool,
    ) -> bool {
        let node = node as usize % LINE;
        let [a, b, c, d, e, f] = &mut self.chances;
        let [i, j, k, l, m, n] = *lines;
        let models =
            [&mut a[i][node], &mut b[j][node], &mut c[k][node], &mut d[l][node], &mut e[m][node], &mut f[n][node]];
        mixed(coder, self.tables, &MIXING, &mut self.mixers[mixer], models, bit)
    }

    /// A single decision.
    pub fn bit<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, kind: usize, bit: bool) -> bool {
        let lines = self.lines(contexts, 0);
        self.decide(coder, &lines, 0, kind * TREE, bit)
    }

    /// A number of so many `bits`, at most 24, the highest first.
    pub fn tree<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, bits: u32, kind: usize, number: u32) -> u32 {
        let mut lines = self.lines(contexts, 0);
        let (mut node, mut within) = (1, 1);
        for level in (0..bits).rev() {
            let bit = self.decide(coder, &lines, within, kind * TREE + level as usize, number >> level & 1 == 1);
            node = node << 1 | u32::from(bit);
            within = within << 1 | u32::from(bit);
            if within >= LINE as u32 {
                within = 1;
                lines = self.lines(contexts, node);
            }
        }
        node ^ 1 << bits
    }

    /// A number below 2^26 - 1: by the length of its successor in binary, then its digits, of which the first three are learnt.
    pub fn number<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, kind: usize, number: u32) -> u32 {
        let wanted = number.wrapping_add(1);
        let length = 31 - wanted.max(1).leading_zeros();
        let first = kind * NUMBER;
        let lines = self.lines(contexts, 0);
        let mut n = 0;
        while n < LONGEST && self.decide(coder, &lines, (n + 1).min(15), first + n.min(15) as usize, length > n) {
            n += 1;
        }
        if n == 0 {
            return 0;
        }
        let lines = self.lines(contexts, n);
        let (mut found, learnt) = (1, n.min(3));
        for digit in 0..learnt {
            let mixer = first + 16 + (n.min(15) * 3 + digit) as usize;
            let bit = self.decide(coder, &lines, found, mixer, wanted >> (n - 1 - digit) & 1 == 1);
            found = found << 1 | u32::from(bit);
        }
        let rest = n - learnt;
        let high = rest.saturating_sub(16);
        if high > 0 {
            found = found << high | coder.even(high, wanted >> 16);
        }
        let low = rest - high;
        (found << low | coder.even(low, wanted)) - 1
    }
}
