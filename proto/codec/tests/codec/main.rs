//! The VDI codec: what comes back, what stays the same byte for byte, and that no input breaks it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use fastrand::Rng;
use glam::DVec3;
use lamina_codec::{Codec, CodecError, DecodeLimits, EncodeOptions, Layout, decode, encode, peek, quantize};
use lamina_model::composite::Accumulator;
use lamina_model::{Aabb, Camera, Supersegment, Vdi, VdiHeader, VdiParams};
use proptest::prelude::*;

mod golden;

/// Where the header and the section table start.
const HEADER_AT: usize = 8;
const TABLE_AT: usize = 202;

const ALL_OPTIONS: [EncodeOptions; 5] = [
    EncodeOptions { codec: Codec::Bzip2, layout: Layout::Columns, ..EncodeOptions::BZIP2 },
    EncodeOptions { codec: Codec::Zstd, layout: Layout::Columns, ..EncodeOptions::BZIP2 },
    EncodeOptions { codec: Codec::ContextMixing, layout: Layout::Columns, ..EncodeOptions::BZIP2 },
    EncodeOptions { codec: Codec::Bzip2, layout: Layout::Plain, ..EncodeOptions::BZIP2 },
    EncodeOptions { codec: Codec::Zstd, layout: Layout::Plain, ..EncodeOptions::BZIP2 },
];

fn header(resolution: u32) -> VdiHeader {
    VdiHeader {
        camera: Camera::new(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, 35.0).unwrap(),
        bounds: Aabb::new(DVec3::splat(-2.0), DVec3::splat(2.0)).unwrap(),
        step_length: 0.03,
        params: VdiParams::new(resolution, 0.02).unwrap(),
        transfer_id: 0x0123_4567_89ab_cdef,
        background: [0.0, 0.5, 1.0],
    }
}

fn vdi(resolution: u32, lists: Vec<Vec<Supersegment>>) -> Vdi {
    let mut offsets = vec![0];
    lists.iter().for_each(|l| offsets.push(offsets[offsets.len() - 1] + l.len() as u32));
    Vdi::new(header(resolution), offsets, lists.concat()).unwrap()
}

/// The same with another gamma; at 0 nothing is rounded but to the 256 codes.
fn with_gamma(vdi: &Vdi, gamma: f64) -> Vdi {
    let params = vdi.header().params.with_gamma(gamma).unwrap();
    let header = VdiHeader { params, ..*vdi.header() };
    Vdi::new(header, vdi.offsets().to_vec(), vdi.segments().to_vec()).unwrap()
}

/// Lists of every kind: empty, thin, opaque, adjacent, apart, long.
fn assorted(resolution: u32, seed: u64) -> Vdi {
    let mut random = Rng::with_seed(seed);
    let list = |random: &mut Rng| {
        let mut depth = random.u32(..40);
        (0..random.u32(..12))
            .map(|_| {
                let start = depth + if random.u32(..3) == 0 { random.u32(..300) } else { 0 };
                let longest = [1, 4, 90, 70_000][random.usize(..4)];
                depth = start + 1 + random.u32(..longest);
                let color = [random.f32(), random.f32(), random.f32()];
                let optical_depth = match random.u32(..8) {
                    0 => f32::INFINITY,
                    1 => 0.0,
                    2 => 1e-20,
                    3 => 8.0 * random.f32(),
                    _ => 0.05 * random.f32(),
                };
                Supersegment { start, end: depth, color, optical_depth }
            })
            .collect()
    };
    vdi(resolution, (0..resolution * resolution).map(|_| list(&mut random)).collect())
}

fn with_crc(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len() - 4;
    let crc = crc32fast::hash(&bytes[..body]).to_le_bytes();
    bytes[body..].copy_from_slice(&crc);
    bytes
}

#[test]
fn depths_come_back_exactly_and_colors_at_gamma_0_within_half_a_code() {
    for options in ALL_OPTIONS {
        let original = with_gamma(&assorted(9, 1), 0.0);
        let back = decode(&encode(&original, &options).unwrap(), &DecodeLimits::default()).unwrap();
        assert_eq!(back.header(), original.header());
        assert_eq!(back.offsets(), original.offsets());
        for (a, b) in original.segments().iter().zip(back.segments()) {
            assert_eq!((a.start, a.end), (b.start, b.end));
            assert!((0..3).all(|c| (a.color[c] - b.color[c]).abs() <= 0.501 / 255.0));
            assert!((a.opacity() - b.opacity()).abs() < 1.5 / 255.0, "{a:?} {b:?}");
            assert_eq!(a.optical_depth == 0.0, b.optical_depth == 0.0, "{a:?} {b:?}");
        }
    }
}

