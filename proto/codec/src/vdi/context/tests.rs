//! Lists of supersegments come back as they were, and hostile bytes are refused.

use super::{BAND, MAX_DEPTH, QuantizedSegment, bands, encode};
use crate::entropy::EntropyError;
use crate::vdi::band::VdiBand;

/// Offsets and supersegments of all bands.
fn decode(bytes: &[u8], resolution: usize, segments: usize) -> Result<(Vec<u32>, Vec<QuantizedSegment>), EntropyError> {
    let (mut offsets, mut all) = (vec![0], Vec::new());
    for (k, band) in super::decode(bytes, resolution, segments)?.into_iter().enumerate() {
        assert_eq!(in_stages(bytes, resolution, segments, k), band);
        offsets.extend(band.ends().iter().map(|end| all.len() as u32 + end));
        all.extend_from_slice(band.segments());
    }
    Ok((offsets, all))
}

/// Band `k`, decoded in stages.
fn in_stages(bytes: &[u8], resolution: usize, segments: usize, k: usize) -> VdiBand {
    let mut shapes = super::geometry_decoder(bytes, resolution, segments, k).unwrap();
    let mut colors = super::color_decoder(bytes, resolution, segments, k).unwrap();
    while let Some(slice) = shapes.slice().unwrap() {
        let sent = slice.to_bytes();
        let mut rest = &sent[..];
        assert_eq!(VdiBand::read(&mut rest).unwrap(), slice);
        colors.take(&slice).unwrap();
        assert!(rest.is_empty());
    }
    colors.finish()
}

/// Numbers below the argument, the same on every machine.
fn numbers(seed: u64) -> impl FnMut(u64) -> u32 {
    let mut random = fastrand::Rng::with_seed(seed);
    move |below| random.u64(..below) as u32
}

/// Rays with up to `most` supersegments of random context, the deepest of which may be anywhere.
fn random(resolution: usize, most: u64, deepest: u64, seed: u64) -> (Vec<u32>, Vec<QuantizedSegment>) {
    let mut next = numbers(seed);
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    for _ in 0..resolution * resolution {
        let mut depth = 0;
        for _ in 0..next(most + 1) {
            let start = depth + next(3) * next(deepest);
            let end = start + 1 + next(2) * next(deepest);
            if end > MAX_DEPTH {
                break;
            }
            segments.push(QuantizedSegment { start, end, code: [next(256), next(3), 7, next(256)].map(|n| n as u8) });
            depth = end;
        }
        offsets.push(segments.len() as u32);
    }
    (offsets, segments)
}

/// A ball of three shells, seen by parallel rays.
fn ball(resolution: usize) -> (Vec<u32>, Vec<QuantizedSegment>) {
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    let half = resolution as f64 / 2.0;
    for k in 0..resolution * resolution {
        let [x, y] = [k % resolution, k / resolution].map(|i| (i as f64 + 0.5 - half) / half);
        let depths = |radius: f64| {
            let discriminant = radius * radius - x * x - y * y;
            (discriminant > 0.0).then(|| [-1.0, 1.0].map(|side| (100.0 * (1.0 + side * discriminant.sqrt())) as u32))
        };
        let shells: Vec<[u32; 2]> = [0.9, 0.6, 0.3].into_iter().filter_map(depths).collect();
        let cuts: Vec<u32> = shells.iter().map(|s| s[0]).chain(shells.iter().rev().map(|s| s[1])).collect();
        for (n, cut) in cuts.windows(2).enumerate().filter(|(_, cut)| cut[0] < cut[1]) {
            let shell = n.min(cuts.len() - 2 - n) as u8;
            segments.push(QuantizedSegment {
                start: cut[0],
                end: cut[1],
                code: [50 * shell, 200, 255 - shell, 40 + shell],
            });
        }
        offsets.push(segments.len() as u32);
    }
    (offsets, segments)
}

fn comes_back(resolution: usize, (offsets, segments): &(Vec<u32>, Vec<QuantizedSegment>)) -> usize {
    let bytes = encode(resolution, offsets, |k| segments[k]);
    assert_eq!(encode(resolution, offsets, |k| segments[k]), bytes);
    let back = decode(&bytes, resolution, segments.len()).unwrap();
    assert!(back.0 == *offsets && back.1 == *segments, "{resolution}");
    bytes.len()
}

#[test]
fn all_rays_come_back() {
    for resolution in [1, 2, 3, 17, 40] {
        for (seed, (most, deepest)) in [(0, 9), (1, 1), (1, 1 << 24), (5, 2), (9, 300), (3, 1 << 22)].iter().enumerate()
        {
            comes_back(resolution, &random(resolution, *most, *deepest, seed as u64));
        }
    }
    // The last step there may be, and one supersegment as long as all.
    let ends = vec![
        QuantizedSegment { start: MAX_DEPTH - 1, end: MAX_DEPTH, code: [255; 4] },
        QuantizedSegment { start: 0, end: MAX_DEPTH, code: [0; 4] },
    ];
    comes_back(2, &(vec![0, 1, 1, 2, 2], ends));
}

