//! Arbitrary bytes and damaged files for every decoder: each case must end in a value or an error.
//!
//! `cargo run --release -p lamina-tests --example fuzz -- CASES [SEED]`; a panic, or memory beyond the limit, ends it with the
//! case's number, which with the seed repeats it. Checksums are made right again, so that what is behind them is met.

use fastrand::Rng;
use glam::DVec3;
use lamina_codec::volume::encode_after;
use lamina_codec::{Codec, DecodeLimits, EncodeOptions, ErrorMeasure, Layout, decode_any, encode_any, sequence};
use lamina_model::{
    Aabb, Camera, ControlPoint, Effects, Grid, Intermediate, ReducedVolume, ScalarRange, Scale, Scene, Supersegment,
    TransferFunction, Vdi, VdiHeader, VdiParams, VolumeParams,
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// What a case may decode to.
const LIMITS: DecodeLimits = DecodeLimits { max_decoded_bytes: 1 << 20 };

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let cases: u64 = arguments.next().map_or(Ok(100_000), |n| n.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |n| n.parse())?;
    let seeds = seeds()?;
    let (start, decoded) = (Instant::now(), AtomicU64::new(0));
    (0..cases).into_par_iter().for_each(|n| {
        let mut random = Rng::with_seed(seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ n);
        let bytes = case(&mut random, &seeds);
        let outcome = std::panic::catch_unwind(|| decode_any(&bytes, &LIMITS).is_ok());
        match outcome {
            Ok(value) => _ = decoded.fetch_add(u64::from(value), Ordering::Relaxed),
            Err(_) => {
                eprintln!("case {n} of seed {seed}, {} bytes: panicked", bytes.len());
                std::process::exit(1);
            }
        }
    });
    let (secs, decoded) = (start.elapsed().as_secs_f64(), decoded.into_inner());
    println!("{cases} cases in {secs:.0} s: {decoded} decoded, the rest refused");
    Ok(())
}

/// A file, and where in it those bytes begin whose checksum ends it.
type Seed = (Vec<u8>, usize);

/// Small files of every kind.
fn seeds() -> Result<Vec<Seed>, Box<dyn std::error::Error>> {
    let mut random = Rng::with_seed(99);
    let mut seeds = Vec::new();
    for resolution in [1, 3, 7] {
        let vdi = Intermediate::Vdi(Box::new(vdi(resolution, &mut random)?));
        for codec in [Codec::Bzip2, Codec::Zstd, Codec::ContextMixing] {
            let options =
                [Layout::Columns, Layout::Plain].map(|layout| EncodeOptions { codec, layout, ..EncodeOptions::BZIP2 });
            for options in options.iter().filter(|o| o.check().is_ok()) {
                seeds.push(encode_any(&vdi, options)?);
            }
        }
    }
    for dims in [[1, 1, 1], [5, 4, 3], [9, 1, 2], [8, 8, 8]] {
        let volume = Intermediate::Volume(Box::new(volume(dims, &mut random)?));
        seeds.push(encode_any(&volume, &EncodeOptions::default())?);
    }
    let masked = Intermediate::Volume(Box::new(masked(volume([9, 8, 11], &mut random)?, &mut random)?));
    seeds.push(encode_any(&masked, &EncodeOptions::default())?);
    let stepped = Intermediate::Volume(Box::new(in_steps(volume([9, 8, 11], &mut random)?)?));
    seeds.push(encode_any(&stepped, &EncodeOptions::default())?);
    let mut seeds: Vec<Seed> = seeds.into_iter().map(|bytes| (bytes, 0)).collect();
    // The same once more, which is coded after itself: everything behind the first file's checksum is met.
    let volume = volume([9, 8, 11], &mut random)?;
    let (first, reference) = encode_after(&volume, ErrorMeasure::Maximum, None);
    let (second, _) = encode_after(&volume, ErrorMeasure::Maximum, Some(&reference));
    let whole = sequence(&[&first, &second]);
    let begins = whole.len() - second.len();
    seeds.push((whole, begins));
    Ok(seeds)
}

