//! Images of media whose light is known in closed form.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::{Image, Intermediate, Scene, Segmentation, SquaredError, VdiParams};
use lamina_raycast::{Backend, Field};
use lamina_tests::{front_scene, sampled_cube, transfer};
use lamina_vdi_render::{Drawable, render};

const SIZE: u32 = 64;
const COLOR: [f64; 3] = [0.9, 0.5, 0.2];

/// PSNR of `image` against `light(x, y)`, the closed form at image position (x, y) of the plane one unit before the eye.
fn psnr_db(image: &Image, scene: &Scene, light: impl Fn(f64, f64) -> [f64; 3]) -> f64 {
    let mut error = SquaredError::default();
    for j in 0..SIZE {
        for i in 0..SIZE {
            let h = scene.camera.tan_half_fov();
            let x = h * ((2.0 * f64::from(i) + 1.0) / f64::from(SIZE) - 1.0);
            let y = h * (1.0 - (2.0 * f64::from(j) + 1.0) / f64::from(SIZE));
            error.add(image.pixels()[(j * SIZE + i) as usize], light(x, y).map(|c| c as f32));
        }
    }
    error.psnr_db()
}

/// Length inside [-1, 1]^3 of the ray from (0, 0, 4) through (x, y, 3): where it is inside all three slabs at once.
fn chord(x: f64, y: f64) -> f64 {
    let per_depth = (1.0 + x * x + y * y).sqrt();
    let reach = (1.0 / x.abs()).min(1.0 / y.abs()).min(5.0);
    (reach - 3.0).max(0.0) * per_depth
}

#[test]
fn a_homogeneous_box_is_exact_at_any_step_even_one_that_does_not_divide_it() {
    let scene = front_scene(transfer(1.0, &[(0.0, COLOR, 0.4)]));
    // Opacity 0.4 per unit length: alpha = 1 - 0.6^length.
    let light = |x: f64, y: f64| COLOR.map(|c| c * (1.0 - 0.6_f64.powf(chord(x, y))));
    for step_voxels in [0.5, 0.77, 3.1] {
        let scene = Scene { step_voxels, ..scene.clone() };
        let field = Field::new(sampled_cube(9, |_| 0.5), &scene);
        let cast = Backend::cpu().raycast(&field, &scene.camera, SIZE, SIZE).unwrap();
        assert!(psnr_db(&cast, &scene, light) > 120.0);
        let params = VdiParams::new(SIZE, 0.1).unwrap().with_step_voxels(step_voxels).unwrap();
        let vdi = Backend::cpu().generate(&field, &params, Segmentation::Greedy).unwrap().0;
        assert!(vdi.segments().len() <= (SIZE * SIZE) as usize, "one supersegment a ray");
        assert!(psnr_db(&render(&vdi, &scene.camera, SIZE, SIZE).unwrap(), &scene, light) > 120.0);
    }
}

#[test]
fn half_of_the_light_is_gone_at_one_length_in_a_homogeneous_box() {
    let scene = front_scene(transfer(1.0, &[(0.0, COLOR, 0.4)]));
    // 0.6^length = 1/2.
    let length = 0.5_f64.ln() / 0.6_f64.ln();
    let depth = |x: f64, y: f64| {
        if chord(x, y) < length { f64::INFINITY } else { 3.0 + length / (1.0 + x * x + y * y).sqrt() }
    };
    let field = Field::new(sampled_cube(9, |_| 0.5), &scene);
    let params = VdiParams::new(SIZE, 0.1).unwrap();
    let vdi = Backend::cpu().generate(&field, &params, Segmentation::Greedy).unwrap().0;
    let drawables = [Drawable::Volume(Box::new(field)), Drawable::new(Intermediate::Vdi(Box::new(vdi)))];
    for drawable in &drawables {
        let depths = drawable.half_depths(&scene.camera, SIZE, SIZE).unwrap();
        let h = scene.camera.tan_half_fov();
        let mut seen = 0;
        for (n, &found) in depths.iter().enumerate() {
            let at = |k: u32| h * ((2.0 * f64::from(k) + 1.0) / f64::from(SIZE) - 1.0);
            let (x, y) = (at(n as u32 % SIZE), at(n as u32 / SIZE));
            // Where the way through is just as long, rounding decides.
            if (chord(x, y) - length).abs() > 1e-6 {
                let wanted = depth(x, y);
                assert!(
                    f64::from(found) == wanted || (f64::from(found) - wanted).abs() < 1e-5,
                    "{found}, not {wanted}"
                );
                seen += u32::from(wanted.is_finite());
            }
        }
        assert!(seen > 1000 && seen < SIZE * SIZE, "{seen} pixels");
        // From +x the middle ray enters the box 3 units away, too: in a VDI it crosses many pixels' lists.
        let side = drawable.half_depths(&scene.camera.rotated_about_y(90.0).unwrap(), SIZE, SIZE).unwrap();
        let middle = f64::from(side[(SIZE / 2 * SIZE + SIZE / 2) as usize]);
        assert!((middle - 3.0 - length).abs() < 0.05, "{middle}");
    }
}

