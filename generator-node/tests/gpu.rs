//! The GPU kernels against the scalar oracle, on any Vulkan device, be it in software. Without one the tests say that they
//! skip; with REQUIRE_GPU=1 they fail instead.

#![allow(clippy::unwrap_used)]

use glam::DVec3;
use half::f16;
use lamina_device::{Choice, Gpu, Opened};
use lamina_generator_node::kernel::gpu::{GpuError, GpuKernels};
use lamina_generator_node::kernel::{Field, scalar};
use lamina_model::{
    Camera, ControlPoint, GenerationParams, Grid, ScalarRange, Scale, Scene, SquaredError, Supersegment,
    TransferFunction, Vdi, Volume, Voxels,
};
use std::sync::OnceLock;

// What single precision and the table cost. A sample's position is off by some 1e-5 of a voxel, its scalar by 1e-6 of the
// range, the table's colour by the square of a bin, 1e-6: together some 1e-5 of a channel, 100 dB. Where a kink of the
// transfer function lies inside a bin, or a ray just grazes a voxel that is not a number, single pixels differ by more.
const MIN_PSNR_DB: f64 = 90.0;
const MAX_CHANNEL: f32 = 0.02;
/// Share of supersegments that may be more or fewer, and of rays whose lists are cut elsewhere: where a sample's difference
/// comes within rounding of gamma, or of 0 opacity.
const MAX_COUNT: f64 = 0.005;
const MAX_RAYS: f64 = 0.01;
/// Optical depth of a whole ray, relative. Beside it what one sample in a bin with a kink is off by: a quarter of the bin
/// (1/1024) times the change of slope there (2.5 in opacity), times a step (0.43).
const MAX_DEPTH: f64 = 1e-3;
const MAX_DEPTH_ABSOLUTE: f64 = 3e-4;

fn open() -> Option<GpuKernels> {
    match Gpu::open(Choice::Gpu) {
        Ok(Opened::Gpu(gpu)) => Some(GpuKernels::new(*gpu).unwrap()),
        Ok(Opened::Cpu(reason)) => panic!("asked for a GPU, got the processor: {reason}"),
        Err(e) if std::env::var_os("REQUIRE_GPU").is_some_and(|v| v == "1") => panic!("REQUIRE_GPU=1, and {e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    }
}

fn kernels() -> Option<&'static GpuKernels> {
    static KERNELS: OnceLock<Option<GpuKernels>> = OnceLock::new();
    KERNELS.get_or_init(open).as_ref()
}

const DIMS: [usize; 3] = [17, 33, 9];

/// Blobs on an empty ground, 0..1, with a slope so that no cell is flat.
fn value(p: DVec3) -> f64 {
    let blob = |center: DVec3, width: f64| (-(p - center).length_squared() / (width * width)).exp();
    let blobs = blob(DVec3::new(0.3, 0.3, 0.5), 0.2) + 0.8 * blob(DVec3::new(0.7, 0.75, 0.4), 0.15);
    (0.95 * blobs + 0.02 * p.x).min(1.0)
}

fn values(dims: [usize; 3]) -> Vec<f64> {
    let unit = |i: usize, n: usize| if n == 1 { 0.45 } else { i as f64 / (n - 1) as f64 };
    let at = |n: usize| {
        let (i, j, k) = (n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1]));
        value(DVec3::new(unit(i, dims[0]), unit(j, dims[1]), unit(k, dims[2])))
    };
    (0..dims.iter().product()).map(at).collect()
}