fn vdi(resolution: u32, random: &mut Rng) -> Result<Vdi, lamina_model::Invalid> {
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    for _ in 0..resolution * resolution {
        let mut depth = 0;
        for _ in 0..random.usize(..5) {
            let start = depth + random.u32(..3);
            depth = start + 1 + random.u32(..400);
            let color = [0; 3].map(|_| random.usize(..256) as f32 / 255.0);
            segments.push(Supersegment { start, end: depth, color, optical_depth: random.usize(..90) as f32 / 30.0 });
        }
        offsets.push(segments.len() as u32);
    }
    let header = VdiHeader {
        camera: camera()?,
        bounds: Aabb::new(DVec3::splat(-2.0), DVec3::splat(2.0))?,
        step_length: 0.003,
        params: VdiParams::new(resolution, 0.02)?,
        transfer_id: 7,
        background: [0.0; 3],
    };
    Vdi::new(header, offsets, segments)
}

/// With a third of its points missing.
fn masked(volume: ReducedVolume, random: &mut Rng) -> Result<ReducedVolume, lamina_model::Invalid> {
    let params = *volume.params();
    let (grid, scene, mut units) = volume.into_parts();
    units.iter_mut().filter(|_| random.u32(..3) == 0).for_each(|u| *u = f32::NAN);
    ReducedVolume::new(grid, scene, params, units)
}

/// With values in steps that are wider than the bound.
fn in_steps(volume: ReducedVolume) -> Result<ReducedVolume, lamina_model::Invalid> {
    let params = *volume.params();
    let (grid, scene, mut units) = volume.into_parts();
    units.iter_mut().for_each(|u| *u = (20.0 * *u).round() / 20.0);
    ReducedVolume::new(grid, scene, params, units)
}

fn camera() -> Result<Camera, lamina_model::Invalid> {
    Camera::new(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, 35.0)
}

fn volume(dims: [usize; 3], random: &mut Rng) -> Result<ReducedVolume, lamina_model::Invalid> {
    let points = [0.3, 1.0].map(|at| ControlPoint { at, color: [1.0; 3], opacity: at - 0.3 });
    let range = ScalarRange::new(0.0, 10.0, Scale::Linear)?;
    let scene = Scene {
        transfer: TransferFunction::new(range, Some(1.0), points.to_vec())?,
        camera: camera()?,
        background: [0.0; 3],
        step_voxels: 0.5,
        effects: Effects::default(),
    };
    let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO)?;
    let params = VolumeParams::new(8, 0.01)?;
    let units = (0..grid.voxels()).map(|_| random.usize(..1000) as f32 / 900.0).collect();
    ReducedVolume::new(grid, scene, params, units)
}

/// One of the files with bits flipped, bytes set, cut, doubled or made up, and its checksum made right again.
fn case(random: &mut Rng, seeds: &[Seed]) -> Vec<u8> {
    let (mut bytes, begins) = seeds[random.usize(..seeds.len())].clone();
    bytes.truncate(bytes.len() - 4);
    for _ in 0..1 + random.usize(..4) {
        // Of several files the last.
        let at = random.usize(begins.min(bytes.len() - 1)..bytes.len());
        match random.usize(..6) {
            0 => bytes[at] ^= 1 << random.usize(..8),
            1 => bytes[at] = random.u8(..),
            2 => bytes.truncate(at.max(1)),
            3 => bytes.extend((0..random.usize(..40)).map(|n| (n * 37) as u8)),
            4 => bytes[at..].iter_mut().take(4).for_each(|b| *b = 0xff),
            _ => bytes[at..].iter_mut().take(8).for_each(|b| *b = random.u8(..)),
        }
    }
    if random.usize(..50) > 0 {
        bytes.extend(crc32fast::hash(&bytes[begins.min(bytes.len())..]).to_le_bytes());
    }
    bytes
}
