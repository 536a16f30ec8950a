//! Reduced volumes coded after the one before: what they save, and that only that one decodes them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{CodecError, DecodeLimits, ErrorMeasure, check_any, decode_any, sequence, volume};
use lamina_model::{
    Camera, ControlPoint, Effects, Grid, Intermediate, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction,
    VolumeParams,
};
use volume::ReferenceVolume;

const BOUND: f64 = 0.01;

/// `unit` at every point of a grid of `dims` points; all of it shows.
fn reduced(dims: [usize; 3], unit: impl Fn(DVec3) -> f32) -> ReducedVolume {
    let spacing = DVec3::from_array(dims.map(|n| 40.0 / (n.max(2) - 1) as f64));
    let grid = Grid::new(dims, spacing, DVec3::ZERO).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [at, 0.5, 0.1], opacity };
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let scene = Scene {
        transfer: TransferFunction::new(range, Some(1.0), vec![point(0.0, 0.1), point(1.0, 0.9)]).unwrap(),
        camera: Camera::new(DVec3::new(1.0, 2.0, 200.0), DVec3::splat(20.0), DVec3::Y, 35.0).unwrap(),
        background: [0.0; 3],
        step_voxels: 0.5,
        effects: Effects::default(),
    };
    let place = |n: usize| {
        let [nx, ny, _] = dims;
        DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64) * spacing
    };
    let params = VolumeParams::new(64, BOUND).unwrap();
    ReducedVolume::new(grid, scene, params, (0..grid.voxels()).map(|n| unit(place(n))).collect()).unwrap()
}

/// Structures of many sizes that move by three times `time` along x and by `time` along z.
fn moving(time: f64) -> impl Fn(DVec3) -> f32 {
    move |p| {
        let p = p - DVec3::new(3.0 * time, 0.0, time);
        let waves =
            (0.5 * p.x + 0.3 * p.y).sin() * (0.4 * p.z).cos() + (0.7 * p.y - 0.3 * p.z).sin() * (0.6 * p.x).sin();
        // Fronts are hard to predict from their neighbors.
        let front = |center: DVec3, radius: f64| (2.0 * (radius - (p - center).length())).tanh();
        let fronts = front(DVec3::splat(18.0), 9.0) + front(DVec3::new(28.0, 10.0, 26.0), 6.0);
        (0.5 + 0.05 * waves + 0.15 * fronts) as f32
    }
}

fn limits() -> DecodeLimits {
    DecodeLimits::default()
}

fn alone(volume: &ReducedVolume) -> (Vec<u8>, ReferenceVolume) {
    volume::encode_after(volume, ErrorMeasure::Maximum, None)
}

