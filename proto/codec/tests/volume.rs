//! The codec of reduced volumes: what comes back, what nobody sees, and that no input breaks it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{CodecError, DecodeLimits, ErrorMeasure, decode_any, encode_any, volume};
use lamina_model::{
    Camera, ControlPoint, Effects, Grid, Intermediate, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction,
    VolumeParams, effects::ColorField, effects::Isosurface, effects::Shading,
};
use proptest::prelude::*;

const DIMS: [usize; 3] = [23, 17, 14];
const BOUND: f64 = 0.02;

/// Opaque from 0.4 to 0.7 of the range, transparent below 0.25 and from 0.8 on.
fn scene(effects: Effects) -> Scene {
    let point = |at, opacity| ControlPoint { at, color: [at, 0.5, 0.1], opacity };
    let points = vec![point(0.25, 0.0), point(0.4, 0.5), point(0.7, 0.5), point(0.8, 0.0), point(1.0, 0.0)];
    let range = ScalarRange::new(0.0, 10.0, Scale::Linear).unwrap();
    Scene {
        transfer: TransferFunction::new(range, Some(1.0), points).unwrap(),
        camera: Camera::new(DVec3::new(1.0, 2.0, 90.0), DVec3::ZERO, DVec3::Y, 35.0).unwrap(),
        background: [0.0, 0.5, 1.0],
        step_voxels: 0.5,
        effects,
    }
}

/// `unit` at every point, under `effects`.
fn reduced(effects: Effects, unit: impl Fn(DVec3) -> f32) -> ReducedVolume {
    let grid = Grid::new(DIMS, DVec3::new(1.0, 1.5, 0.5), DVec3::splat(-4.0)).unwrap();
    let at =
        |n: usize| DVec3::new((n % DIMS[0]) as f64, (n / DIMS[0] % DIMS[1]) as f64, (n / DIMS[0] / DIMS[1]) as f64);
    let params = VolumeParams::new(23, BOUND).unwrap();
    ReducedVolume::new(grid, scene(effects), params, (0..grid.voxels()).map(|n| unit(at(n))).collect()).unwrap()
}

#[test]
fn colors_of_a_second_field_are_refused() {
    let whole = reduced(Effects::default(), |_| 0.5);
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let second = ColorField { name: "T".into(), range, points: ColorField::cool_to_warm() };
    let scene = scene(Effects { color_field: Some(second), ..Effects::default() });
    let refused = ReducedVolume::new(*whole.grid(), scene, *whole.params(), whole.units().to_vec()).unwrap_err();
    assert_eq!(refused.thing, "effects.color_field");
}

/// A ball that shows, in noise that does not.
fn ball(effects: Effects) -> ReducedVolume {
    reduced(effects, |p| {
        let d = (p - DVec3::new(9.0, 9.0, 7.0)).length();
        let noise = ((p.x * 12.9898 + p.y * 78.233 + p.z * 37.719).sin() * 43_758.547).fract().abs();
        if d < 5.0 { (0.6 - 0.05 * d) as f32 } else { (0.2 * noise) as f32 }
    })
}

/// Points that are seen, or beside one that is: closer than `reach` along every axis.
fn seen(volume: &ReducedVolume, reach: usize) -> Vec<bool> {
    let shows = |u: f32| u > 0.25 && u < 0.8;
    let units = volume.units();
    let [nx, ny, nz] = DIMS;
    let near = |i: usize, n: usize| i.saturating_sub(reach)..=(i + reach).min(n - 1);
    let at = |x: usize, y: usize, z: usize| units[x + nx * (y + ny * z)];
    let beside = |n: usize| {
        let (x, y, z) = (n % nx, n / nx % ny, n / nx / ny);
        near(z, nz).any(|k| near(y, ny).any(|j| near(x, nx).any(|i| shows(at(i, j, k)))))
    };
    (0..units.len()).map(beside).collect()
}

fn round_trip(volume: &ReducedVolume) -> (usize, ReducedVolume) {
    let bytes = volume::encode(volume, ErrorMeasure::Maximum);
    (bytes.len(), volume::decode(&bytes, &DecodeLimits::default()).unwrap())
}

