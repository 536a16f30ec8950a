//! Wavelet coding of a band: the alternative to prediction where the mean square error counts, not the greatest one.
//!
//! The biorthogonal wavelet 9/7 (A. Cohen, I. Daubechies and J.-C. Feauveau, "Biorthogonal Bases of Compactly Supported
//! Wavelets", Comm. Pure Appl. Math. 45, 1992) is nearly orthogonal, so errors of coefficients hardly add up: noise that no
//! bound has to hold costs nothing. Values that nobody sees are chosen so that they cost least: by projecting in turn onto
//! what has been coded and onto their intervals (D. C. Youla and H. Webb, "Image Restoration by the Method of Convex
//! Projections", IEEE Trans. Med. Imaging 1, 1982).
mod coefficients;
mod lifting;

use super::HEADER;
use super::decode::numbers;
use super::encode::range;
use super::multigrid::within;
use crate::entropy::EntropyError;
use crate::entropy::range_coder::{Decoder, Encoder};
use coefficients::code;
use lifting::{extents, forward, inverse};

/// A coefficient below this many steps is 0.
const DEAD_ZONE: f32 = 0.62;
/// Reconstructed magnitudes are this many steps below the middle of their interval: small ones are the more frequent.
const BIAS: f32 = 0.04;
/// First quantizer step, in roots of the mean square error: rather too large.
const FIRST_STEP: f64 = 20.0;
/// The most trials of the quantizer step; each also moves the unseen values.
const TRIALS: usize = 6;
/// Share of the error allowed that is aimed at, and from which on a step is good enough.
const AIM: f64 = 0.97;
const ENOUGH: f64 = 0.94;
/// Share of the rival's bytes that has to suffice: errors are compared only about as they are seen.
const WORTHWHILE: f64 = 0.85;
/// Largest quantized coefficient.
const MOST: f32 = (1 << 28) as f32;
/// A nonzero coefficient takes about as many bits, with the zeros around it.
const USUAL_BITS: f64 = 5.0;

/// Encodes `values` of `dims` (x fastest), all finite, no worse than `rival` stands for them, by the mean square error of
/// [means](mean_square); a value in its `free` interval has no error. Also gives the values as they decode. `None` if that takes not much less than `rival_bytes`.
pub(super) fn encode(
    values: &[f32],
    dims: [usize; 3],
    free: impl Fn(usize) -> Option<(f32, f32)>,
    rival: &[f32],
    rival_bytes: usize,
) -> Option<(Vec<u8>, Vec<f32>)> {
    let levels = extents(dims);
    let range = range(values, *values.first()?);
    let intervals: Vec<Option<(f32, f32)>> = (0..values.len()).map(free).collect();
    if intervals.iter().filter(|free| free.is_some()).count() > values.len() / 2 {
        // Prediction makes more of what nobody sees, and of its edges.
        return None;
    }
    let errors = |decoded: &[f32]| {
        let error = |n: usize| match intervals[n] {
            Some(interval) => decoded[n] - within(interval.into(), decoded[n]),
            None => decoded[n] - values[n],
        };
        mean_square((0..values.len()).map(error), dims)
    };
    let most_error = errors(rival);
    let most_bytes = WORTHWHILE * rival_bytes as f64;
    let mut step = (FIRST_STEP * most_error.sqrt()) as f32;
    let (mut wanted, mut found) = (values.to_vec(), None::<(f32, _, Vec<f32>)>);
    for _ in 0..TRIALS {
        if !(step.is_finite() && step > 0.0) {
            break;
        }
        let quantized = quantized(&wanted, dims, &levels, step);
        // With a larger step there would be fewer.
        let bytes = USUAL_BITS / 8.0 * quantized.iter().filter(|&&q| q != 0).count() as f64;
        if bytes > 1.4 * most_bytes {
            break;
        }
        let decoded = reconstructed(&quantized, dims, &levels, step, range);
        for (wanted, (free, &value)) in wanted.iter_mut().zip(intervals.iter().zip(&decoded)) {
            if let Some(interval) = free {
                *wanted = within((*interval).into(), value);
            }
        }
        let share = errors(&decoded) / most_error;
        if share <= 1.0 && found.as_ref().is_none_or(|(best, ..)| step > *best) {
            found = Some((step, quantized, decoded));
        }
        if (share > 0.7 && bytes > most_bytes) || (ENOUGH..=1.0).contains(&share) {
            break;
        }
        // Errors grow with the step, less than with its square.
        step *= (AIM / share.max(1e-9)).powf(0.6).clamp(0.4, 2.5) as f32;
    }
    let (step, mut quantized, decoded) = found?;
    // Least and largest value, and the quantizer step.
    let mut bytes: Vec<u8> = [range[0], range[1], step].iter().flat_map(|v| v.to_le_bytes()).collect();
    debug_assert_eq!(bytes.len(), HEADER);
    let mut encoder = Encoder::default();
    code(&mut encoder, &mut quantized, dims, &levels);
    bytes.extend(encoder.finish());
    ((bytes.len() as f64) < most_bytes).then_some((bytes, decoded))
}

