//! Context mixing for VDIs: four bit models predict each bit, and a mixer averages them in the logistic domain with adaptive
//! weights (M. Mahoney, Florida Tech CS-2005-16).
//!
//! There are so many contexts that cache misses on their models dominate the time: a model takes two bytes. All other
//! arithmetic is 16 bits wide too, so that a processor handles the four inputs in one instruction.
use crate::entropy::logistic::LogisticTables;
use crate::entropy::range_coder::Coder;
use std::array::from_fn;

/// Adaptive probability of a set bit. The highest twelve bits are its difference from one half, in 1/4096; the lowest four
/// count the bits seen.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BitModel16(i16);

/// Adaptation rate after n bits, in 1/32768: 1 / (n + 1.5).
const RATES: [i32; 16] = rates();

const fn rates() -> [i32; 16] {
    let (mut rates, mut n) = ([0; 16], 0);
    while n < 16 {
        rates[n] = (65_536 / (2 * n + 3)) as i32;
        n += 1;
    }
    rates
}

/// Rounding term: half of 1/4096, in 1/32768 of a model's unit.
const HALF: i32 = 8 << 15;

impl BitModel16 {
    /// Probability of a set bit, in 1/4096.
    #[inline(always)]
    fn probability(self) -> u32 {
        ((i32::from(self.0) >> 4) + 2048) as u32
    }

    /// Moves the probability towards `bit`. No sequence of bits takes it out of 16 bits.
    #[inline(always)]
    fn update(&mut self, bit: bool) {
        let v = i32::from(self.0);
        let count = v & 15;
        let goal = if bit { 32767 } else { -32768 };
        let change = ((goal - v) * RATES[count as usize] + HALF) >> 15 & !15;
        self.0 = (v + change + i32::from(count < 15)) as i16;
    }
}

/// Fixed-point weight of one.
const ONE: i32 = 1 << 14;

/// Models that are mixed for each bit.
pub(super) const INPUTS: usize = 4;

/// Weights of the inputs for one kind of bit, each within -2 to 2.
#[derive(Debug, Clone)]
pub(super) struct Mixer16([i16; INPUTS]);

impl Default for Mixer16 {
    fn default() -> Self {
        Self([(ONE * 3 / 2) as i16 / INPUTS as i16; INPUTS])
    }
}

/// Codes or reads one bit with the mean of the `models`' predictions, weighted by `mixer`; updates both. Returns the bit.
#[inline(always)]
pub(super) fn code_mixed_bit<C: Coder>(
    coder: &mut C,
    tables: &LogisticTables,
    mixer: &mut Mixer16,
    models: [&mut BitModel16; INPUTS],
    bit: bool,
) -> bool {
    let inputs: [i16; INPUTS] = from_fn(|k| tables.stretch(models[k].probability()));
    let sum: i32 = (0..INPUTS).map(|k| i32::from(inputs[k]) * i32::from(mixer.0[k])).sum();
    let probability = tables.squash(sum >> 14);
    let bit = coder.code_bit(probability, bit);
    let error = ((i32::from(bit) << 16) - probability as i32) >> 1;
    for (weight, input) in mixer.0.iter_mut().zip(inputs) {
        let change = (i32::from(input * 2) * i32::from(error as i16)) >> 16;
        *weight = weight.saturating_add((change as i16 + 1) >> 1);
    }
    models.into_iter().for_each(|model| model.update(bit));
    bit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_chance_there_can_be_moves_towards_what_was_seen_and_stays_in_range() {
        let (mut known, mut next) = (std::collections::HashSet::new(), vec![BitModel16::default()]);
        while let Some(model) = next.pop() {
            if !known.insert(model.0) {
                continue;
            }
            for bit in [true, false] {
                let mut updated = model;
                updated.update(bit);
                let moved = updated.probability() as i32 - model.probability() as i32;
                assert!(if bit { moved >= 0 } else { moved <= 0 }, "{model:?} to {updated:?}");
                assert!(
                    (1..4096).contains(&updated.probability())
                        && updated.0 & 15 == (model.0 & 15).saturating_add(1).min(15)
                );
                next.push(updated);
            }
        }
        // What never changes becomes as good as certain: within 9 of 4096, where a 16.5th of the way is less than half of one.
        let ends = known.iter().map(|&v| BitModel16(v).probability());
        assert!(ends.clone().min().unwrap() <= 9 && ends.max().unwrap() >= 4096 - 9);
    }

    #[test]
    fn weights_stop_at_two() {
        let (mut coder, mut mixer) = (crate::entropy::range_coder::Encoder::default(), Mixer16::default());
        let sure = [BitModel16(32_000), BitModel16(-32_000), BitModel16(0), BitModel16(0)];
        for _ in 0..10_000 {
            let [mut a, mut b, mut c, mut d] = sure;
            code_mixed_bit(&mut coder, LogisticTables::get(), &mut mixer, [&mut a, &mut b, &mut c, &mut d], true);
        }
        let [right, wrong, ..] = mixer.0;
        assert!(right > wrong && mixer.0[2] == mixer.0[3], "{mixer:?}");
        mixer.0 = [32_767, -32_768, 0, 0];
        let [mut a, mut b, mut c, mut d] = sure;
        code_mixed_bit(&mut coder, LogisticTables::get(), &mut mixer, [&mut a, &mut b, &mut c, &mut d], true);
        assert_eq!(mixer.0, [32_767, -32_768, 0, 0], "not beyond");
    }

    #[test]
    fn a_chance_is_the_mean_of_what_it_saw_at_first() {
        let mut model = BitModel16::default();
        for (n, bit) in [true, false, false, true, false, false].into_iter().enumerate() {
            model.update(bit);
            // Half an observation of each before the first.
            let set = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0][n] + 0.25;
            let mean = 4096.0 * set / (n as f64 + 1.5);
            assert!((f64::from(model.probability()) - mean).abs() < 4.0, "{n}: {mean}");
        }
    }
}