#[test]
fn what_is_seen_comes_back_within_the_bound_and_the_rest_stays_unseen() {
    let shading = Shading { ambient: 0.3, diffuse: 0.5, specular: 0.1, shininess: 8 };
    let lit = Effects { light: Some(DVec3::Z), shading: Some(shading), ..Effects::default() };
    for (effects, reach) in [(Effects::default(), 1), (lit, 2)] {
        let volume = ball(effects);
        let (_, back) = round_trip(&volume);
        assert_eq!((back.grid(), back.scene(), back.params()), (volume.grid(), volume.scene(), volume.params()));
        let pairs = volume.units().iter().zip(back.units()).zip(seen(&volume, reach));
        let (mut free, mut moved) = (0, 0);
        for ((was, is), seen) in pairs {
            if seen {
                assert!(f64::from((was - is).abs()) <= BOUND * (1.0 + 1e-5), "{was} became {is}");
            } else {
                free += 1;
                moved += usize::from(f64::from((was - is).abs()) > BOUND);
                let bound = BOUND as f32 * (1.0 + 1e-5);
                assert!(*is <= 0.25_f32.max(was + bound), "{was} became {is}, which shows");
            }
        }
        assert!(free > 1000 && moved > free / 4, "{free} points are free, {moved} made use of it");
    }
}

#[test]
fn what_is_never_seen_costs_next_to_nothing() {
    let (with_noise, _) = round_trip(&ball(Effects::default()));
    let volume = ball(Effects::default());
    let still = seen(&volume, 1);
    let quiet = reduced(Effects::default(), |p| {
        let n = p.x as usize + DIMS[0] * (p.y as usize + DIMS[1] * p.z as usize);
        if still[n] { volume.units()[n] } else { 0.1 }
    });
    let (without, _) = round_trip(&quiet);
    assert!(with_noise as f64 <= 1.12 * without as f64, "{with_noise} and {without} bytes");
}

#[test]
fn a_surface_in_what_is_transparent_is_seen() {
    let surface = Isosurface { value: 1.0, color: [1.0; 3], opacity: 1.0 };
    let effects = Effects { isosurfaces: vec![surface], ..Effects::default() };
    // A ramp through 0.1 of the range, where the surface is: the points on either side of it are seen.
    let volume = reduced(effects, |p| (0.008 * p.x) as f32);
    let (_, back) = round_trip(&volume);
    for (was, is) in volume.units().iter().zip(back.units()) {
        let near = f64::from((was - is).abs()) <= BOUND * (1.0 + 1e-5);
        let beside = (was - 0.1).abs() < 0.016;
        assert!(
            near || (!beside && (*was < 0.1) == (*is < 0.1)),
            "{was} became {is}, on the other side of the surface"
        );
    }
}

#[test]
fn either_representation_is_told_by_its_first_bytes() {
    let volume = Intermediate::Volume(Box::new(ball(Effects::default())));
    let bytes = encode_any(&volume, &Default::default()).unwrap();
    assert!(bytes.starts_with(b"LVOL"));
    let Intermediate::Volume(back) = decode_any(&bytes, &DecodeLimits::default()).unwrap() else { panic!("a VDI") };
    assert_eq!(back.grid().dims(), DIMS);
    assert!(matches!(decode_any(b"what", &DecodeLimits::default()), Err(CodecError::NotAVdi)));
}

#[test]
fn damage_newer_versions_and_large_claims_are_told_apart() {
    let bytes = volume::encode(&ball(Effects::default()), ErrorMeasure::Maximum);
    let limits = DecodeLimits::default();
    for n in [0, 3, 5, 9, 60, bytes.len() - 1] {
        assert!(
            matches!(volume::decode(&bytes[..n], &limits), Err(CodecError::Damaged(_) | CodecError::NotAVdi)),
            "{n}"
        );
    }
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 1;
    assert!(matches!(volume::decode(&damaged, &limits), Err(CodecError::Damaged(_))));
    let mut newer = bytes.clone();
    newer[4] = 9;
    assert!(matches!(volume::decode(&newer, &limits), Err(CodecError::NewerVersion { found: 9, newest: 5 })));
    let small = DecodeLimits { max_decoded_bytes: 1000 };
    let TooLarge { needed, limit } = too_large(volume::decode(&bytes, &small));
    assert_eq!((needed, limit), (4 * DIMS.iter().product::<usize>() as u64, 1000));
}

struct TooLarge {
    needed: u64,
    limit: u64,
}

fn too_large(outcome: Result<ReducedVolume, CodecError>) -> TooLarge {
    match outcome {
        Err(CodecError::TooLarge { needed_bytes: needed, limit_bytes: limit }) => TooLarge { needed, limit },
        other => panic!("{other:?}"),
    }
}

