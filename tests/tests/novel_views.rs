//! What a VDI shows against what the volume shows.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::effects::Isosurface;
use lamina_model::{
    Camera, Image, ReferenceSamples, SamplePlan, Scene, Segmentation, SquaredError, Vdi, VdiParams, psnr,
};
use lamina_raycast::{Backend, Field};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube};
use lamina_vdi_render::{self as viz, Detail, PreparedVdi, reference, render};

const SIZE: u32 = 96;

fn scene_and_field() -> (Scene, Field) {
    let scene = front_scene(clumps_transfer());
    let field = Field::new(sampled_cube(48, clumps), &scene);
    (scene, field)
}

fn vdi(field: &Field, resolution: u32, gamma: f64) -> Vdi {
    Backend::cpu().generate(field, &VdiParams::new(resolution, gamma).unwrap(), Segmentation::Greedy).unwrap().0
}

fn compare(field: &Field, vdi: &Vdi, camera: &Camera) -> f64 {
    let reference = Backend::cpu().raycast(field, camera, SIZE, SIZE).unwrap();
    let lit = reference.pixels().iter().filter(|p| p[0] + p[1] + p[2] > 0.05).count();
    assert!(lit > (SIZE * SIZE / 20) as usize, "the view shows something");
    psnr(&render(vdi, camera, SIZE, SIZE).unwrap(), &reference).unwrap()
}

fn psnr_db(vdi: &Vdi, reference: &ReferenceSamples, detail: Detail) -> f64 {
    let all = 0..reference.plan.batches;
    viz::Backend::default().quality_vdi(&PreparedVdi::new(vdi), reference, all, detail).unwrap().psnr_db()
}

#[test]
fn at_the_generation_view_the_unquantized_vdi_is_the_ray_cast_image() {
    let (scene, field) = scene_and_field();
    let db = compare(&field, &vdi(&field, SIZE, 0.0), &scene.camera);
    assert!(db > 90.0, "{db} dB");
}

#[test]
fn small_angles_do_not_collapse() {
    let (scene, field) = scene_and_field();
    let vdi = vdi(&field, 192, 0.0);
    let angles = [0.01, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 180.0];
    let psnr_db = angles.map(|a| compare(&field, &vdi, &scene.camera.rotated_about_y(a).unwrap()));
    assert!(psnr_db.iter().all(|&db| db > 35.0), "{psnr_db:?}");
    // Towards the generation view an error of half a pixel is the same for the whole ray, so quality falls a little; the
    // trap of boundaries behind the camera took 15 dB.
    assert!(psnr_db[..5].iter().all(|&db| db > psnr_db[5] - 6.0), "{psnr_db:?}");
}

/// Four displaced pictures on a rotated grid: linear between rays.
fn linear_db(vdi: &Vdi, reference: &ReferenceSamples) -> f64 {
    let plan = &reference.plan;
    let mut error = SquaredError::default();
    for (view, camera) in plan.test_cameras(&reference.scene.camera).unwrap().iter().enumerate() {
        let pixels = plan.pixels(view, 0);
        let draw = |by| reference::displaced_pixels(vdi, camera, [SIZE; 2], &pixels, by);
        let four = [[0.375, 0.125], [-0.125, 0.375], [-0.375, -0.125], [0.125, -0.375]].map(draw);
        let mean = |n: usize| std::array::from_fn(|c| four.iter().map(|drawn| 0.25 * drawn[n][c]).sum());
        let mean: Vec<[f32; 3]> = (0..pixels.len()).map(mean).collect();
        error.add_all(&mean, &reference.colors[view]);
    }
    -10.0 * error.mse().log10()
}

#[test]
fn neighboring_rays_blended_are_nearer_to_the_truth_than_the_nearest_one_and_than_linear_interpolation() {
    let (_, field) = scene_and_field();
    let plan = SamplePlan { image_size: SIZE, tile: 1, batches: 1, angles_deg: vec![10.0, 30.0, 60.0] };
    let reference = Backend::cpu().reference_samples(&field, &plan, 0).unwrap();
    for (r, gain) in [(32, 0.5), (64, 0.5), (128, 0.0), (384, -1e-3)] {
        let vdi = vdi(&field, r, 0.005);
        let [nearest, blended] = [Detail::Nearest, Detail::Cubic].map(|detail| psnr_db(&vdi, &reference, detail));
        let linear = linear_db(&vdi, &reference);
        assert!(blended > nearest + 1.0 && blended > linear + gain, "r {r}: {nearest}, {linear} and {blended} dB");
    }
}

