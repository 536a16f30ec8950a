//! The volume format page against the codec: `read_volume.py`, written from the page alone and with Python's standard
//! library, must see exactly what the codec sees.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::volume::{self, ReferenceVolume};
use lamina_codec::{DecodeLimits, ErrorMeasure};
use lamina_model::{
    Camera, ControlPoint, Effects, Grid, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction, VolumeParams,
};
use std::path::Path;
use std::process::{Command, Output};

/// What the script says of a file, which may be coded after the next of `files`.
fn read_volumes(files: &[&[u8]]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("read_volume.py");
    let mut command = Command::new("python3");
    command.arg(script);
    for (n, bytes) in files.iter().enumerate() {
        let file = folder.path().join(format!("{n}.lvol"));
        std::fs::write(&file, bytes).unwrap();
        command.arg(file);
    }
    command.output().unwrap()
}

fn read_volume(bytes: &[u8]) -> Output {
    read_volumes(&[bytes])
}

/// Holds what the script says of `files` to the volume that the first one decodes to.
fn sees(files: &[&[u8]], decoded: &ReducedVolume) {
    let dims = decoded.grid().dims();
    let output = read_volumes(files);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next().unwrap(), format!("{} {} {}", dims[0], dims[1], dims[2]));
    let bound: f64 = lines.next().unwrap().parse().unwrap();
    assert!((bound - decoded.params().error_bound()).abs() <= 1e-7 * bound);
    let values: Vec<f32> = lines.map(|l| l.parse().unwrap()).collect();
    assert_eq!(values.len(), decoded.units().len());
    let differ = values.iter().zip(decoded.units()).position(|(a, b)| a != b && !(a.is_nan() && b.is_nan()));
    assert_eq!(differ, None, "{dims:?}: the first value that differs");
}

fn reduced(dims: [usize; 3], bound: f64, unit: impl Fn(DVec3) -> f64) -> ReducedVolume {
    let points = [0.3, 1.0].map(|at| ControlPoint { at, color: [1.0; 3], opacity: at - 0.3 });
    let range = ScalarRange::new(0.0, 10.0, Scale::Linear).unwrap();
    let scene = Scene {
        transfer: TransferFunction::new(range, Some(1.0), points.to_vec()).unwrap(),
        camera: Camera::new(DVec3::new(1.0, 2.0, 90.0), DVec3::ZERO, DVec3::Y, 35.0).unwrap(),
        background: [0.0; 3],
        step_voxels: 0.5,
        effects: Effects::default(),
    };
    let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
    let [nx, ny, _] = dims;
    let at = |n: usize| DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
    let params = VolumeParams::new(8, bound).unwrap();
    ReducedVolume::new(grid, scene, params, (0..grid.voxels()).map(|n| unit(at(n)) as f32).collect()).unwrap()
}