/// The ball with a wall of missing points through it and some alone.
fn masked() -> ReducedVolume {
    let whole = ball(Effects::default());
    let missing = |n: usize| n % DIMS[0] > 11 + n / DIMS[0] % 3 || n.is_multiple_of(171);
    let units = whole.units().iter().enumerate().map(|(n, u)| if missing(n) { f32::NAN } else { *u });
    ReducedVolume::new(*whole.grid(), whole.scene().clone(), *whole.params(), units.collect()).unwrap()
}

#[test]
fn missing_points_come_back_as_missing_and_cost_next_to_nothing() {
    let (whole, volume) = (ball(Effects::default()), masked());
    let (bytes, back) = round_trip(&volume);
    let is_seen = seen(&volume, 1);
    for (n, (was, is)) in volume.units().iter().zip(back.units()).enumerate() {
        assert_eq!(was.is_nan(), is.is_nan(), "point {n}");
        let near = f64::from((was - is).abs()) <= BOUND * (1.0 + 1e-5);
        assert!(was.is_nan() || near || !is_seen[n], "point {n}: {was} became {is}");
    }
    // 31 points alone take more than half of the ball, which is gone, gives back.
    let (without, _) = round_trip(&whole);
    assert!(bytes < without + 31 * 2, "{bytes} bytes, {without} without a mask");
    assert_eq!(volume::encode(&volume, ErrorMeasure::Maximum)[4..6], [2, 0]);
    assert_eq!(
        volume::encode(&whole, ErrorMeasure::Maximum)[4..6],
        [1, 0],
        "without missing points the bytes are those of version 1"
    );
}

/// The same in steps of a twentieth, which are wider than the bound.
fn in_steps(volume: &ReducedVolume) -> ReducedVolume {
    let units = volume.units().iter().map(|u| (20.0 * u).round() / 20.0).collect();
    ReducedVolume::new(*volume.grid(), volume.scene().clone(), *volume.params(), units).unwrap()
}

#[test]
fn values_in_steps_wider_than_the_bound_come_back_as_they_were() {
    for volume in [in_steps(&ball(Effects::default())), in_steps(&masked())] {
        let bytes = volume::encode(&volume, ErrorMeasure::MeanSquare);
        assert_eq!(bytes[4..6], [5, 0]);
        let back = volume::decode(&bytes, &DecodeLimits::default()).unwrap();
        let is_seen = seen(&volume, 1);
        for (n, (was, is)) in volume.units().iter().zip(back.units()).enumerate() {
            assert_eq!(was.is_nan(), is.is_nan(), "point {n}");
            assert!(was.is_nan() || !is_seen[n] || (was - is).abs() < 1e-6, "point {n}: {was} became {is}");
        }
        // Hidden ones, too, where all are to.
        let bytes = volume::encode(&volume, ErrorMeasure::Everywhere);
        let back = volume::decode(&bytes, &DecodeLimits::default()).unwrap();
        let off = |(was, is): (&f32, &f32)| if was.is_nan() { 0.0 } else { (was - is).abs() };
        assert!(volume.units().iter().zip(back.units()).map(off).fold(0.0, f32::max) < 1e-6);
    }
}

#[test]
fn a_volume_of_missing_points_alone_and_infinite_values() {
    let whole = ball(Effects::default());
    let all = |unit| vec![unit; whole.units().len()];
    let of = |units| ReducedVolume::new(*whole.grid(), whole.scene().clone(), *whole.params(), units);
    let (bytes, back) = round_trip(&of(all(f32::NAN)).unwrap());
    assert!(back.units().iter().all(|u| u.is_nan()));
    let (constant, _) = round_trip(&of(all(0.5)).unwrap());
    assert!(bytes <= constant + 12, "{bytes} bytes, {constant} for a constant");
    assert!(of(all(f32::INFINITY)).unwrap_err().reason.contains("missing"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// With the checksum made right again, so that what is behind it is met.
    #[test]
    fn changed_bytes_are_a_volume_or_an_error(
        at in 0_usize..4000, to: u8, cut in 0_usize..4000, is_masked: bool, has_steps: bool
    ) {
        let volume = if is_masked { masked() } else { ball(Effects::default()) };
        let volume = if has_steps { in_steps(&volume) } else { volume };
        let mut bytes = volume::encode(&volume, ErrorMeasure::Maximum);
        let body = bytes.len() - 4;
        bytes[10 + at % (body - 10)] = to;
        bytes.truncate(if cut % 4 == 0 { body - cut % (body - 20) } else { body });
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        if let Ok(volume) = volume::decode(&bytes, &DecodeLimits { max_decoded_bytes: 1 << 20 }) {
            prop_assert!(volume.units().iter().all(|u| !u.is_infinite() && (is_masked || !u.is_nan())));
        }
    }
}