#[test]
fn a_homogeneous_box_seen_from_the_side_keeps_its_closed_form_inside_the_silhouette() {
    let scene = front_scene(transfer(1.0, &[(0.0, COLOR, 0.4)]));
    let field = Field::new(sampled_cube(9, |_| 0.5), &scene);
    let vdi = Backend::cpu().generate(&field, &VdiParams::new(256, 0.1).unwrap(), Segmentation::Greedy).unwrap().0;
    let side = scene.camera.rotated_about_y(90.0).unwrap();
    let image = render(&vdi, &side, SIZE, SIZE).unwrap();
    // From +x the middle ray runs parallel to the generation image, through 2 units of the box.
    let middle = image.pixels()[(SIZE / 2 * SIZE + SIZE / 2) as usize];
    for c in 0..3 {
        assert!((f64::from(middle[c]) - COLOR[c] * (1.0 - 0.36)).abs() < 0.01, "{middle:?}");
    }
}

#[test]
fn halving_the_step_shows_second_order_on_a_ramp() {
    // f rises linearly from 0 at z = -1 to 1 at z = 1, opacity is a f per unit length. The ray along z has optical depth
    // integral of -ln(1 - a u) over 2 units = 2 ((1 - a) ln(1 - a) + a) / a.
    let a = 0.7_f64;
    let tau = 2.0 * ((1.0 - a) * (1.0 - a).ln() + a) / a;
    let scene = front_scene(transfer(1.0, &[(0.0, COLOR, 0.0), (1.0, COLOR, a)]));
    let error = |step_voxels: f64| {
        let scene = Scene { step_voxels, ..scene.clone() };
        let field = Field::new(sampled_cube(3, |p| 0.5 * (p.z + 1.0)), &scene);
        let color = Backend::cpu().raycast_pixels(&field, &scene.camera, 1, 1, &[(0, 0)]).unwrap()[0];
        (f64::from(color[0]) - COLOR[0] * (1.0 - (-tau).exp())).abs()
    };
    let errors = [0.25, 0.125, 0.0625].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.25, "errors {errors:?}: order {order}");
    }
}

#[test]
fn an_emissive_sphere_has_the_light_of_its_chords() {
    // Inside radius 0.8 opacity is 0.7 per unit length, outside 0: a jump of the transfer function at distance 0.8.
    let tf = transfer(1.0, &[(0.0, COLOR, 0.7), (0.8, COLOR, 0.7), (0.8, COLOR, 0.0), (1.0, COLOR, 0.0)]);
    let light = |x: f64, y: f64| {
        // Distance of the line from the origin: |eye x direction|.
        let direction = DVec3::new(x, y, -1.0).normalize();
        let miss = (4.0 * DVec3::Z).cross(direction).length();
        let chord = 2.0 * (0.64 - miss * miss).max(0.0).sqrt();
        COLOR.map(|c| c * (1.0 - 0.3_f64.powf(chord)))
    };
    let psnr_at = |n: usize, step_voxels: f64| {
        let scene = Scene { step_voxels, ..front_scene(tf.clone()) };
        let field = Field::new(sampled_cube(n, |p| p.length()), &scene);
        psnr_db(&Backend::cpu().raycast(&field, &scene.camera, SIZE, SIZE).unwrap(), &scene, light)
    };
    let (coarse, fine) = (psnr_at(33, 0.5), psnr_at(65, 0.125));
    assert!(coarse > 35.0 && fine > coarse + 6.0, "coarse {coarse} dB, fine {fine} dB");
}