#[test]
fn encoding_what_was_decoded_gives_the_same_bytes() {
    for options in ALL_OPTIONS {
        let once = encode(&assorted(9, 2), &options).unwrap();
        let back = decode(&once, &DecodeLimits::default()).unwrap();
        assert_eq!(once, encode(&back, &options).unwrap());
        if options.layout == Layout::Columns {
            assert_eq!(back, quantize(&assorted(9, 2)));
            assert_eq!(back, quantize(&back));
        }
    }
}

#[test]
fn an_image_without_content_and_one_of_a_single_ray_come_back() {
    for options in ALL_OPTIONS {
        for original in [vdi(3, vec![vec![]; 9]), assorted(1, 4)] {
            let bytes = encode(&original, &options).unwrap();
            let back = decode(&bytes, &DecodeLimits::default()).unwrap();
            assert_eq!(back.offsets(), original.offsets());
            assert_eq!(encode(&back, &options).unwrap(), bytes);
            let told = peek(&bytes[..TABLE_AT]).unwrap();
            assert_eq!(told.header, *original.header());
            assert_eq!((told.codec, told.layout), (options.codec, options.layout));
            assert_eq!(told.segments as usize, original.segments().len());
        }
    }
}

#[test]
fn sections_of_more_than_one_block_come_back() {
    let original = assorted(190, 3);
    assert!(5 * original.segments().len() > 899_900);
    for options in ALL_OPTIONS.into_iter().filter(|o| o.layout == Layout::Columns) {
        let bytes = encode(&original, &options).unwrap();
        assert_eq!(decode(&bytes, &DecodeLimits::default()).unwrap(), quantize(&original));
    }
}

/// A uniform field, every sample its own supersegment: the worst case for rounding, since all errors agree. Errors of the lists
/// of 1 to 256 such, in dB, and the greatest.
fn uniform_media(opacity: f64, color: [f32; 3], gamma: f64) -> (f64, f32) {
    let optical_depth = -(-opacity).ln_1p() as f32;
    let piece = |start| Supersegment { start, end: start + 1, color, optical_depth };
    let original = with_gamma(&vdi(16, (1..=256).map(|n| (0..n).map(piece).collect()).collect()), gamma);
    let image = |v: &Vdi| -> Vec<f32> {
        let ray = |w: &[u32]| {
            let mut light = Accumulator::default();
            for s in &v.segments()[w[0] as usize..w[1] as usize] {
                light.add(s.color.map(f64::from), f64::from(s.optical_depth));
            }
            light.over([0.0; 3])
        };
        v.offsets().windows(2).flat_map(ray).collect()
    };
    let (a, b) = (image(&original), image(&quantize(&original)));
    let off = || a.iter().zip(&b).map(|(a, b)| (a - b).abs());
    let mse = off().map(|e| f64::from(e).powi(2)).sum::<f64>() / a.len() as f64;
    (-10.0 * mse.log10(), off().fold(0.0, f32::max))
}

#[test]
fn rounding_keeps_50_db_of_thin_uniform_media() {
    for opacity in [0.0005, 0.003, 0.015, 0.0152, 0.0156, 0.05] {
        let (db, _) = uniform_media(opacity, [1.0, 0.5, 0.25], 0.0);
        assert!(db > 49.0, "opacity {opacity}: {db:.1} dB");
    }
}

#[test]
fn rounding_by_gamma_moves_the_light_of_a_ray_by_little_more_than_gamma() {
    for gamma in [0.005, 0.01, 0.02, 0.025, 1.0 / 31.0] {
        for opacity in [1e-7, 1e-5, 0.0005, 0.0018, 0.003, 0.0152, 0.0156, 0.042, 0.05, 0.12, 0.3] {
            let (_, most) = uniform_media(opacity, [0.93, 0.5, 0.21], gamma);
            // What is owed in opacity, and in color before a code moves, and the quarter that a code may add.
            let allowed = (0.77 * gamma).max(1.0 / 128.0) + gamma.max(1.0 / 128.0) + 0.25 * gamma;
            assert!(f64::from(most) < allowed, "gamma {gamma}, opacity {opacity}: {most:.4} where {allowed:.4} may be");
        }
    }
}