/// Decodes a band of `dims`. Corrupt bytes give other finite values or an error, in the time and memory that `dims` take.
pub(super) fn decode(bytes: &[u8], dims: [usize; 3]) -> Result<Vec<f32>, EntropyError> {
    let ([low, high, step], rest) = numbers(bytes)?;
    if !(low.is_finite() && high.is_finite() && low <= high && step.is_finite() && step > 0.0) {
        return Err(EntropyError::InvalidValue);
    }
    let levels = extents(dims);
    let mut quantized = vec![0; dims.iter().product()];
    code(&mut Decoder::new(rest), &mut quantized, dims, &levels);
    Ok(reconstructed(&quantized, dims, &levels, step, [low, high]))
}

/// The mean square of the means of 2 x 2 x 2 errors of `dims`: about what is left of an error where rays gather some values, so
/// that noise counts less than what is wrong throughout.
fn mean_square(mut errors: impl Iterator<Item = f32>, [nx, ny, nz]: [usize; 3]) -> f64 {
    let (mut sum, mut block) = (0.0, vec![0.0; nx.div_ceil(2) * ny.div_ceil(2)]);
    for z in 0..nz {
        for y in 0..ny {
            let row = y / 2 * nx.div_ceil(2);
            for (x, error) in errors.by_ref().take(nx).enumerate() {
                block[row + x / 2] += error;
            }
        }
        if z % 2 == 1 || z + 1 == nz {
            let sides = |n: usize, k: usize| if 2 * k + 1 < n { 2 } else { 1 };
            let depth = 1 + z % 2;
            for (n, mean) in block.iter_mut().enumerate() {
                let count = depth * sides(nx, n % nx.div_ceil(2)) * sides(ny, n / nx.div_ceil(2));
                sum += f64::from(std::mem::take(mean)).powi(2) / count as f64;
            }
        }
    }
    sum / (nx * ny * nz) as f64
}

fn quantized(values: &[f32], dims: [usize; 3], levels: &[[usize; 3]], step: f32) -> Vec<i32> {
    let mut coefficients = values.to_vec();
    forward(&mut coefficients, dims, levels);
    let quantize = |c: f32| {
        let magnitude = (c.abs() / step + (1.0 - DEAD_ZONE)).min(MOST) as i32;
        if c < 0.0 { -magnitude } else { magnitude }
    };
    coefficients.into_iter().map(quantize).collect()
}

