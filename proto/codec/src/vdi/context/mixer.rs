//! One decision out of four opinions, averaged in the logistic domain with weights learnt on the way.
//!
//! Contexts are many, and most of the time goes into waiting for their chances: so a chance takes two bytes. All else is on 16
//! bits too, which processors do for all opinions at once.
use crate::entropy::logistic::Tables;
use crate::entropy::range_coder::Coder;
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

    /// Moves it towards what was seen. Nothing that it comes to from where it begins leaves its 16 bits.
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
    fn every_chance_there_can_be_moves_towards_what_was_seen_and_stays_in_range() {
        let (mut known, mut next) = (std::collections::HashSet::new(), vec![Chance::default()]);
        while let Some(chance) = next.pop() {
            if !known.insert(chance.0) {
                continue;
            }
            for bit in [true, false] {
                let mut learnt = chance;
                learnt.learn(bit);
                let moved = learnt.probability() as i32 - chance.probability() as i32;
                assert!(if bit { moved >= 0 } else { moved <= 0 }, "{chance:?} to {learnt:?}");
                assert!(
                    (1..4096).contains(&learnt.probability())
                        && learnt.0 & 15 == (chance.0 & 15).saturating_add(1).min(15)
                );
                next.push(learnt);
            }
        }
        // What never changes becomes as good as certain: within 9 of 4096, where a 16.5th of the way is less than half of one.
        let ends = known.iter().map(|&v| Chance(v).probability());
        assert!(ends.clone().min().unwrap() <= 9 && ends.max().unwrap() >= 4096 - 9);
    }

    #[test]
    fn weights_stop_at_two() {
        let (mut coder, mut mixer) = (crate::entropy::range_coder::Encoder::default(), Mixer::default());
        let sure = [Chance(32_000), Chance(-32_000), Chance(0), Chance(0)];
        for _ in 0..10_000 {
            let [mut a, mut b, mut c, mut d] = sure;
            decide(&mut coder, Tables::get(), &mut mixer, [&mut a, &mut b, &mut c, &mut d], true);
        }
        let [right, wrong, ..] = mixer.0;
        assert!(right > wrong && mixer.0[2] == mixer.0[3], "{mixer:?}");
        mixer.0 = [32_767, -32_768, 0, 0];
        let [mut a, mut b, mut c, mut d] = sure;
        decide(&mut coder, Tables::get(), &mut mixer, [&mut a, &mut b, &mut c, &mut d], true);
        assert_eq!(mixer.0, [32_767, -32_768, 0, 0], "not beyond");
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