#[test]
fn an_independent_reader_sees_every_value() {
    let waves = |p: DVec3| 0.5 + 0.3 * (0.5 * p.x).sin() * (0.4 * p.y).cos() + 0.02 * p.z;
    let noise = |p: DVec3| ((p.x * 12.9898 + p.y * 78.233 + p.z * 37.719).sin() * 43_758.547).fract().abs();
    let volumes = [
        reduced([1, 1, 1], 0.1, waves),
        reduced([17, 1, 1], 0.001, waves),
        reduced([5, 4, 3], 0.01, noise),
        reduced([21, 18, 13], 0.02, waves),
        reduced([19, 23, 20], 0.002, |p| waves(p) + 0.02 * noise(p)),
        // Values far from what is expected, and a bound so fine that some are sent as they are.
        reduced([9, 9, 9], 1e-6, |p| if p.x == 4.0 { 7.0 - p.y } else { noise(p) }),
        // With a mask: a ball of missing points, and some here and there.
        reduced([21, 18, 13], 0.02, |p| if (p - DVec3::splat(8.0)).length() < 6.0 { f64::NAN } else { waves(p) }),
        reduced([9, 7, 11], 0.02, |p| if noise(p) < 0.2 { f64::NAN } else { waves(p) }),
    ];
    // As scans have them, in steps wider than the bound: with hidden values, with a mask, and of 16 bits.
    let scan = |of: f64| move |p: DVec3| ((waves(p) + 0.05 * noise(p)) * of).round() / of;
    let native = [
        reduced([21, 18, 13], 0.001, scan(255.0)),
        reduced([21, 18, 13], 0.0019, |p| if p.x < 3.0 { f64::NAN } else { 7.0 * scan(255.0)(p) - 2.0 }),
        reduced([9, 7, 11], 1e-6, scan(4095.0)),
    ];
    // Seen everywhere, with noise: fewer bytes as wavelet coefficients; with and without a mask.
    let noisy = |p: DVec3| 0.65 + 0.3 * (0.2 * p.x).sin() * (0.15 * p.y).cos() + 0.1 * noise(p);
    let wavelets = [
        reduced([40, 30, 9], 0.06, noisy),
        reduced([40, 30, 9], 0.06, |p| if p.x < 3.0 { f64::NAN } else { noisy(p) }),
        reduced([13, 30, 25], 0.06, noisy),
    ];
    let bounded = volumes.map(|volume| (volume, ErrorMeasure::Maximum, 1..=2)).into_iter();
    let native = native.map(|volume| (volume, ErrorMeasure::Maximum, 5..=5));
    let wavelets = wavelets.map(|volume| (volume, ErrorMeasure::MeanSquare, 3..=3));
    for (volume, measure, versions) in bounded.chain(native).chain(wavelets) {
        let bytes = volume::encode(&volume, measure);
        let dims = volume.grid().dims();
        assert!(versions.contains(&bytes[4]), "{dims:?}: version {}, {} bytes", bytes[4], bytes.len());
        let back = volume::decode(&bytes, &DecodeLimits::default()).unwrap();
        sees(&[&bytes], &back);
    }
}

#[test]
fn an_independent_reader_sees_volumes_coded_after_others() {
    let limits = DecodeLimits::default();
    // A front and waves that move; with a ball of missing points, and on fewer points first.
    let moving = |t: f64| {
        move |p: DVec3| {
            let p = p - DVec3::new(1.75 * t, 0.5 * t, -t);
            0.5 + 0.1 * (0.5 * p.x).sin() * (0.4 * p.y).cos()
                + 0.2 * (2.0 * (8.0 - (p - DVec3::splat(10.0)).length())).tanh()
        }
    };
    let holed = |t| move |p: DVec3| if (p - DVec3::splat(4.0)).length() < 3.0 { f64::NAN } else { moving(t)(p) };
    let dims = [35, 22, 19];
    for steps in [
        [reduced(dims, 0.004, moving(0.0)), reduced(dims, 0.004, moving(1.0)), reduced(dims, 0.002, moving(2.0))],
        [reduced(dims, 0.01, holed(0.0)), reduced(dims, 0.01, holed(1.0)), reduced(dims, 0.01, holed(1.5))],
        [
            reduced([1, 22, 19], 0.01, moving(0.0)),
            reduced(dims, 0.01, moving(0.0)),
            reduced([18, 12, 10], 0.01, moving(0.5)),
        ],
    ] {
        let mut files: Vec<Vec<u8>> = Vec::new();
        let mut reference: Option<ReferenceVolume> = None;
        for step in &steps {
            let (bytes, _) = volume::encode_after(step, ErrorMeasure::Maximum, reference.as_ref());
            let back = volume::decode_after(&bytes, &limits, reference.as_ref()).unwrap();
            reference = Some(ReferenceVolume::new(&bytes, &back));
            files.insert(0, bytes);
            sees(&files.iter().map(|f| &f[..]).collect::<Vec<_>>(), &back);
        }
        assert_eq!(files[0][4], 4, "coded after the one before");
        let alone = read_volume(&files[0]);
        assert!(!alone.status.success() && String::from_utf8_lossy(&alone.stderr).contains("is coded after"));
    }
}

#[test]
fn the_independent_reader_refuses_what_is_damaged() {
    let bytes = volume::encode(&reduced([5, 4, 3], 0.01, |p| 0.1 * p.x), ErrorMeasure::Maximum);
    for other in [&bytes[..bytes.len() - 1], b"P6 12 12 255", &[&bytes[..20], &[1], &bytes[21..]].concat()] {
        let output = read_volume(other);
        assert!(!output.status.success() && !output.stderr.is_empty());
        assert!(!String::from_utf8_lossy(&output.stderr).contains("Traceback"));
    }
}