/// Version 1 is frozen. If this fails, the format changed: give it a new version number.
#[test]
fn every_kind_of_failure_is_told_apart() {
    let refuse = |bytes: &[u8]| decode(bytes, &DecodeLimits::default()).unwrap_err();
    assert!(matches!(refuse(b""), CodecError::NotAVdi));
    assert!(matches!(refuse(b"LVDX--------"), CodecError::NotAVdi));
    assert!(matches!(refuse(b"LVDI\x01"), CodecError::Damaged(_)));
    for options in ALL_OPTIONS {
        let good = encode(&assorted(4, 5), &options).unwrap();
        let mut newer = good.clone();
        newer[4] = 4;
        assert!(matches!(refuse(&newer), CodecError::NewerVersion { found: 4, newest: 3 }));
        assert!(matches!(peek(&newer), Err(CodecError::NewerVersion { .. })));
        assert!(matches!(refuse(&good[..good.len() - 1]), CodecError::Damaged(_)));
        assert!(matches!(refuse(&[good.clone(), vec![0]].concat()), CodecError::Damaged(_)));
        let mut trailing = good.clone();
        trailing.splice(good.len() - 4..good.len() - 4, [0]);
        assert!(matches!(refuse(&with_crc(trailing)), CodecError::Invalid(_)));
        let small = DecodeLimits { max_decoded_bytes: 100 };
        assert!(matches!(decode(&good, &small), Err(CodecError::TooLarge { limit_bytes: 100, .. })));
        // The other version knows no such codec; the one between them is none.
        for (version, why) in [(4 - good[4], "has no codec"), (2, "draft")] {
            let mut bad = good.clone();
            bad[4] = version;
            let error = refuse(&with_crc(bad)).to_string();
            assert!(error.contains(why), "{options:?}: {error}");
        }
        for (at, value) in [(4, 0), (6, 0), (192, 7), (193, 7), (198, 99), (TABLE_AT, 9), (147, 255)] {
            let mut bad = good.clone();
            bad[at] = value;
            assert!(matches!(refuse(&with_crc(bad)), CodecError::Invalid(_)), "{options:?}: byte {at}");
        }
    }
}

#[test]
fn depths_that_plain_floats_cannot_hold_are_refused_with_the_remedy() {
    let far = Supersegment { start: (1 << 24) - 1, end: 1 << 24, color: [0.0; 3], optical_depth: 1.0 };
    let tiny = VdiHeader {
        bounds: Aabb::new(DVec3::splat(-1e-300), DVec3::splat(1e-300)).unwrap(),
        step_length: 1e-301,
        ..header(1)
    };
    let original = Vdi::new(tiny, vec![0, 1], vec![far]).unwrap();
    let plain = EncodeOptions { layout: Layout::Plain, ..EncodeOptions::BZIP2 };
    let error = encode(&original, &plain).unwrap_err();
    assert!(matches!(error, CodecError::Unrepresentable(_)) && error.to_string().contains("Layout::Columns"));
    for codec in [Codec::Bzip2, Codec::ContextMixing] {
        let columns =
            encode(&original, &EncodeOptions { codec, layout: Layout::Columns, ..EncodeOptions::BZIP2 }).unwrap();
        assert_eq!(decode(&columns, &DecodeLimits::default()).unwrap(), quantize(&original));
    }
    let mixed = EncodeOptions { layout: Layout::Plain, ..EncodeOptions::default() };
    let error = encode(&original, &mixed).unwrap_err().to_string();
    assert!(error.contains("give bzip2 or zstd"), "{error}");
}

/// A file of a few hundred bytes that claims most of a gigabyte of lists; a block that holds more than is due.
#[test]
fn bombs_stop_at_the_limit_or_at_the_block() {
    let options = EncodeOptions { codec: Codec::Zstd, layout: Layout::Columns, ..EncodeOptions::BZIP2 };
    let good = encode(&assorted(2, 6), &options).unwrap();
    let mut bomb = good.clone();
    bomb[194..198].copy_from_slice(&40_000_000_u32.to_le_bytes());
    let bomb = with_crc(bomb);
    assert!(matches!(decode(&bomb, &DecodeLimits::default()), Err(CodecError::Invalid(_))));
    let limits = DecodeLimits { max_decoded_bytes: 1 << 20 };
    assert!(matches!(decode(&bomb, &limits), Err(CodecError::TooLarge { .. })));
    // One block that holds a mebibyte of zeros where 16 bytes are due.
    let zeros = zstd::bulk::compress(&vec![0; 1 << 20], 3).unwrap();
    let empty = encode(&vdi(2, vec![vec![]; 4]), &options).unwrap();
    let mut bytes = empty[..TABLE_AT].to_vec();
    bytes.push(4);
    bytes.extend((zeros.len() as u32).to_le_bytes());
    bytes.extend([0, 0, 0, 5]);
    bytes.extend(zeros);
    bytes.extend([0; 4]);
    let error = decode(&with_crc(bytes), &limits).unwrap_err();
    assert!(error.to_string().contains("block of counts"), "{error}");
}