fn worst(a: &ReducedVolume, b: &ReducedVolume) -> f32 {
    a.units().iter().zip(b.units()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_field_that_moves_takes_far_fewer_bytes_and_keeps_its_bound() {
    // Whole points a step: the volume before, moved, is this one, but for what comes in.
    let dims = [41; 3];
    let (_, before) = alone(&reduced(dims, moving(0.0)));
    let now = reduced(dims, moving(1.0));
    let (bytes, _) = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    let (whole, _) = alone(&now);
    assert!(10 * bytes.len() < 6 * whole.len(), "{} of {} bytes", bytes.len(), whole.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&before)).unwrap();
    assert!(worst(&back, &now) <= 1.001 * BOUND as f32);
}

/// Steps of `moving` fields coded one after the other, and what each decodes to from those before.
fn chain(volumes: &[ReducedVolume], measure: ErrorMeasure) -> Vec<(Vec<u8>, ReducedVolume)> {
    let (mut encoder, mut decoder): (Option<ReferenceVolume>, Option<ReferenceVolume>) = (None, None);
    let step = |volume: &ReducedVolume| {
        let (bytes, next) = volume::encode_after(volume, measure, encoder.as_ref());
        let back = volume::decode_after(&bytes, &limits(), decoder.as_ref()).unwrap();
        decoder = Some(ReferenceVolume::new(&bytes, &back));
        // Else errors would add up.
        assert!(decoder.as_ref() == Some(&next), "what a decoder has is what the encoder goes on from");
        encoder = Some(next);
        (bytes, back)
    };
    volumes.iter().map(step).collect()
}

/// Waves and what noise adds to them: wavelets code it best.
fn noisy(dims: [usize; 3], time: f64) -> ReducedVolume {
    let mut random = fastrand::Rng::with_seed(time.to_bits());
    let noise: Vec<f32> = (0..dims.iter().product::<usize>()).map(|_| 0.02 * (random.f32() - 0.5)).collect();
    let whole = reduced(dims, move |p| (0.5 + 0.3 * (0.2 * (p.x - time)).sin() * (0.3 * p.y).cos()) as f32);
    let units = whole.units().iter().zip(noise).map(|(unit, noise)| unit + noise).collect();
    ReducedVolume::new(*whole.grid(), whole.scene().clone(), *whole.params(), units).unwrap()
}

#[test]
fn encoder_and_decoder_go_on_from_the_same_volume_and_a_sequence_stands_for_its_last() {
    let dims = [40, 36, 33];
    let holed = |time: f64| {
        let field = moving(time);
        reduced(dims, move |p| if (p - DVec3::splat(20.0)).length() < 8.0 { f32::NAN } else { field(p) })
    };
    let times = [0.0, 0.4, 0.9, 1.3];
    for (volumes, measure, version) in [
        (times.map(|t| reduced(dims, moving(t))), ErrorMeasure::Maximum, 4),
        (times.map(|t| reduced(dims, moving(t))), ErrorMeasure::MeanSquare, 4),
        (times.map(holed), ErrorMeasure::MeanSquare, 4),
        (times.map(|t| noisy(dims, t)), ErrorMeasure::MeanSquare, 3),
    ] {
        let steps = chain(&volumes, measure);
        assert_eq!(steps[3].0[4], version);
        let files: Vec<&[u8]> = steps.iter().map(|(bytes, _)| &bytes[..]).collect();
        for last in 0..files.len() {
            let whole = sequence(&files[..=last]);
            let Intermediate::Volume(decoded) = decode_any(&whole, &limits()).unwrap() else { unreachable!() };
            let bits = |volume: &ReducedVolume| volume.units().iter().map(|u| u.to_bits()).collect::<Vec<_>>();
            assert!(bits(&decoded) == bits(&steps[last].1), "step {last}");
            check_any(&whole, &limits()).unwrap();
        }
        assert_eq!(volume::coded_after(files[0]), None);
        assert_eq!(volume::coded_after(files[3]).is_some(), version == 4);
    }
}

#[test]
fn sequences_that_are_none_are_refused() {
    let steps = chain(&[0.0, 0.4].map(|t| reduced([20; 3], moving(t))), ErrorMeasure::Maximum);
    let [first, second] = [&steps[0].0[..], &steps[1].0[..]];
    let whole = sequence(&[first, second]);
    for n in [0, 3, 5, 9, 17, whole.len() - 1] {
        assert!(decode_any(&whole[..n], &limits()).is_err(), "{n} bytes");
        assert!(check_any(&whole[..n], &limits()).is_err(), "{n} bytes");
    }
    for bad in [
        sequence(&[second]),
        sequence(&[second, first, second, second]),
        sequence(&[""; 0]),
        sequence(&[&whole[..]]),
        [&whole[..], &[0]].concat(),
        [&whole[..6], &u32::MAX.to_le_bytes(), &whole[10..]].concat(),
        [&whole[..10], &u64::MAX.to_le_bytes(), &whole[18..]].concat(),
    ] {
        assert!(decode_any(&bad, &limits()).is_err());
    }
}

#[test]
fn only_the_volume_before_decodes_it() {
    let dims = [40, 40, 40];
    let (other, first) = alone(&reduced(dims, moving(0.0)));
    let (_, second) = alone(&reduced(dims, moving(0.5)));
    let (bytes, _) = volume::encode_after(&reduced(dims, moving(1.0)), ErrorMeasure::Maximum, Some(&second));
    for reference in [None, Some(&first)] {
        let refused = volume::decode_after(&bytes, &limits(), reference).unwrap_err();
        assert!(
            matches!(refused, CodecError::NeedsReference { checksum } if checksum == second.checksum()),
            "{refused}"
        );
    }
    // One that needs no other is decoded beside any.
    assert!(volume::decode_after(&other, &limits(), Some(&second)).is_ok());
    let mut random = fastrand::Rng::with_seed(11);
    for _ in 0..300 {
        let mut damaged = bytes.clone();
        let at = random.usize(..damaged.len() - 4);
        damaged[at] = random.u8(..);
        let end = damaged.len() - 4;
        let checksum = crc32fast::hash(&damaged[..end]).to_le_bytes();
        damaged[end..].copy_from_slice(&checksum);
        // No panic, and no more memory than the volume takes.
        let _ = volume::decode_after(&damaged, &limits(), Some(&second));
    }
}

#[test]
fn what_resembles_nothing_takes_no_more_bytes_than_alone() {
    let dims = [33, 28, 30];
    let mut random = fastrand::Rng::with_seed(4);
    let noise: Vec<f32> = (0..2 * 27_720).map(|_| random.f32()).collect();
    let volume = |from: usize| {
        let whole = reduced(dims, |_| 0.0);
        ReducedVolume::new(*whole.grid(), whole.scene().clone(), *whole.params(), noise[from..from + 27_720].to_vec())
            .unwrap()
    };
    let (_, before) = alone(&volume(0));
    let now = volume(27_720);
    let (bytes, _) = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    assert!(bytes.len() <= alone(&now).0.len());
}

#[test]
fn the_volume_before_may_have_other_points_or_miss_some() {
    let (_, coarse) = alone(&reduced([31, 26, 21], moving(0.0)));
    let dims = [60, 50, 41];
    let now = reduced(dims, moving(0.1));
    let (bytes, _) = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&coarse));
    assert!(bytes.len() < alone(&now).0.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&coarse)).unwrap();
    assert!(worst(&back, &now) <= 1.001 * BOUND as f32);

    let holed = |time: f64| {
        let field = moving(time);
        reduced(dims, move |p| if (p - DVec3::splat(20.0)).length() < 8.0 { f32::NAN } else { field(p) })
    };
    let (_, before) = alone(&holed(0.0));
    let now = holed(0.3);
    let (bytes, _) = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    assert!(bytes.len() < alone(&now).0.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&before)).unwrap();
    let pairs = || back.units().iter().zip(now.units());
    assert!(pairs().all(|(a, b)| a.is_nan() == b.is_nan()));
    assert!(pairs().all(|(a, b)| a.is_nan() || (a - b).abs() <= 1.001 * BOUND as f32));
}
