//! One decision out of five opinions: the probabilities of five models are averaged in the logistic domain with weights learnt
//! on the way.
use crate::entropy::logistic::{Chance, Tables};
use crate::entropy::range_coder::Coder;

/// Opinions a decision.
pub const OPINIONS: usize = 5;
/// Decisions after which the rate of each stays.
const SETTLED: [u8; OPINIONS] = [60, 90, 40, 90, 60];
/// A weight of one.
const ONE: i32 = 1 << 16;
/// Largest weight: the sum of all opinions with it is below 2^31.
const MOST: i32 = 3 * ONE;
/// Shift of what a mixer learns from one decision.
const RATE: u32 = 12;

/// The weights of one kind of decision.
#[derive(Debug, Clone)]
pub struct Mixer([i32; OPINIONS]);

impl Default for Mixer {
    fn default() -> Self {
        Self([ONE * 7 / 4 / OPINIONS as i32; OPINIONS])
    }
}

/// A decision by several models, weighed by `mixer`.
#[inline(always)]
pub fn mixed(
    coder: &mut impl Coder,
    tables: &Tables,
    mixer: &mut Mixer,
    models: [&mut Chance; OPINIONS],
    bit: bool,
) -> bool {
    let mut opinions = [0; OPINIONS];
    let mut sum = 0;
    for i in 0..OPINIONS {
        opinions[i] = i32::from(tables.stretch(models[i].coarse()));
        sum += opinions[i] * mixer.0[i];
    }
    let probability = tables.squash(sum >> 16);
    let bit = coder.at(probability, bit);
    let error = if bit { 65536 - probability as i32 } else { -(probability as i32) };
    for (weight, opinion) in mixer.0.iter_mut().zip(opinions) {
        *weight = (*weight + ((opinion * (error >> 4) + (1 << (RATE - 1))) >> RATE)).clamp(-MOST, MOST);
    }
    models.into_iter().zip(SETTLED).for_each(|(model, settled)| model.learn(bit, settled));
    bit
}
