//! One field of every kind.

use glam::DVec3;
use half::f16;
use lamina_model::{Camera, ControlPoint, Effects, Grid, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels};
use lamina_raycast::Field;

pub(crate) const DIMS: [usize; 3] = [17, 33, 9];

/// Blobs on an empty ground, 0..1, with a slope so that no cell is flat.
pub(crate) fn value(p: DVec3) -> f64 {
    let blob = |center: DVec3, width: f64| (-(p - center).length_squared() / (width * width)).exp();
    let blobs = blob(DVec3::new(0.3, 0.3, 0.5), 0.2) + 0.8 * blob(DVec3::new(0.7, 0.75, 0.4), 0.15);
    (0.95 * blobs + 0.02 * p.x).min(1.0)
}

pub(crate) fn values(dims: [usize; 3]) -> Vec<f64> {
    let unit = |i: usize, n: usize| if n == 1 { 0.45 } else { i as f64 / (n - 1) as f64 };
    let at = |n: usize| {
        let (i, j, k) = (n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1]));
        value(DVec3::new(unit(i, dims[0]), unit(j, dims[1]), unit(k, dims[2])))
    };
    (0..dims.iter().product()).map(at).collect()
}

pub(crate) fn transfer(hi: f64, scale: Scale) -> TransferFunction {
    let range = ScalarRange::new(if scale == Scale::Log10 { 0.01 * hi } else { 0.0 }, hi, scale).unwrap();
    let p = |at, color, opacity| ControlPoint { at, color, opacity };
    let points = vec![
        p(0.15, [0.1, 0.1, 0.9], 0.0),
        p(0.3, [0.1, 0.6, 0.9], 0.15),
        p(0.4, [0.2, 0.9, 0.3], 0.0),
        p(0.55, [0.9, 0.8, 0.1], 0.05),
        p(1.0, [1.0, 0.2, 0.1], 0.6),
    ];
    TransferFunction::new(range, None, points).unwrap()
}

pub(crate) fn camera(grid: &Grid, away: f64) -> Camera {
    let bounds = grid.bounds();
    let eye = bounds.center() + away * bounds.size().length() * DVec3::new(0.48, 0.36, 0.8);
    let fov_y_deg = 45.0 / away.max(1.0);
    Camera::new(eye, bounds.center() + DVec3::new(0.11, -0.07, 0.05), DVec3::Y, fov_y_deg).unwrap()
}

pub(crate) fn field(dims: [usize; 3], voxels: Voxels, hi: f64, scale: Scale, away: f64) -> Field {
    let grid = Grid::new(dims, DVec3::new(1.0, 0.6, 2.3), DVec3::new(-3.0, 100.0, 7.0)).unwrap();
    let scene = Scene {
        transfer: transfer(hi, scale),
        camera: camera(&grid, away),
        background: [0.1, 0.2, 0.4],
        step_voxels: 0.37,
        effects: Effects::default(),
    };
    Field::new(Volume::new(grid, voxels).unwrap(), &scene)
}

/// One field of every kind, and the shapes that are easily got wrong.
pub(crate) fn fields() -> Vec<(&'static str, Field)> {
    let v = values(DIMS);
    let holes = |x: &f64, n: usize| if n % 97 == 5 { f64::NAN } else { *x };
    let whole = |top: f64| v.iter().map(move |x| (x * top).round());
    let u8s = || Voxels::U8(whole(255.0).map(|x| x as u8).collect());
    let u16s = Voxels::U16(whole(65535.0).map(|x| x as u16).collect());
    let i16s = Voxels::I16(whole(32767.0).map(|x| x as i16).collect());
    let f16s = Voxels::F16(v.iter().enumerate().map(|(n, x)| f16::from_f64(holes(x, n))).collect());
    let f32s = || Voxels::F32(v.iter().enumerate().map(|(n, x)| holes(x, n) as f32).collect());
    let slice = [33, 17, 1];
    vec![
        ("u8", field(DIMS, u8s(), 255.0, Scale::Linear, 1.3)),
        ("u8 from inside", field(DIMS, u8s(), 255.0, Scale::Linear, 0.1)),
        ("u8 from afar", field(DIMS, u8s(), 255.0, Scale::Linear, 60.0)),
        ("u16", field(DIMS, u16s, 65535.0, Scale::Linear, 1.3)),
        ("i16", field(DIMS, i16s, 32767.0, Scale::Linear, 1.3)),
        ("f16 with holes", field(DIMS, f16s, 1.0, Scale::Linear, 1.3)),
        ("f32 with holes", field(DIMS, f32s(), 1.0, Scale::Linear, 1.3)),
        ("f32 in decades", field(DIMS, f32s(), 1.0, Scale::Log10, 1.3)),
        (
            "one layer",
            field(slice, Voxels::F32(values(slice).iter().map(|&x| x as f32).collect()), 1.0, Scale::Linear, 1.3),
        ),
    ]
}
