//! Values come back within the bound, and hostile bytes are refused.

use super::{HEADER, Tolerance};
use crate::entropy::EntropyError;

fn encode(values: &[f32], dims: [usize; 3], bound: f32, free: impl Fn(usize) -> Option<(f32, f32)>) -> Vec<u8> {
    super::encode::encode(values, dims, Tolerance::Bound(bound), free, None).bytes
}

#[test]
fn the_encoder_knows_what_is_decoded() {
    for dims in [[1, 1, 1], [17, 12, 9], [5, 1, 1]] {
        let coded = super::encode::encode(
            &smooth(dims),
            dims,
            Tolerance::Bound(0.01),
            |n| (n % 5 == 0).then_some((0.0, 1.0)),
            None,
        );
        let back = decode(&coded.bytes, dims, 0.01).expect("what was encoded");
        assert_eq!(back, coded.decoded());
    }
}

fn decode(bytes: &[u8], dims: [usize; 3], bound: f32) -> Result<Vec<f32>, EntropyError> {
    super::decode::decode(bytes, dims, Tolerance::Bound(bound), None)
}

/// Numbers in 0..1, the same on every machine.
fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut random = fastrand::Rng::with_seed(seed);
    move || random.f32()
}

/// A volume with a value for each x, y, z.
fn volume(dims: [usize; 3], mut value: impl FnMut(f32, f32, f32) -> f32) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    let at = |i: usize| [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f32);
    (0..nx * ny * nz).map(|i| value(at(i)[0], at(i)[1], at(i)[2])).collect()
}

fn random(dims: [usize; 3]) -> Vec<f32> {
    let mut next = noise(3);
    volume(dims, |_, _, _| next() * 17.0 - 8.0)
}

fn smooth(dims: [usize; 3]) -> Vec<f32> {
    volume(dims, |x, y, z| 0.5 + 0.5 * (x * 0.11).sin() * (y * 0.07 + z * 0.05).cos())
}

/// A ball of 1 that fades into 0.
fn ball(n: usize) -> Vec<f32> {
    let c = n as f32 / 2.0;
    volume([n; 3], |x, y, z| {
        let r = ((x - c).powi(2) + (y - c).powi(2) + (z - c).powi(2)).sqrt() / c;
        (1.5 - 2.0 * r).clamp(0.0, 1.0)
    })
}

fn back(values: &[f32], dims: [usize; 3], bound: f32) -> (usize, Vec<f32>) {
    let bytes = encode(values, dims, bound, |_| None);
    (bytes.len(), decode(&bytes, dims, bound).expect("what was encoded"))
}

fn largest_error(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).abs()).fold(0.0, f64::max)
}

#[test]
fn every_voxel_is_within_the_bound() {
    let sizes = [[1; 3], [2; 3], [1, 1, 9], [1, 50, 1], [300, 1, 1], [5, 7, 3], [17, 16, 15], [33, 1, 64], [40; 3]];
    for dims in sizes {
        for bound in [0.5, 0.1, 0.03, 0.005, 1e-4, 1e-8, 1e-30, 1e-44] {
            for values in [random(dims), smooth(dims)] {
                let (_, decoded) = back(&values, dims, bound);
                assert!(largest_error(&values, &decoded) <= f64::from(bound), "{dims:?} {bound}");
            }
        }
    }
}

#[test]
fn free_voxels_stay_within_their_interval_and_cost_little() {
    let dims = [40; 3];
    let mut next = noise(5);
    // Noise below 0.5 that is not shown; a smooth part above.
    let values = volume(dims, |x, y, _| if x < 30.0 { next() * 0.5 } else { 0.6 + 0.003 * y });
    let free = |i: usize| (values[i] < 0.5).then_some((-1.0, 0.5));
    let bytes = encode(&values, dims, 0.01, free);
    let decoded = decode(&bytes, dims, 0.01).expect("what was encoded");
    for (i, (&v, &d)) in values.iter().zip(&decoded).enumerate() {
        match free(i) {
            Some((low, high)) => assert!(low <= d && d <= high, "{i}: {d}"),
            None => assert!((v - d).abs() <= 0.01, "{i}: {v} {d}"),
        }
    }
    let all = encode(&values, dims, 0.01, |_| None);
    assert!(bytes.len() * 20 < all.len(), "{} of {} bytes", bytes.len(), all.len());
}

