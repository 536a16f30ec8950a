//! The fast path of rendering against the oracle, on VDIs of a scene.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::{Camera, Scene, Segmentation, VdiParams, psnr};
use lamina_raycast::{Backend, Field};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube};
use lamina_vdi_render::{PreparedVdi, reference};

/// Picture sizes whose pixel centers lie on no pixel boundary of a VDI with an odd number of rays.
const SIZES: [(u32, u32); 2] = [(96, 96), (40, 72)];

#[test]
fn fast_pictures_of_a_scene_are_those_of_the_oracle() {
    let front = front_scene(clumps_transfer());
    let inside = Camera::new(DVec3::new(0.9, 0.3, 0.8), DVec3::ZERO, DVec3::Y, 60.0).unwrap();
    let within = Camera::new(DVec3::new(0.3, -0.2, 0.4), DVec3::new(-0.4, 0.1, -0.1), DVec3::Y, 70.0).unwrap();
    let (mut largest, mut least_db) = (0.0_f32, f64::INFINITY);
    for generation in [front.camera, inside] {
        let scene = Scene { camera: generation, background: [0.1, 0.3, 0.2], ..front.clone() };
        let field = Field::new(sampled_cube(48, clumps), &scene);
        for (resolution, gamma) in [(1, 0.1), (33, 0.0), (257, 0.02)] {
            let vdi = Backend::cpu()
                .generate(&field, &VdiParams::new(resolution, gamma).unwrap(), Segmentation::Greedy)
                .unwrap()
                .0;
            let prepared = PreparedVdi::new(&vdi);
            let turned = [0.0, 0.01, 10.0, 30.0, 60.0, 90.0, 180.0].map(|a| generation.rotated_about_y(a).unwrap());
            for camera in turned.into_iter().chain([within]) {
                for (width, height) in SIZES {
                    let fast = prepared.render(&camera, width, height).unwrap();
                    let exact = reference::render(&vdi, &camera, width, height).unwrap();
                    let channels = fast.pixels().as_flattened().iter().zip(exact.pixels().as_flattened());
                    let worst = channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    let db = psnr(&fast, &exact).unwrap();
                    assert!(worst < 2e-4 && db > 95.0, "r {resolution}, {}: {worst:e}, {db} dB", camera.position());
                    (largest, least_db) = (largest.max(worst), least_db.min(db));
                }
            }
        }
    }
    println!("largest difference {largest:e}, least PSNR {least_db:.1} dB");
}