fn reconstructed(quantized: &[i32], dims: [usize; 3], levels: &[[usize; 3]], step: f32, range: [f32; 2]) -> Vec<f32> {
    let mut values: Vec<f32> = quantized.iter().map(|&q| (q as f32 - BIAS * q.signum() as f32) * step).collect();
    inverse(&mut values, dims, levels);
    values.iter_mut().for_each(|v| *v = within(range, *v));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(dims: [usize; 3]) -> Vec<f32> {
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])].map(|i| i as f32);
        let value = |n| {
            let [x, y, z] = at(n);
            0.5 + 0.2 * (0.31 * x).sin() * (0.17 * y).cos() + 0.1 * (0.23 * (x + z)).sin()
        };
        (0..dims.iter().product()).map(value).collect()
    }

    /// `values` off by `error`, every one alike.
    fn off(values: &[f32], error: f32) -> Vec<f32> {
        values.iter().map(|v| v + error).collect()
    }

    #[test]
    fn a_band_comes_back_with_the_error_allowed_and_cut_bytes_are_refused_or_decode() {
        for dims in [[40, 33, 17], [1, 1, 1], [5, 1, 300], [64, 64, 1]] {
            let values = waves(dims);
            for error in [1e-2, 1e-3] {
                let (bytes, decoded) = encode(&values, dims, |_| None, &off(&values, error), 1 << 30).unwrap();
                let back = decode(&bytes, dims).unwrap();
                assert_eq!(back, decoded);
                let found = mean_square(back.iter().zip(&values).map(|(a, b)| a - b), dims).sqrt();
                let most = f64::from(error) * mean_square((0..values.len()).map(|_| 1.0), dims).sqrt();
                assert!(
                    found <= 1.01 * most && (found > 0.3 * most || values.len() == 1),
                    "{dims:?}: {found} of {most}"
                );
                for n in 0..bytes.len().min(40) {
                    assert_eq!(decode(&bytes[..n], dims).is_err(), n < HEADER, "{n} bytes");
                }
            }
        }
    }

    #[test]
    fn changed_bytes_decode_to_numbers_within_the_range_or_are_refused() {
        let dims = [21, 14, 10];
        let values = waves(dims);
        let (bytes, _) = encode(&values, dims, |_| None, &off(&values, 1e-3), 1 << 30).unwrap();
        for at in 0..bytes.len() {
            for change in [1, 0x80, 0xff] {
                let mut other = bytes.clone();
                other[at] ^= change;
                if let Ok(back) = decode(&other, dims) {
                    assert!(back.len() == values.len() && back.iter().all(|v| v.is_finite()), "byte {at}");
                }
            }
        }
    }

    #[test]
    fn noise_counts_less_than_what_is_wrong_throughout() {
        let dims = [8, 6, 4];
        let alike = mean_square((0..192).map(|_| 0.5), dims);
        let checkered = mean_square((0..192).map(|n| if (n + n / 8 + n / 48) % 2 == 0 { 0.5 } else { -0.5 }), dims);
        assert!((alike - 0.25).abs() < 1e-6 && checkered < 1e-12, "{alike}, {checkered}");
    }

    #[test]
    fn what_nobody_sees_costs_little_and_stays_unseen() {
        let dims = [32, 32, 32];
        let mut values = waves(dims);
        let half = values.len() / 2 - 1;
        // Noise below 0.2, where nothing below 0.2 is seen.
        let mut dice = fastrand::Rng::with_seed(3);
        values[..half].iter_mut().for_each(|v| *v = 0.2 * dice.f32());
        let hidden = |n: usize| (n < half).then_some((f32::NEG_INFINITY, 0.2));
        let rival = off(&values, 0.01);
        let (free, _) = encode(&values, dims, hidden, &rival, 1 << 20).unwrap();
        let (whole, _) = encode(&values, dims, |_| None, &rival, 1 << 20).unwrap();
        assert!(3 * free.len() < 2 * whole.len(), "{} and {}", free.len(), whole.len());
        let back = decode(&free, dims).unwrap();
        let error = |n: usize| if n < half { (back[n] - 0.2).max(0.0) } else { back[n] - values[n] };
        let allowed = |n: usize| if n < half { (rival[n] - 0.2).max(0.0) } else { 0.01 };
        let [found, most] =
            [mean_square((0..values.len()).map(error), dims), mean_square((0..values.len()).map(allowed), dims)];
        assert!(found <= most * 1.0001, "{found} of {most}");
    }
}