/// Flips, overwrites, cuts and header fields at random; most with the checksum put right, so that the inner checks meet
/// them. LAMINA_CODEC_MUTATIONS runs more of them.
#[test]
fn mutated_bytes_never_panic_or_exceed_the_limits() {
    let cases = std::env::var("LAMINA_CODEC_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(20_000);
    let seeds: Vec<Vec<u8>> = ALL_OPTIONS.iter().map(|o| encode(&assorted(5, 7), o).unwrap()).collect();
    let limits = DecodeLimits { max_decoded_bytes: 1 << 20 };
    let mut random = Rng::with_seed(8);
    let mut accepted = 0;
    for case in 0..cases {
        // zstd and mixed carry no checksum of their own, so most are of those kinds.
        let seed = &seeds[[1, 4, 2, 0, 4, 2, 1, 3][case % 8]];
        let mut bytes = mutate(seed, &mut random);
        if random.u32(..16) > 0 && bytes.len() >= 4 {
            bytes = with_crc(bytes);
        }
        let _ = peek(&bytes);
        if let Ok(vdi) = decode(&bytes, &limits) {
            assert!(size_of_val(vdi.segments()) <= 1 << 20);
            accepted += 1;
        }
    }
    assert!(accepted > 0 && accepted < cases, "{accepted} of {cases} were accepted: the mutations do not bite");
}

fn mutate(seed: &[u8], random: &mut Rng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let at = |random: &mut Rng, n: usize| random.usize(..n);
    for _ in 0..=random.u32(..3) {
        if bytes.len() < TABLE_AT {
            break;
        }
        match random.u32(..6) {
            0 | 1 => {
                let k = at(random, bytes.len());
                bytes[k] ^= 1 << random.u32(..8);
            }
            2 => {
                let k = at(random, bytes.len());
                bytes[k] = random.u8(..);
            }
            3 => {
                let fields = [8, 80, 136, 144, 148, 156, 164, 180, 192, 193, 194, 198];
                let k = fields[at(random, fields.len())];
                let n = 1 + at(random, 8);
                bytes[k..k + n.min(TABLE_AT - k)].fill_with(|| [0, 255, random.u8(..)][random.usize(..3)]);
            }
            4 => {
                let k = HEADER_AT + at(random, bytes.len() - HEADER_AT);
                if random.u32(..4) == 0 {
                    bytes.truncate(k);
                } else {
                    bytes.insert(k, random.u8(..));
                }
            }
            _ => {
                let k = TABLE_AT + at(random, 26.min(bytes.len() - TABLE_AT + 1));
                if let Some(byte) = bytes.get_mut(k) {
                    *byte = [0, 1, 4, 5, 12, 255][random.usize(..6)];
                }
            }
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_vdi_comes_back_as_its_quantized_self(resolution in 1_u32..12, seed: u64) {
        let original = assorted(resolution, seed);
        for codec in [Codec::Bzip2, Codec::Zstd, Codec::ContextMixing] {
            let options = EncodeOptions { codec, ..EncodeOptions::BZIP2 };
            let bytes = encode(&original, &options).unwrap();
            let back = decode(&bytes, &DecodeLimits::default()).unwrap();
            prop_assert_eq!(&back, &quantize(&original));
            prop_assert_eq!(&quantize(&back), &back);
            prop_assert_eq!(encode(&back, &options).unwrap(), bytes);
        }
    }

    #[test]
    fn any_bytes_are_refused_without_a_panic(tail in proptest::collection::vec(any::<u8>(), 0..600)) {
        let bytes = [b"LVDI\x01\x00\xc2\x00".as_slice(), &tail, &[0; 4]].concat();
        let limits = DecodeLimits { max_decoded_bytes: 1 << 20 };
        prop_assert!(decode(&with_crc(bytes), &limits).is_err());
        prop_assert!(decode(&tail, &DecodeLimits::default()).is_err());
    }
}
