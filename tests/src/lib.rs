//! What the suites share: small scenes with known answers.

pub mod browser;
pub mod http;
pub mod languages;
pub mod processes;
pub mod reference;
pub mod vdi_reference;

use glam::DVec3;
use lamina_model::{Camera, ControlPoint, Effects, Grid, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels};

/// A volume of `n`^3 voxels over [-1, 1]^3 with value `f(position)`.
///
/// # Panics
/// If `n` is 0.
pub fn sampled_cube(n: usize, f: impl Fn(DVec3) -> f64) -> Volume {
    let spacing = 2.0 / (n - 1) as f64;
    let grid = Grid::new([n; 3], DVec3::splat(spacing), DVec3::splat(-1.0)).expect("a cube is a grid");
    let mut voxels = Vec::with_capacity(n * n * n);
    for z in 0..n {
        for y in 0..n {
            voxels.extend((0..n).map(|x| f(DVec3::new(x as f64, y as f64, z as f64) * spacing - 1.0)));
        }
    }
    Volume::new(grid, Voxels::F64(voxels)).expect("as many voxels as the grid has")
}

/// A transfer function over 0..1 from (position, color, opacity) corners, opacities per world length `unit_length`.
///
/// # Panics
/// If the corners are not valid.
pub fn transfer(unit_length: f64, points: &[(f64, [f64; 3], f64)]) -> TransferFunction {
    let points = points.iter().map(|&(at, color, opacity)| ControlPoint { at, color, opacity }).collect();
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).expect("0..1 is a range");
    TransferFunction::new(range, Some(unit_length), points).expect("valid corners")
}

/// A scene with a camera on +z at distance 4 from the origin, 40 degrees of view, black background.
///
/// # Panics
/// Never.
pub fn front_scene(transfer: TransferFunction) -> Scene {
    let camera = Camera::new(4.0 * DVec3::Z, DVec3::ZERO, DVec3::Y, 40.0).expect("a valid camera");
    Scene { transfer, camera, background: [0.0; 3], step_voxels: 0.5, effects: Effects::default() }
}

/// Clumps of different size and value in [-1, 1]^3: smooth, with occlusion from every side.
pub fn clumps(p: DVec3) -> f64 {
    let clump = |x: f64, y: f64, z: f64, r: f64| (-(p - DVec3::new(x, y, z)).length_squared() / (r * r)).exp();
    clump(0.0, 0.0, 0.0, 0.3)
        + 0.8 * clump(0.5, 0.2, 0.4, 0.2)
        + 0.9 * clump(-0.5, -0.3, 0.1, 0.25)
        + 0.7 * clump(0.1, 0.6, -0.5, 0.22)
        + 0.6 * clump(-0.2, -0.6, -0.6, 0.3)
}

/// A transfer function that makes [`clumps`] visible: translucent hulls around denser cores.
pub fn clumps_transfer() -> TransferFunction {
    transfer(
        0.05,
        &[
            (0.0, [0.0, 0.0, 0.3], 0.0),
            (0.15, [0.1, 0.3, 0.9], 0.0),
            (0.4, [0.2, 0.8, 0.9], 0.08),
            (0.7, [1.0, 0.7, 0.1], 0.3),
            (1.0, [1.0, 0.2, 0.1], 0.6),
        ],
    )
}
