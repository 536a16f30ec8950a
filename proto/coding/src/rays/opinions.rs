//! One decision out of four opinions, averaged in the logistic domain with weights learnt on the way.
//!
//! Contexts are many, and most of the time goes into waiting for their chances: so a chance takes two bytes. All else is on 16
//! bits too, which processors do for all opinions at once.
use crate::coder::Coder;
use crate::mix::Tables;
use std::array::from_fn;

/// The probability of a set bit, learnt from its past. The highest twelve bits are its distance from a half, in 1/4096; the
/// lowest four count decisions.
#[derive(Debug, Clone, Copy, Default)]
pub struct Chance(i16);

/// How much of the way to what was seen a chance moves after n decisions, in 1/32768: 1 / (n + 1.5).
const RATES: [i32; 16] = rates();

const fn rates() -> [i32; 16] {
    let (mut rates, mut n) = ([0; 16], 0);
    while n < 16 {
        rates[n] = (65_536 / (2 * n + 3)) as i32;
        n += 1;
    }
    rates
}

/// Half of 1/4096, in 1/32768 of the unit of a chance.
const HALF: i32 = 8 << 15;

impl Chance {
    /// Of a set bit, in 1/4096.
    #[inline(always)]
    fn probability(self) -> u32 {
        ((i32::from(self.0) >> 4) + 2048) as u32
    }

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let v = i32::from(self.0);
        let count = v & 15;
        let goal = if bit { 32767 } else { -32768 };
        let change = ((goal - v) * RATES[count as usize] + HALF) >> 15 & !15;
        self.0 = (v + change + i32::from(count < 15)) as i16;
    }
}

/// A weight of one.
const ONE: i32 = 1 << 14;

/// Opinions a decision.
pub const OPINIONS: usize = 4;

/// The weights of the opinions on one kind of decision: up to 2.
#[derive(Debug, Clone)]
pub struct Mixer([i16; OPINIONS]);

impl Default for Mixer {
    fn default() -> Self {
        Self([(ONE * 3 / 2) as i16 / OPINIONS as i16; OPINIONS])
    }
}

/// A decision by several opinions, weighed by `mixer`.
#[inline(always)]
pub fn decide<C: Coder>(
    coder: &mut C,
    tables: &Tables,
    mixer: &mut Mixer,
    chances: [&mut Chance; OPINIONS],
    bit: bool,
) -> bool {
    let opinions: [i16; OPINIONS] = from_fn(|k| tables.stretch(chances[k].probability()));
    let sum: i32 = (0..OPINIONS).map(|k| i32::from(opinions[k]) * i32::from(mixer.0[k])).sum();
    let probability = tables.squash(sum >> 14);
    let bit = coder.at(probability, bit);
    let error = ((i32::from(bit) << 16) - probability as i32) >> 1;
    for (weight, opinion) in mixer.0.iter_mut().zip(opinions) {
        let change = (i32::from(opinion * 2) * i32::from(error as i16)) >> 16;
        *weight = weight.saturating_add((change as i16 + 1) >> 1);
    }
    chances.into_iter().for_each(|chance| chance.learn(bit));
    bit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chance_becomes_certain_at_either_end_and_comes_back() {
        for bit in [true, false] {
            let mut chance = Chance::default();
            let of = |chance: Chance| if bit { chance.probability() } else { 4096 - chance.probability() };
            let mut last = 2048;
            for _ in 0..1000 {
                chance.learn(bit);
                assert!((last..=4096).contains(&of(chance)), "{last} to {}", of(chance));
                last = of(chance);
            }
            // It stays where what is left of the way is below half of 1/4096: 16.5 / 2.
            assert!(last >= 4096 - 9, "{last}");
            chance.learn(!bit);
            let back = of(chance);
            assert!(last.abs_diff(back) >= last / 17 && back > 3800, "{last} to {back}");
        }
    }

    #[test]
    fn a_chance_is_the_mean_of_what_it_saw_at_first() {
        let mut chance = Chance::default();
        for (n, bit) in [true, false, false, true, false, false].into_iter().enumerate() {
            chance.learn(bit);
            // Half an observation of each before the first.
            let set = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0][n] + 0.25;
            let mean = 4096.0 * set / (n as f64 + 1.5);
            assert!((f64::from(chance.probability()) - mean).abs() < 4.0, "{n}: {mean}");
        }
    }
}
