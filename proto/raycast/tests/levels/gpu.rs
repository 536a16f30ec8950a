//! The GPU kernels against the oracle, on any Vulkan device, hardware or software. Without one the tests say that they
//! skip; with REQUIRE_GPU=1 they fail instead.

use crate::agreement::{MAX_CHANNEL, MAX_RAYS, agreement, compare, compare_pictures};
use crate::fields::{DIMS, camera, field, fields, transfer, values};
use glam::DVec3;
use lamina_compute::gpu::{Choice, Gpu, Opened, testing};
use lamina_model::{Camera, Effects, Grid, Scale, Scene, Segmentation, TransferFunction, VdiParams, Volume, Voxels};
use lamina_raycast::gpu::{GpuError, GpuKernels};
use lamina_raycast::{Field, reference};
use std::sync::OnceLock;

fn open() -> Option<GpuKernels> {
    testing::gpu().map(|gpu| GpuKernels::new(gpu).unwrap())
}

fn kernels() -> Option<&'static GpuKernels> {
    static KERNELS: OnceLock<Option<GpuKernels>> = OnceLock::new();
    KERNELS.get_or_init(open).as_ref()
}

#[test]
fn pictures_equal_the_oracles() {
    let Some(gpu) = kernels() else { return };
    for (name, field) in fields() {
        let (width, height) = (61, 47);
        let camera = &field.scene().camera;
        let ours = gpu.raycast(&field, camera, width, height).unwrap();
        let oracle = reference::raycast(&field, camera, width, height).unwrap();
        compare_pictures(name, &ours, &oracle);
        let shown = oracle.pixels().iter().filter(|p| **p != field.scene().background).count();
        assert!(shown > 200, "{name} shows on {shown} pixels only");
        let some: Vec<(u32, u32)> = (0..200).map(|n| (n * 7 % width, n * 11 % height)).collect();
        let listed = gpu.raycast_pixels(&field, camera, width, height, &some).unwrap();
        for (color, (i, j)) in listed.iter().zip(some) {
            assert_eq!(*color, ours.pixels()[(j * width + i) as usize], "{name} at ({i}, {j})");
        }
    }
}

#[test]
fn vdis_equal_the_oracles() {
    let Some(gpu) = kernels() else { return };
    for (name, field) in fields() {
        for gamma in [0.0, 0.02, 1.0] {
            let params = VdiParams::new(45, gamma).unwrap().with_step_voxels(0.43).unwrap();
            let (ours, time) = gpu.generate(&field, &params, Segmentation::Greedy).unwrap();
            assert!(time > std::time::Duration::ZERO);
            compare(
                &format!("{name}, gamma {gamma}"),
                &ours,
                &reference::generate(&field, &params, Segmentation::Greedy).unwrap(),
            );
            let (fitted, _) = gpu.generate(&field, &params, Segmentation::Fitted).unwrap();
            let oracle = reference::generate(&field, &params, Segmentation::Fitted).unwrap();
            compare(&format!("{name}, fitted, gamma {gamma}"), &fitted, &oracle);
        }
    }
}

#[test]
fn rays_end_at_the_opacity_cutoff() {
    let Some(gpu) = kernels() else { return };
    let (name, field) = fields().swap_remove(0);
    let params = VdiParams::new(64, 0.05).unwrap();
    let whole = gpu.generate(&field, &params, Segmentation::Greedy).unwrap().0;
    let params = params.with_opacity_cutoff(0.5).unwrap();
    let ours = gpu.generate(&field, &params, Segmentation::Greedy).unwrap().0;
    assert!(ours.segments().len() < whole.segments().len());
    compare(name, &ours, &reference::generate(&field, &params, Segmentation::Greedy).unwrap());
}

#[test]
fn a_transparent_volume_gives_no_supersegments() {
    let Some(gpu) = kernels() else { return };
    let field = field(DIMS, Voxels::U8(vec![3; DIMS.iter().product()]), 255.0, Scale::Linear, 1.3);
    let (vdi, _) = gpu.generate(&field, &VdiParams::new(20, 0.1).unwrap(), Segmentation::Greedy).unwrap();
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
    let params = VdiParams::new(45, 0.02).unwrap();
    let (ours, oracle) = (
        gpu.generate(&field, &params, Segmentation::Greedy).unwrap().0,
        reference::generate(&field, &params, Segmentation::Greedy).unwrap(),
    );
    let found = agreement(&ours, &oracle);
    assert!(found.other_rays < MAX_RAYS && found.worst_color < MAX_CHANNEL, "{found:?}");
    assert!(oracle.segments().iter().any(|s| s.optical_depth.is_infinite()));
    let camera = &field.scene().camera;
    let picture = gpu.raycast(&field, camera, 64, 64).unwrap();
    let psnr = lamina_model::psnr(&picture, &reference::raycast(&field, camera, 64, 64).unwrap()).unwrap();
    println!("opaque: {found:?}, {psnr:.1} dB");
    // The opacity of a step shorter than the unit length rises steeply just below opaque: more than a bin can follow.
    assert!(psnr > 60.0, "{psnr} dB");
}

