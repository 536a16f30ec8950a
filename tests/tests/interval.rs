//! The 95 % interval of sampled quality holds the whole picture's figure 95 times in 100.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_model::{Quality, SamplePlan, Segmentation, VdiParams, ViewError, decibels, suggest::suggest};
use lamina_raycast::{Backend, Field};
use lamina_tests::processes::recorded_series;
use lamina_tuner::interval::half_width_db;
use lamina_vdi_render::render;
use lamina_volume_io::{Options, Series};

const SIZE: u32 = 256;
const ANGLES_DEG: [f64; 2] = [20.0, 50.0];
const SEEDS: usize = 200;
const BATCHES: u32 = 16;

#[test]
fn two_hundred_intervals_hold_the_truth_as_often_as_they_say() {
    let volume = Series::open(&recorded_series(), &Options::default()).unwrap().read(6).unwrap();
    let scene = suggest(&[&volume]).unwrap();
    let field = Field::new(volume, &scene);
    let params = VdiParams::new(96, 0.05).unwrap();
    let (vdi, _) = Backend::cpu().generate(&field, &params, Segmentation::Greedy).unwrap();
    // The squared error of every pixel of every view.
    let errors: Vec<Vec<f64>> = ANGLES_DEG
        .iter()
        .map(|&angle| {
            let camera = scene.camera.rotated_about_y(angle).unwrap();
            let cast = Backend::cpu().raycast(&field, &camera, SIZE, SIZE).unwrap();
            let drawn = render(&vdi, &camera, SIZE, SIZE).unwrap();
            let square = |(a, b): (&[f32; 3], &[f32; 3])| {
                (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).powi(2)).sum::<f64>() / 3.0
            };
            cast.pixels().iter().zip(drawn.pixels()).map(square).collect()
        })
        .collect();
    let truth_db = decibels(errors.iter().flatten().sum::<f64>() / (errors.len() * errors[0].len()) as f64);
    assert!((15.0..60.0).contains(&truth_db), "there is an error to be measured: {truth_db} dB");

    let plan = SamplePlan { image_size: SIZE, tile: 16, batches: BATCHES, angles_deg: ANGLES_DEG.to_vec() };
    let held = (0..SEEDS)
        .filter(|seed| {
            let batch = |view: usize, n: u32| {
                // Every seed has pixels of its own: those that the plan has for as many views; both views share them.
                let pixels = plan.pixels(*seed, n);
                let error = |&(x, y): &(u32, u32)| errors[view][(y * SIZE + x) as usize];
                pixels.iter().map(error).sum::<f64>() / pixels.len() as f64
            };
            let view = |v: usize| ViewError {
                angle_deg: ANGLES_DEG[v],
                batch_mse: (0..BATCHES).map(|n| batch(v, n)).collect(),
                ssim: None,
            };
            let quality = Quality { views: (0..ANGLES_DEG.len()).map(view).collect() };
            (quality.psnr_db() - truth_db).abs() <= half_width_db(&quality)
        })
        .count();
    let percent = 100.0 * held as f64 / SEEDS as f64;
    println!("{held} of {SEEDS} intervals hold {truth_db:.2} dB: {percent} %");
    assert!((92.0..=98.0).contains(&percent), "{percent} %");
}
