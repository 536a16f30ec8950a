//! Reduced volumes coded after the one before: what they save, and that only that one decodes them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{CodecError, DecodeLimits, ErrorMeasure, volume};
use lamina_model::{
    Camera, ControlPoint, Effects, Grid, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction, VolumeParams,
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
    let bytes = volume::encode(volume, ErrorMeasure::Maximum);
    let reference = ReferenceVolume::new(&bytes, &volume::decode(&bytes, &limits()).unwrap());
    (bytes, reference)
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
    let bytes = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    let (whole, _) = alone(&now);
    assert!(10 * bytes.len() < 6 * whole.len(), "{} of {} bytes", bytes.len(), whole.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&before)).unwrap();
    assert!(worst(&back, &now) <= 1.001 * BOUND as f32);
    // A third step after the second: what a decoder has of it is what the encoder takes.
    let second = ReferenceVolume::new(&bytes, &back);
    let third = reduced(dims, moving(2.0));
    let bytes = volume::encode_after(&third, ErrorMeasure::MeanSquare, Some(&second));
    let back = volume::decode_after(&bytes, &limits(), Some(&second)).unwrap();
    assert_eq!(back.grid(), third.grid());
}

#[test]
fn only_the_volume_before_decodes_it() {
    let dims = [40, 40, 40];
    let (other, first) = alone(&reduced(dims, moving(0.0)));
    let (_, second) = alone(&reduced(dims, moving(0.5)));
    let bytes = volume::encode_after(&reduced(dims, moving(1.0)), ErrorMeasure::Maximum, Some(&second));
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
    let bytes = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    assert!(bytes.len() <= alone(&now).0.len());
}

#[test]
fn the_volume_before_may_have_other_points_or_miss_some() {
    let (_, coarse) = alone(&reduced([31, 26, 21], moving(0.0)));
    let dims = [60, 50, 41];
    let now = reduced(dims, moving(0.1));
    let bytes = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&coarse));
    assert!(bytes.len() < alone(&now).0.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&coarse)).unwrap();
    assert!(worst(&back, &now) <= 1.001 * BOUND as f32);

    let holed = |time: f64| {
        let field = moving(time);
        reduced(dims, move |p| if (p - DVec3::splat(20.0)).length() < 8.0 { f32::NAN } else { field(p) })
    };
    let (_, before) = alone(&holed(0.0));
    let now = holed(0.3);
    let bytes = volume::encode_after(&now, ErrorMeasure::Maximum, Some(&before));
    assert!(bytes.len() < alone(&now).0.len());
    let back = volume::decode_after(&bytes, &limits(), Some(&before)).unwrap();
    let pairs = || back.units().iter().zip(now.units());
    assert!(pairs().all(|(a, b)| a.is_nan() == b.is_nan()));
    assert!(pairs().all(|(a, b)| a.is_nan() || (a - b).abs() <= 1.001 * BOUND as f32));
}
