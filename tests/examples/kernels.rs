//! One kernel, once, on a small scene: what `tests/bench/instructions` counts the instructions of.
//! `kernels KERNEL LEVEL`; without arguments it lists them. Everything runs on one thread, inside [`measured`].

use glam::DVec3;
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Scene, Segmentation, Vdi, VdiParams, Volume};
use lamina_raycast::Field;
use lamina_raycast::simd::{self, Level, Shot};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube};
use lamina_vdi_render::PreparedVdi;
use std::hint::black_box;

/// Voxels a side.
const CELLS: usize = 64;
/// Rays and pixels a side.
const SIDE: u32 = 96;
/// Those that exist at each level; the others have one level only, called "all".
const LEVELLED: [&str; 3] = ["raycast", "generate", "generate-all"];
const PLAIN: [&str; 3] = ["prepare-volume", "prepare-vdi", "render"];

/// The profiler counts while this runs.
#[inline(never)]
fn measured<T>(work: impl FnOnce() -> T) -> T {
    let made = black_box(work)();
    black_box(made)
}

/// Clumps with ripples on them, so that rays meet many short supersegments as well as long ones.
fn rippled(p: DVec3) -> f64 {
    let ripple = (40.0 * p.x).sin() * (34.0 * p.y).sin() * (28.0 * p.z).sin();
    clumps(p) * (1.0 + 0.1 * ripple)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Ok([kernel, level]) = <[String; 2]>::try_from(arguments) else {
        for level in Level::available() {
            LEVELLED.iter().for_each(|kernel| println!("{kernel} {}", name(level)));
        }
        PLAIN.iter().for_each(|kernel| println!("{kernel} all"));
        return Ok(());
    };
    let level = Level::available().into_iter().find(|&l| name(l) == level || level == "all");
    let level = level.ok_or("this processor has no such level")?;
    let scene = front_scene(clumps_transfer());
    let volume = sampled_cube(CELLS, rippled);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    Ok(pool.install(|| run(&kernel, level, volume, &scene))?)
}

fn name(level: Level) -> String {
    format!("{level:?}").to_lowercase()
}

fn run(kernel: &str, level: Level, volume: Volume, scene: &Scene) -> Result<(), String> {
    if kernel == "prepare-volume" {
        measured(|| Field::new(volume, scene));
        return Ok(());
    }
    let field = Field::new(volume, scene);
    let params = VdiParams::new(SIDE, 0.02).map_err(|e| e.to_string())?;
    let generate = || simd::generate(level, &field, &params, Segmentation::Greedy).map_err(|e| e.to_string());
    match kernel {
        "raycast" => {
            let shot = Shot { camera: &scene.camera, size: [SIDE; 2], floor: TRANSMITTANCE_FLOOR as f32 };
            measured(|| simd::raycast(level, &field, &shot));
        }
        "generate" => drop(measured(generate)?),
        "generate-all" => {
            let all = measured(|| {
                simd::generate_all(level, &field, &params, &[0.001, 0.005, 0.021, 0.085, 0.257], Segmentation::Greedy)
            });
            drop(all.map_err(|e| e.to_string())?);
        }
        "prepare-vdi" => {
            let vdi: Vdi = generate()?;
            measured(|| PreparedVdi::new(&vdi));
        }
        "render" => {
            let (vdi, camera) = (generate()?, scene.camera.rotated_about_y(30.0).map_err(|e| e.to_string())?);
            let prepared = PreparedVdi::new(&vdi);
            measured(|| prepared.render(&camera, SIDE, SIDE)).map_err(|e| e.to_string())?;
        }
        other => return Err(format!("no kernel {other}")),
    }
    Ok(())
}