#[test]
fn blending_keeps_an_opaque_surface_within_half_a_decibel_of_linear_interpolation() {
    let (mut scene, _) = scene_and_field();
    scene.effects.isosurfaces = vec![Isosurface { value: 0.5, color: [0.9, 0.8, 0.7], opacity: 1.0 }];
    let field = Field::new(sampled_cube(48, clumps), &scene);
    let plan = SamplePlan { image_size: SIZE, tile: 1, batches: 1, angles_deg: vec![10.0, 30.0, 60.0] };
    let reference = Backend::cpu().reference_samples(&field, &plan, 0).unwrap();
    for r in [32, 64, 128] {
        let vdi = vdi(&field, r, 0.005);
        let (blended, linear) = (psnr_db(&vdi, &reference, Detail::Cubic), linear_db(&vdi, &reference));
        assert!(blended > linear - 0.5, "r {r}: {linear} and {blended} dB");
    }
}

#[test]
fn quality_rises_with_resolution_and_with_falling_gamma() {
    let (_, field) = scene_and_field();
    let plan = SamplePlan { image_size: SIZE, tile: 1, batches: 1, angles_deg: vec![10.0, 30.0, 60.0] };
    let reference = Backend::cpu().reference_samples(&field, &plan, 0).unwrap();
    let q = |r, gamma| psnr_db(&vdi(&field, r, gamma), &reference, Detail::Nearest);
    let by_resolution = [32, 64, 128, 256].map(|r| q(r, 0.01));
    assert!(by_resolution.is_sorted_by(|a, b| a + 1.0 < *b), "{by_resolution:?}");
    let by_gamma = [0.3, 0.1, 0.03, 0.01].map(|gamma| q(256, gamma));
    assert!(by_gamma.is_sorted_by(|a, b| a + 0.5 < *b), "{by_gamma:?}");
}

#[test]
fn cameras_inside_the_volume_and_behind_the_generation_camera_see_what_the_volume_shows() {
    let (_, field) = scene_and_field();
    let vdi = vdi(&field, 256, 0.0);
    for (position, target) in [
        (DVec3::new(0.9, 0.1, 0.2), DVec3::new(-0.5, 0.0, 0.0)),
        (DVec3::new(0.0, -0.9, 0.05), DVec3::new(0.1, 0.6, -0.5)),
        (DVec3::new(0.3, 0.2, 6.0), DVec3::ZERO),
        (DVec3::new(0.0, 0.0, 12.0), DVec3::ZERO),
        (DVec3::new(0.2, 0.1, -4.0), DVec3::ZERO),
    ] {
        let fov = if position.z > 10.0 { 14.0 } else { 40.0 };
        let camera = Camera::new(position, target, DVec3::new(0.1, 1.0, 0.0), fov).unwrap();
        let db = compare(&field, &vdi, &camera);
        assert!(db > 33.0, "{db} dB from {position}");
    }
}

#[test]
fn a_generation_camera_inside_the_volume_gives_its_own_view_exactly() {
    let camera = Camera::new(DVec3::new(0.9, 0.3, 0.8), DVec3::ZERO, DVec3::Y, 60.0).unwrap();
    let scene = Scene { camera, ..front_scene(clumps_transfer()) };
    let field = Field::new(sampled_cube(48, clumps), &scene);
    let db = compare(&field, &vdi(&field, SIZE, 0.0), &camera);
    assert!(db > 90.0, "{db} dB");
}

#[test]
fn an_opacity_cutoff_saves_supersegments_and_costs_novel_views_not_its_own() {
    let (scene, field) = scene_and_field();
    let params = VdiParams::new(SIZE, 0.005).unwrap();
    let whole = Backend::cpu().generate(&field, &params, Segmentation::Greedy).unwrap().0;
    let cut =
        Backend::cpu().generate(&field, &params.with_opacity_cutoff(0.99).unwrap(), Segmentation::Greedy).unwrap().0;
    assert!(cut.segments().len() < whole.segments().len());
    let side = scene.camera.rotated_about_y(60.0).unwrap();
    let at = |vdi: &Vdi, camera: &Camera| compare(&field, vdi, camera);
    assert!(at(&cut, &scene.camera) > 36.0);
    assert!(at(&cut, &side) < at(&whole, &side) - 3.0);
}

#[test]
fn views_past_the_volume_are_background() {
    let scene = Scene { background: [0.2, 0.4, 0.6], ..front_scene(clumps_transfer()) };
    let field = Field::new(sampled_cube(48, clumps), &scene);
    let vdi = vdi(&field, 32, 0.1);
    let away = Camera::new(4.0 * DVec3::Z, 9.0 * DVec3::Z, DVec3::Y, 40.0).unwrap();
    let image: Image = render(&vdi, &away, 8, 8).unwrap();
    assert!(image.pixels().iter().all(|p| *p == [0.2, 0.4, 0.6]));
}
