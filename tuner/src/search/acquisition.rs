//! Expected improvement: what a candidate may be worth, by what the models say of it (Jones, Schonlau and Welch, Efficient Global
//! Optimization of Expensive Black-Box Functions, 1998), with the probability that it keeps the contract.

use super::gaussian_process::Prediction;
use crate::Contract;
use crate::utility::Utility;
use lamina_model::GenerationParams;

/// Samples of what a candidate may give.
const DRAWS: usize = 48;

/// The candidate most worth trying.
#[derive(Default)]
pub(super) struct Acquisition {
    /// Which one.
    pub params: Option<GenerationParams>,
    /// Generation has to be timed first, as it may be too slow.
    pub in_doubt: bool,
    /// By how much it is expected to improve on the best.
    pub improvement: f64,
    /// How likely it is to keep the contract; where nothing was found to, how likely anything is.
    pub feasible: f64,
    /// By how much it is expected to come nearer to the limits ([`crate::tune::Row::distance`]).
    pub nearer: f64,
}

/// Expectations under a contract.
pub(super) struct ExpectedImprovement {
    /// Its limit on structural similarity stands as one on PSNR, which the models predict.
    pub contract: Contract,
    utility: Utility,
    draws: Vec<[f64; 3]>,
}

impl ExpectedImprovement {
    /// Under `contract`.
    pub(super) fn new(contract: Contract) -> Self {
        Self { utility: contract.utility(), contract, draws: draws() }
    }

    /// Of a candidate whose logarithms of bytes and milliseconds and whose decibels are `of`: the mean improvement on
    /// `least`, the share of draws that keep the contract, and by how much they are nearer to it than `nearest`.
    pub(super) fn expectation(&self, of: &[Prediction; 3], least: Option<f64>, nearest: f64) -> Acquisition {
        let (mut improvement, mut feasible, mut nearer) = (0.0, 0.0, 0.0);
        for draw in &self.draws {
            let [size, time, q] = std::array::from_fn(|k| of[k].mean + of[k].deviation * draw[k]);
            let (bytes, ms) = (size.exp(), time.exp());
            let distance = self.contract.distance_of(bytes, ms, q);
            nearer += (nearest - distance).max(0.0);
            if distance <= 0.0 {
                feasible += 1.0;
                let cost = self.utility.cost(bytes as u64, q, ms);
                // Without a best, cheaper is better by itself; the offset keeps the order's sign.
                improvement += least.map_or(-cost, |least| (least - cost).max(0.0));
            }
        }
        let n = self.draws.len() as f64;
        Acquisition {
            improvement: improvement / n,
            feasible: feasible / n,
            nearer: nearer / n,
            ..Acquisition::default()
        }
    }
}

/// Points that fill three dimensions evenly, as standard normal deviates: Halton's sequence in bases 2, 3 and 5.
fn draws() -> Vec<[f64; 3]> {
    let radical_inverse = |mut n: usize, base: usize| {
        let (mut digit, mut value) = (1.0, 0.0);
        while n > 0 {
            digit /= base as f64;
            value += digit * (n % base) as f64;
            n /= base;
        }
        value
    };
    (1..=DRAWS).map(|n| [2, 3, 5].map(|base| normal_quantile(radical_inverse(n, base)))).collect()
}

/// The standard normal quantile of `p` in 0..1, within 4.5e-4 (Abramowitz and Stegun 26.2.23).
fn normal_quantile(p: f64) -> f64 {
    let tail = p.min(1.0 - p);
    let t = (-2.0 * tail.ln()).sqrt();
    let z =
        t - (2.515_517 + t * (0.802_853 + t * 0.010_328)) / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    if p < 0.5 { -z } else { z }
}