#[test]
fn small_chunks_give_the_same_vdi_and_too_small_ones_say_so() {
    let (Some(gpu), Some(small), Some(tiny)) = (kernels(), open(), open()) else { return };
    let (_, field) = fields().swap_remove(0);
    let params = VdiParams::new(40, 0.0).unwrap();
    let (whole, _) = gpu.generate(&field, &params, Segmentation::Greedy).unwrap();
    let bytes = 24 * whole.segments().len() as u64;
    let (parts, _) = small.with_chunk_bytes(bytes / 7).generate(&field, &params, Segmentation::Greedy).unwrap();
    assert_eq!(parts, whole);
    let e = tiny.with_chunk_bytes(48).generate(&field, &params, Segmentation::Greedy).unwrap_err();
    assert!(matches!(e, GpuError::TooLarge { what: "one ray's list", .. }), "{e}");
}

#[test]
fn a_step_that_fits_the_box_exactly_counts_as_the_decoder_does() {
    let Some(gpu) = kernels() else { return };
    // The camera looks along an axis from far away: the middle rays take 64 steps and next to nothing.
    let grid = Grid::new([33; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let eye = DVec3::new(16.0, 16.0, 4000.0);
    let camera = Camera::new(eye, DVec3::splat(16.0), DVec3::Y, 0.5).unwrap();
    let scene = Scene {
        transfer: transfer(1.0, Scale::Linear),
        camera,
        background: [0.0; 3],
        step_voxels: 0.5,
        effects: Effects::default(),
    };
    let voxels = Voxels::F32((0..33 * 33 * 33).map(|n| 0.6 + 0.01 * (n % 33) as f32).collect());
    let field = Field::new(Volume::new(grid, voxels).unwrap(), &scene);
    let params = VdiParams::new(65, 0.01).unwrap();
    let (ours, oracle) = (
        gpu.generate(&field, &params, Segmentation::Greedy).unwrap().0,
        reference::generate(&field, &params, Segmentation::Greedy).unwrap(),
    );
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
    let params = VdiParams::new(20, 0.1).unwrap();
    kernels.generate(&field, &params, Segmentation::Greedy).unwrap();
    device.destroy();
    for _ in 0..2 {
        let e = kernels.generate(&field, &params, Segmentation::Greedy).unwrap_err();
        assert!(matches!(e, GpuError::Device(_)), "{e}");
    }
}

#[test]
fn a_volume_too_long_for_the_device_is_refused() {
    let Some(gpu) = kernels() else { return };
    let dims = [40_000, 1, 1];
    let field = field(dims, Voxels::U8(vec![200; 40_000]), 255.0, Scale::Linear, 1.3);
    let e = gpu.generate(&field, &VdiParams::new(4, 0.1).unwrap(), Segmentation::Greedy).unwrap_err();
    assert!(matches!(e, GpuError::TooLarge { needed: 40_000, .. }), "{e}");
}

#[test]
#[ignore = "two minutes in software, and 2 GB"]
fn the_greatest_resolution_runs() {
    let Some(gpu) = kernels() else { return };
    let (_, field) = fields().swap_remove(2);
    let params = VdiParams::new(VdiParams::MAX_RESOLUTION, 1.0).unwrap();
    let (vdi, time) = gpu.generate(&field, &params, Segmentation::Greedy).unwrap();
    println!("{} supersegments in {time:?}", vdi.segments().len());
    assert!(vdi.segments().len() > 1 << 22);
}

/// `cargo test --release --workspace --test levels -- --ignored --nocapture` prints how long both take.
#[test]
#[ignore = "figures, not a check"]
fn figures() {
    let Some(gpu) = kernels() else { return };
    let dims = [256; 3];
    let voxels = Voxels::U8(values(dims).into_iter().map(|x| (x * 255.0).round() as u8).collect());
    let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
    let camera = camera(&grid, 1.0);
    let scene = Scene {
        transfer: transfer(255.0, Scale::Linear),
        camera,
        background: [0.0; 3],
        step_voxels: 0.5,
        effects: Effects::default(),
    };
    let field = Field::new(Volume::new(grid, voxels).unwrap(), &scene);
    let params = VdiParams::new(256, 0.02).unwrap();
    let clock = std::time::Instant::now;
    let first = clock();
    gpu.raycast(&field, &camera, 8, 8).unwrap();
    println!("{} ({}); upload and compilation {:?}", gpu.facts().name, gpu.facts().driver, first.elapsed());
    let start = clock();
    let (ours, kernels) = gpu.generate(&field, &params, Segmentation::Greedy).unwrap();
    let wall = start.elapsed();
    let start = clock();
    let oracle = reference::generate(&field, &params, Segmentation::Greedy).unwrap();
    println!("generate 256^3 at r = 256: kernels {kernels:?}, in all {wall:?}; scalar {:?}", start.elapsed());
    println!("{:?}", agreement(&ours, &oracle));
    let start = clock();
    let picture = gpu.raycast(&field, &camera, 512, 512).unwrap();
    let wall = start.elapsed();
    let start = clock();
    let oracle = reference::raycast(&field, &camera, 512, 512).unwrap();
    let psnr = lamina_model::psnr(&picture, &oracle).unwrap();
    println!("raycast 512 x 512: {wall:?}; scalar {:?}; {psnr:.1} dB", start.elapsed());
}