#[test]
fn many_rays_go_in_bands() {
    assert_eq!(bands(400, 0).len(), 1);
    assert_eq!(bands(20, 9 * BAND).len(), 1, "a band has some rows");
    let rays = random(400, 6, 40, 3);
    let bands = bands(400, rays.1.len());
    assert!(bands.len() == 3 && bands.windows(2).all(|w| w[0].end == w[1].start) && bands[2].end == 400);
    comes_back(400, &rays);
}

#[test]
fn what_neighboring_rays_share_costs_little() {
    let rays = ball(200);
    let segments = rays.1.len();
    assert!(segments > 50_000);
    let bytes = comes_back(200, &rays);
    // Both sides of three circles move by some steps from ray to ray: about a byte a supersegment, of twelve.
    assert!(bytes * 8 < 6 * segments, "{bytes} bytes for {segments}");
}

#[test]
fn bands_that_hold_too_much_together_are_refused() {
    // Bands of as many rows each.
    let rays = random(402, 6, 40, 3);
    let (first, most) = (encode(402, &rays.0, |k| rays.1[k]), rays.1.len());
    let lengths: Vec<usize> =
        first[..7 * 8].chunks_exact(8).map(|b| u64::from_le_bytes(b.try_into().unwrap()) as usize).collect();
    // The two parts of the first band in place of those of each: as many supersegments in all, or one too many.
    let part = |k: usize| &first[7 * 8 + lengths[..k].iter().sum::<usize>()..][..lengths[k]];
    let parts = [part(0), part(1), part(2), part(1), part(2), part(1), part(2)];
    let mut bytes: Vec<u8> = parts.iter().flat_map(|p| (p.len() as u64).to_le_bytes()).collect();
    bytes.extend(parts.concat());
    let rows = bands(402, most)[0].len();
    let held = rays.0[rows * 402] as usize * 3;
    assert_eq!(bands(402, held).len(), 3);
    assert!(decode(&bytes, 402, held).is_ok_and(|(_, all)| all.len() == held));
    assert_eq!(decode(&bytes, 402, held - 1), Err(EntropyError::InvalidValue));
}

#[test]
fn bytes_that_were_changed_are_refused_or_give_rays_in_order() {
    let (offsets, segments) = random(24, 5, 60, 11);
    let bytes = encode(24, &offsets, |k| segments[k]);
    for n in 0..24 {
        assert_eq!(decode(&bytes[..n], 24, segments.len()), Err(EntropyError::LengthMismatch), "{n} bytes");
    }
    assert_eq!(decode(&[&bytes[..], &[0]].concat(), 24, segments.len()), Err(EntropyError::LengthMismatch));
    for count in [0, 1, segments.len() - 1, segments.len() + 1] {
        assert!(decode(&bytes, 24, count).is_err(), "{count} supersegments");
    }
    let mut next = numbers(5);
    let mut whole = 0;
    for _ in 0..2000 {
        let mut changed = bytes.clone();
        for _ in 0..1 + next(3) {
            let at = next(bytes.len() as u64) as usize;
            changed[at] ^= 1 << next(8);
        }
        let Ok((offsets, segments)) = decode(&changed, 24, segments.len()) else { continue };
        whole += 1;
        for ray in offsets.windows(2).map(|w| &segments[w[0] as usize..w[1] as usize]) {
            assert!(ray.iter().all(|s| s.start < s.end && s.end <= MAX_DEPTH));
            assert!(ray.windows(2).all(|w| w[0].end <= w[1].start));
        }
    }
    assert!(whole < 1000, "{whole} of 2000 were taken for whole");
}

#[test]
fn reading_ends_whatever_fails_and_on_however_many_threads() {
    let rays = random(402, 6, 40, 3);
    let count = rays.1.len();
    let good = encode(402, &rays.0, |k| rays.1[k]);
    // The colors of the second band, which are the fifth part, become others: some not in the palette.
    let length = |k: usize| u64::from_le_bytes(good[8 * k..8 * (k + 1)].try_into().unwrap()) as usize;
    let mut bad = good.clone();
    let colors = 7 * 8 + (0..4).map(length).sum::<usize>();
    bad[colors..colors + length(4)].fill(0);
    for threads in [1, 2, 9] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| decode(&good, 402, count)).is_ok_and(|(_, all)| all == rays.1));
        assert_eq!(pool.install(|| decode(&bad, 402, count)), Err(EntropyError::InvalidValue));
    }
}
