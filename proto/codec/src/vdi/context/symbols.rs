//! Numbers by decisions, each the mixed opinion of four models that know different things of what is around.
use super::mixer::{Chance, Mixer, OPINIONS, decide};
use crate::entropy::logistic::Tables;
use crate::entropy::range_coder::Coder;

/// What each opinion goes by: see [`hash`].
pub type Contexts = [u32; OPINIONS];

/// Chances that lie together, as many bytes as a cache line: the nodes of five levels of a binary tree.
const LINE: usize = 32;
/// Mixers of a kind.
const MIXERS: usize = 64;
/// The longest number in binary, digits after the first.
const LONGEST: u32 = 25;
/// Digits of a number that are learnt.
const LEARNT: u32 = 3;

/// Learns the decisions of one kind of number.
pub struct Symbols {
    tables: &'static Tables,
    /// Chances of all opinions, by opinion.
    chances: [Vec<[Chance; LINE]>; OPINIONS],
    /// Lines of an opinion are two to this power.
    bits: u32,
    mixers: Vec<[Mixer; MIXERS]>,
}

/// Decisions whose chances lie together.
struct Group<'a> {
    tables: &'static Tables,
    lines: [&'a mut [Chance; LINE]; OPINIONS],
    mixers: &'a mut [Mixer; MIXERS],
}

impl Group<'_> {
    #[inline(always)]
    fn decide<C: Coder>(&mut self, coder: &mut C, node: u32, mixer: u32, bit: bool) -> bool {
        let chances = self.lines.each_mut().map(|line| &mut line[node as usize % LINE]);
        decide(coder, self.tables, &mut self.mixers[mixer as usize % MIXERS], chances, bit)
    }
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
    /// With two to the power of `bits` lines an opinion, and so many `kinds` of mixers.
    pub fn new(bits: u32, kinds: usize) -> Self {
        let chances = std::array::from_fn(|_| vec![[Chance::default(); LINE]; 1 << bits]);
        let mixers = vec![std::array::from_fn(|_| Mixer::default()); kinds];
        Self { tables: Tables::get(), chances, bits, mixers }
    }

    /// The decisions of a `group` in these contexts.
    #[inline(always)]
    fn group(&mut self, contexts: &Contexts, group: u32, kind: usize) -> Group<'_> {
        let place = |context: u32| (context ^ group.wrapping_mul(0x9E37_79B1)).wrapping_mul(0x85EB_CA6B);
        let bits = self.bits;
        let mut chances = self.chances.iter_mut().zip(contexts);
        let mut line = |_| {
            let (lines, &context) = chances.next().expect("as many as opinions");
            &mut lines[(place(context) >> (32 - bits)) as usize]
        };
        Group { tables: self.tables, lines: std::array::from_fn(&mut line), mixers: &mut self.mixers[kind] }
    }

    /// A single decision.
    pub fn bit<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, kind: usize, bit: bool) -> bool {
        self.group(contexts, 0, kind).decide(coder, 0, 0, bit)
    }

    /// A number of so many `bits`, at most 24, the highest first.
    pub fn tree<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, bits: u32, kind: usize, number: u32) -> u32 {
        let (mut node, mut left) = (1, bits);
        while left > 0 {
            let group = if left == bits { 0 } else { node };
            let mut group = self.group(contexts, group, kind);
            let mut within = 1;
            while left > 0 && within < LINE as u32 {
                left -= 1;
                let bit = group.decide(coder, within, left, number >> left & 1 == 1);
                within = within << 1 | u32::from(bit);
                node = node << 1 | u32::from(bit);
            }
        }
        node ^ 1 << bits
    }

    /// A number below 2^26 - 1: by the length of its successor in binary, then its digits, of which the first three are learnt.
    pub fn number<C: Coder>(&mut self, coder: &mut C, contexts: &Contexts, kind: usize, number: u32) -> u32 {
        let wanted = number.wrapping_add(1);
        let length = 31 - wanted.max(1).leading_zeros();
        let mut group = self.group(contexts, 0, kind);
        let mut n = 0;
        while n < LONGEST && group.decide(coder, (n + 1).min(15), n.min(15), length > n) {
            n += 1;
        }
        if n == 0 {
            return 0;
        }
        // The digits of numbers with up to three are beside their lengths.
        let first = [0, 16, 17, 20].get(n as usize).copied();
        if first.is_none() {
            group = self.group(contexts, n, kind);
        }
        let (first, learnt) = (first.unwrap_or(0), n.min(LEARNT));
        let mut found = 1;
        for digit in 0..learnt {
            let mixer = 16 + n.min(15) * LEARNT + digit;
            let bit = group.decide(coder, first + found, mixer, wanted >> (n - 1 - digit) & 1 == 1);
            found = found << 1 | u32::from(bit);
        }
        let rest = n - learnt;
        let high = rest.saturating_sub(16);
        if high > 0 {
            found = found << high | coder.even(high, wanted >> 16);
        }
        let low = rest - high;
        if low > 0 {
            found = found << low | coder.even(low, wanted);
        }
        found - 1
    }
}