#[test]
fn narrow_free_intervals_are_met() {
    let dims = [12, 13, 14];
    let values = random(dims);
    let free = |i: usize| i.is_multiple_of(3).then(|| (values[i] - 1e-3 * (i % 7) as f32, values[i] + 0.02));
    let decoded = decode(&encode(&values, dims, 0.3, free), dims, 0.3).expect("what was encoded");
    for (i, (&v, &d)) in values.iter().zip(&decoded).enumerate() {
        let (low, high) = free(i).unwrap_or((v - 0.3, v + 0.3));
        assert!(low <= d && d <= high, "{i}: {v} {d}");
    }
}

#[test]
fn what_is_constant_costs_nothing() {
    let (bytes, decoded) = back(&[0.25; 64 * 64 * 64], [64; 3], 1e-3);
    assert!(bytes < HEADER + 40, "{bytes} bytes");
    assert!(decoded.iter().all(|&v| v == 0.25));
}

#[test]
fn a_smooth_volume_takes_few_bytes_and_is_closer_than_the_bound() {
    let values = ball(64);
    let (bytes, decoded) = back(&values, [64; 3], 0.05);
    let mse = values.iter().zip(&decoded).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / values.len() as f64;
    assert!(bytes < 1500, "{bytes} bytes");
    assert!(-10.0 * mse.log10() > 40.0, "mean square error {mse}");
}

#[test]
fn a_finer_bound_takes_more_bytes() {
    let values = ball(48);
    let bytes = [0.1, 0.03, 0.01, 0.003].map(|bound| back(&values, [48; 3], bound).0);
    assert!(bytes.is_sorted() && bytes[3] > 2 * bytes[0], "{bytes:?}");
}

#[test]
fn nothing_is_nothing() {
    assert!(encode(&[], [0, 4, 4], 0.1, |_| None).is_empty());
    assert_eq!(decode(&[], [0, 4, 4], 0.1), Ok(Vec::new()));
}

#[test]
fn broken_headers_are_refused() {
    assert_eq!(decode(&[0; HEADER - 1], [4; 3], 0.1), Err(EntropyError::LengthMismatch));
    assert_eq!(decode(&[0; HEADER], [usize::MAX, 2, 1], 0.1), Err(EntropyError::SizeOverflow));
    assert_eq!(decode(&[0xff; 40], [4; 3], 0.1), Err(EntropyError::InvalidValue));
    let swapped: Vec<u8> = [1.0_f32, 0.0, 0.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(decode(&swapped, [4; 3], 0.1), Err(EntropyError::InvalidValue));
}

#[test]
fn changed_and_cut_bytes_never_panic() {
    let dims = [5, 6, 4];
    let bytes = encode(&random(dims), dims, 0.7, |_| None);
    let mut next = noise(11);
    for round in 0..100_000 {
        let mut changed = bytes.clone();
        for _ in 0..1 + round % 3 {
            let at = (next() * changed.len() as f32) as usize;
            changed[at.min(bytes.len() - 1)] = (next() * 256.0) as u8;
        }
        changed.truncate(if round % 4 == 0 { (next() * bytes.len() as f32) as usize } else { bytes.len() });
        if let Ok(values) = decode(&changed, dims, 0.7) {
            assert!(values.len() == 120 && values.iter().all(|v| v.is_finite()));
        }
    }
}

#[test]
fn any_bound_decodes() {
    let bytes: Vec<u8> = [0.0_f32, 1.0, 0.5]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .chain((0_u8..200).map(|i| i.wrapping_mul(37)))
        .collect();
    for bound in [0.0, f32::NAN, f32::INFINITY, -1.0, f32::MIN_POSITIVE / 4.0] {
        let values = decode(&bytes, [9, 8, 7], bound).expect("a whole header");
        assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
    }
}