fn transfer(hi: f64, scale: Scale) -> TransferFunction {
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

fn camera(grid: &Grid, away: f64) -> Camera {
    let bounds = grid.bounds();
    let eye = bounds.center() + away * bounds.size().length() * DVec3::new(0.48, 0.36, 0.8);
    let fov_y_deg = 45.0 / away.max(1.0);
    Camera::new(eye, bounds.center() + DVec3::new(0.11, -0.07, 0.05), DVec3::Y, fov_y_deg).unwrap()
}

fn field(dims: [usize; 3], voxels: Voxels, hi: f64, scale: Scale, away: f64) -> Field {
    let grid = Grid::new(dims, DVec3::new(1.0, 0.6, 2.3), DVec3::new(-3.0, 100.0, 7.0)).unwrap();
    let scene = Scene {
        transfer: transfer(hi, scale),
        camera: camera(&grid, away),
        background: [0.1, 0.2, 0.4],
        step_voxels: 0.37,
    };
    Field::new(Volume::new(grid, voxels).unwrap(), &scene)
}

/// One field of every kind, and the shapes that are easily got wrong.
fn fields() -> Vec<(&'static str, Field)> {
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

#[test]
fn pictures_equal_the_oracles() {
    let Some(gpu) = kernels() else { return };
    for (name, field) in fields() {
        let (width, height) = (61, 47);
        let camera = &field.scene().camera;
        let ours = gpu.raycast(&field, camera, width, height).unwrap();
        let oracle = scalar::raycast(&field, camera, width, height).unwrap();
        let channels = |i: usize| (0..3).map(move |c| (i, c));
        let difference = |(i, c): (usize, usize)| (ours.pixels()[i][c] - oracle.pixels()[i][c]).abs();
        let worst = (0..ours.pixels().len()).flat_map(channels).map(difference).fold(0.0, f32::max);
        let mut error = SquaredError::default();
        error.add_all(ours.pixels(), oracle.pixels());
        let psnr = error.psnr_db();
        println!("{name}: {psnr:.1} dB, worst channel {worst:.1e}");
        assert!(psnr > MIN_PSNR_DB && worst < MAX_CHANNEL, "{name}: {psnr} dB, worst channel {worst}");
        let shown = oracle.pixels().iter().filter(|p| **p != field.scene().background).count();
        assert!(shown > 200, "{name} shows on {shown} pixels only");
        let some: Vec<(u32, u32)> = (0..200).map(|n| (n * 7 % width, n * 11 % height)).collect();
        let listed = gpu.raycast_pixels(&field, camera, width, height, &some).unwrap();
        for (color, (i, j)) in listed.iter().zip(some) {
            assert_eq!(*color, ours.pixels()[(j * width + i) as usize], "{name} at ({i}, {j})");
        }
    }
}

/// How near a VDI comes to the oracle's.
#[derive(Debug, Default)]
struct Agreement {
    /// Supersegments of both.
    counts: [usize; 2],
    /// Share of rays whose lists start or end elsewhere.
    other_rays: f64,
    /// Greatest relative difference of a ray's optical depth, beyond the absolute one allowed.
    worst_depth: f64,
    /// Mean difference of optical depths, relative to their mean.
    mean_depth: f64,
    /// Greatest difference of colour between supersegments that are alike and not nearly transparent.
    worst_color: f32,
}

fn agreement(ours: &Vdi, oracle: &Vdi) -> Agreement {
    let r = ours.resolution();
    let mut found = Agreement { counts: [ours, oracle].map(|v| v.segments().len()), ..Agreement::default() };
    let (mut differences, mut depths) = (0.0, 1e-30);
    for (i, j) in (0..r).flat_map(|j| (0..r).map(move |i| (i, j))) {
        let (a, b) = (ours.list(i, j), oracle.list(i, j));
        let steps = ours.header().ray_span(i, j).map_or(0, |(t_in, t_out)| ours.header().steps(t_out - t_in));
        assert!(a.iter().all(|s| s.end <= steps), "({i}, {j}) is longer than its {steps} steps: {a:?}");
        // Beyond 20 nothing is left of what lies behind.
        let sum = |list: &[Supersegment]| list.iter().map(|s| f64::from(s.optical_depth)).sum::<f64>().min(20.0);
        let (depth, difference) = (sum(b), (sum(a) - sum(b)).abs());
        (differences, depths) = (differences + difference, depths + depth);
        found.worst_depth = found.worst_depth.max((difference - MAX_DEPTH_ABSOLUTE) / depth.max(1e-30));
        if a.len() != b.len() || a.iter().zip(b).any(|(a, b)| (a.start, a.end) != (b.start, b.end)) {
            found.other_rays += 1.0 / f64::from(r * r);
            continue;
        }
        for (a, b) in a.iter().zip(b).filter(|(_, b)| b.optical_depth > 1e-3) {
            found.worst_color = (0..3).map(|c| (a.color[c] - b.color[c]).abs()).fold(found.worst_color, f32::max);
        }
    }
    found.mean_depth = differences / depths;
    found
}

/// Holds a VDI to the oracle's.
fn compare(name: &str, ours: &Vdi, oracle: &Vdi) {
    let found = agreement(ours, oracle);
    println!("{name}: {found:?}");
    let [n, m] = found.counts.map(|n| n as f64);
    assert!((n - m).abs() <= MAX_COUNT * m && found.other_rays < MAX_RAYS, "{name}: {found:?}");
    assert!(found.worst_depth < MAX_DEPTH && found.worst_color < MAX_CHANNEL, "{name}: {found:?}");
}

#[test]
fn vdis_equal_the_oracles() {
    let Some(gpu) = kernels() else { return };
    for (name, field) in fields() {
        for gamma in [0.0, 0.02, 1.0] {
            let params = GenerationParams::new(45, gamma).unwrap().with_step_voxels(0.43).unwrap();
            let (ours, time) = gpu.generate(&field, &params).unwrap();
            assert!(time > std::time::Duration::ZERO);
            compare(&format!("{name}, gamma {gamma}"), &ours, &scalar::generate(&field, &params).unwrap());
        }
    }
}

#[test]
fn rays_end_at_the_opacity_cutoff() {
    let Some(gpu) = kernels() else { return };
    let (name, field) = fields().swap_remove(0);
    let params = GenerationParams::new(64, 0.05).unwrap();
    let whole = gpu.generate(&field, &params).unwrap().0;
    let params = params.with_opacity_cutoff(0.5).unwrap();
    let ours = gpu.generate(&field, &params).unwrap().0;
    assert!(ours.segments().len() < whole.segments().len());
    compare(name, &ours, &scalar::generate(&field, &params).unwrap());
}

#[test]
fn a_transparent_volume_gives_no_supersegments() {
    let Some(gpu) = kernels() else { return };
    let field = field(DIMS, Voxels::U8(vec![3; DIMS.iter().product()]), 255.0, Scale::Linear, 1.3);
    let (vdi, _) = gpu.generate(&field, &GenerationParams::new(20, 0.1).unwrap()).unwrap();
    assert!(vdi.segments().is_empty());
    let image = gpu.raycast(&field, &field.scene().camera, 9, 9).unwrap();
    assert!(image.pixels().iter().all(|p| *p == field.scene().background));
}

#[test]
fn what_is_opaque_stays_a_number() {
    let Some(gpu) = kernels() else { return };
    let (_, field) = fields().swap_remove(6);
    let mut points = field.scene().transfer.points().to_vec();
    points[4].opacity = 1.0;
    points[3].opacity = 1.0;
    let transfer = TransferFunction::new(*field.scene().transfer.range(), None, points).unwrap();
    let voxels = Voxels::F64(values(DIMS));
    let field = Field::new(Volume::new(*field.grid(), voxels).unwrap(), &Scene { transfer, ..field.scene().clone() });
    let params = GenerationParams::new(45, 0.02).unwrap();
    let (ours, oracle) = (gpu.generate(&field, &params).unwrap().0, scalar::generate(&field, &params).unwrap());
    let found = agreement(&ours, &oracle);
    assert!(found.other_rays < MAX_RAYS && found.worst_color < MAX_CHANNEL, "{found:?}");
    assert!(oracle.segments().iter().any(|s| s.optical_depth.is_infinite()));
    let camera = &field.scene().camera;
    let picture = gpu.raycast(&field, camera, 64, 64).unwrap();
    let psnr = lamina_model::psnr(&picture, &scalar::raycast(&field, camera, 64, 64).unwrap()).unwrap();
    println!("opaque: {found:?}, {psnr:.1} dB");
    // The opacity of a step shorter than the unit length rises steeply just below opaque: more than a bin can follow.
    assert!(psnr > 60.0, "{psnr} dB");
}

#[test]
fn small_chunks_give_the_same_vdi_and_too_small_ones_say_so() {
    let (Some(gpu), Some(small), Some(tiny)) = (kernels(), open(), open()) else { return };
    let (_, field) = fields().swap_remove(0);
    let params = GenerationParams::new(40, 0.0).unwrap();
    let (whole, _) = gpu.generate(&field, &params).unwrap();
    let bytes = 24 * whole.segments().len() as u64;
    let (parts, _) = small.with_chunk_bytes(bytes / 7).generate(&field, &params).unwrap();
    assert_eq!(parts, whole);
    let e = tiny.with_chunk_bytes(48).generate(&field, &params).unwrap_err();
    assert!(matches!(e, GpuError::TooLarge { what: "one ray's list", .. }), "{e}");
}

#[test]
fn a_step_that_fits_the_box_exactly_counts_as_the_decoder_does() {
    let Some(gpu) = kernels() else { return };
    // The camera looks along an axis from far away: the middle rays take 64 steps and next to nothing.
    let grid = Grid::new([33; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let eye = DVec3::new(16.0, 16.0, 4000.0);
    let camera = Camera::new(eye, DVec3::splat(16.0), DVec3::Y, 0.5).unwrap();
    let scene = Scene { transfer: transfer(1.0, Scale::Linear), camera, background: [0.0; 3], step_voxels: 0.5 };
    let voxels = Voxels::F32((0..33 * 33 * 33).map(|n| 0.6 + 0.01 * (n % 33) as f32).collect());
    let field = Field::new(Volume::new(grid, voxels).unwrap(), &scene);
    let params = GenerationParams::new(65, 0.01).unwrap();
    let (ours, oracle) = (gpu.generate(&field, &params).unwrap().0, scalar::generate(&field, &params).unwrap());
    assert_eq!(ours.list(32, 32).last().unwrap().end, 64);
    for (i, j) in (0..65).flat_map(|j| (0..65).map(move |i| (i, j))) {
        let (a, b) = (ours.list(i, j).last().map(|s| s.end), oracle.list(i, j).last().map(|s| s.end));
        assert!(a <= b && a.is_some() == b.is_some(), "({i}, {j}): {a:?}, {b:?}");
    }
}

#[test]
fn a_lost_device_is_an_error() {
    let Ok(Opened::Gpu(gpu)) = Gpu::open(Choice::Gpu) else { return };
    let device = gpu.device().clone();
    let kernels = GpuKernels::new(*gpu).unwrap();
    let (_, field) = fields().swap_remove(0);
    let params = GenerationParams::new(20, 0.1).unwrap();
    kernels.generate(&field, &params).unwrap();
    device.destroy();
    for _ in 0..2 {
        let e = kernels.generate(&field, &params).unwrap_err();
        assert!(matches!(e, GpuError::Device(_)), "{e}");
    }
}

#[test]
fn a_volume_too_long_for_the_device_is_refused() {
    let Some(gpu) = kernels() else { return };
    let dims = [40_000, 1, 1];
    let field = field(dims, Voxels::U8(vec![200; 40_000]), 255.0, Scale::Linear, 1.3);
    let e = gpu.generate(&field, &GenerationParams::new(4, 0.1).unwrap()).unwrap_err();
    assert!(matches!(e, GpuError::TooLarge { needed: 40_000, .. }), "{e}");
}

#[test]
#[ignore = "two minutes in software, and 2 GB"]
fn the_greatest_resolution_runs() {
    let Some(gpu) = kernels() else { return };
    let (_, field) = fields().swap_remove(2);
    let params = GenerationParams::new(GenerationParams::MAX_RESOLUTION, 1.0).unwrap();
    let (vdi, time) = gpu.generate(&field, &params).unwrap();
    println!("{} supersegments in {time:?}", vdi.segments().len());
    assert!(vdi.segments().len() > 1 << 22);
}

/// `cargo test --release --workspace --test gpu -- --ignored --nocapture` prints how long both take.
#[test]
#[ignore = "figures, not a check"]
fn figures() {
    let Some(gpu) = kernels() else { return };
    let dims = [256; 3];
    let voxels = Voxels::U8(values(dims).into_iter().map(|x| (x * 255.0).round() as u8).collect());
    let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
    let camera = camera(&grid, 1.0);
    let scene = Scene { transfer: transfer(255.0, Scale::Linear), camera, background: [0.0; 3], step_voxels: 0.5 };
    let field = Field::new(Volume::new(grid, voxels).unwrap(), &scene);
    let params = GenerationParams::new(256, 0.02).unwrap();
    let clock = std::time::Instant::now;
    let first = clock();
    gpu.raycast(&field, &camera, 8, 8).unwrap();
    println!("{} ({}); upload and compilation {:?}", gpu.facts().name, gpu.facts().driver, first.elapsed());
    let start = clock();
    let (ours, kernels) = gpu.generate(&field, &params).unwrap();
    let wall = start.elapsed();
    let start = clock();
    let oracle = scalar::generate(&field, &params).unwrap();
    println!("generate 256^3 at r = 256: kernels {kernels:?}, in all {wall:?}; scalar {:?}", start.elapsed());
    println!("{:?}", agreement(&ours, &oracle));
    let start = clock();
    let picture = gpu.raycast(&field, &camera, 512, 512).unwrap();
    let wall = start.elapsed();
    let start = clock();
    let oracle = scalar::raycast(&field, &camera, 512, 512).unwrap();
    let psnr = lamina_model::psnr(&picture, &oracle).unwrap();
    println!("raycast 512 x 512: {wall:?}; scalar {:?}; {psnr:.1} dB", start.elapsed());
}
