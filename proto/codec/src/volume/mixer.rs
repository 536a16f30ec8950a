//! Context mixing for volumes: five bit models, or six, predict each bit, and a mixer averages them in the logistic domain with
//! adaptive weights.
use crate::entropy::logistic::{BitModel, LogisticTables};
use crate::entropy::range_coder::Coder;

/// Models that are mixed for each bit, without and with one for the volume before.
pub(super) const INPUTS: usize = 5;
pub(super) const TEMPORAL_INPUTS: usize = INPUTS + 1;
/// Bits after which the adaptation rate of each model stays constant.
const COUNT_LIMIT: [u8; TEMPORAL_INPUTS] = [60, 90, 40, 90, 60, 60];
/// Fixed-point weight of one.
const ONE: i32 = 1 << 16;
/// Largest weight: the weighted sum of all inputs stays below 2^31.
const MOST: i32 = 3 * ONE;
/// Right shift that sets the mixer's learning rate.
const RATE: u32 = 12;

/// Weights of the inputs for one kind of bit.
#[derive(Debug, Clone)]
pub(super) struct Mixer<const N: usize = INPUTS>([i32; N]);

impl<const N: usize> Default for Mixer<N> {
    fn default() -> Self {
        Self([ONE * 7 / 4 / N as i32; N])
    }
}

/// Codes or reads one bit with the mean of the `models`' predictions, weighted by `mixer`; updates both. Returns the bit.
#[inline(always)]
pub(super) fn code_mixed_bit<const N: usize>(
    coder: &mut impl Coder,
    tables: &LogisticTables,
    mixer: &mut Mixer<N>,
    models: [&mut BitModel; N],
    bit: bool,
) -> bool {
    let mut inputs = [0; N];
    let mut sum = 0;
    for i in 0..N {
        inputs[i] = i32::from(tables.stretch(models[i].probability_12bit()));
        sum += inputs[i] * mixer.0[i];
    }
    let probability = tables.squash(sum >> 16);
    let bit = coder.code_bit(probability, bit);
    let error = if bit { 65536 - probability as i32 } else { -(probability as i32) };
    for (weight, input) in mixer.0.iter_mut().zip(inputs) {
        *weight = (*weight + ((input * (error >> 4) + (1 << (RATE - 1))) >> RATE)).clamp(-MOST, MOST);
    }
    models.into_iter().zip(COUNT_LIMIT).for_each(|(model, count_limit)| model.update(bit, count_limit));
    bit
}
