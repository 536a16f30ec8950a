//! `lamina-lab bench --effects`: what each effect costs, and what it changes, alone and with each other one.

use crate::cli;
use lamina::offline::open;
use lamina::say;
use lamina_model::effects::{ClipPlane, ColorField, DepthCue, Effects, Isosurface, Shading};
use lamina_model::{Image, Scale, Scene, Segmentation, VdiParams, Volume, psnr};
use lamina_raycast::{Backend, Field};
use std::time::{Duration, Instant};

/// A scene's own light, or one from above the eye's left shoulder; everything else made to suit the volume.
fn all(scene: &Scene, volume: &Volume) -> Vec<(&'static str, Effects)> {
    let (camera, bounds, range) = (&scene.camera, volume.grid().bounds(), scene.transfer.range());
    let toward_eye = camera.position() - bounds.center();
    let light = toward_eye + toward_eye.length() * glam::DVec3::new(-0.5, 0.7, 0.0);
    let light = Some(scene.effects.light.unwrap_or(light));
    let value = match range.scale() {
        Scale::Linear => 0.5 * (range.lo() + range.hi()),
        Scale::Log10 => (range.lo() * range.hi()).sqrt(),
    };
    let surface = Isosurface { value, color: [0.9, 0.85, 0.8], opacity: 0.8 };
    let plane = ClipPlane { normal: toward_eye, offset: toward_eye.dot(bounds.center()) };
    // A second field whatever the first: itself.
    let (range, points) = (*range, ColorField::cool_to_warm());
    let color_field = Some(ColorField { name: ITSELF.into(), range, points });
    let none = Effects::default;
    vec![
        ("shading", Effects { light, shading: Some(Shading::default()), ..none() }),
        ("shadows", Effects { light, shadows: Some(0.8), ..none() }),
        ("ambient_occlusion", Effects { ambient_occlusion: Some(0.8), ..none() }),
        ("isosurfaces", Effects { isosurfaces: vec![surface], ..none() }),
        ("clip_planes", Effects { clip_planes: vec![plane], ..none() }),
        ("pre_integrated", Effects { pre_integrated: true, ..none() }),
        ("depth_cue", Effects { depth_cue: Some(DepthCue { color: [0.0; 3], strength: 0.7 }), ..none() }),
        ("color_field", Effects { color_field, ..none() }),
    ]
}

/// The name of the volume as its own second field.
const ITSELF: &str = "itself";

/// What one set takes.
struct EffectCost {
    prepare: Duration,
    raycast: Duration,
    generate: Duration,
    image: Image,
}

fn cost(
    arguments: &cli::BenchArguments,
    backend: &Backend,
    volume: &Volume,
    scene: &Scene,
) -> anyhow::Result<EffectCost> {
    let params = VdiParams::new(arguments.resolution, arguments.gamma)?.with_step_voxels(scene.step_voxels)?;
    let (size, camera) = (arguments.size[0], &scene.camera);
    let mut times = [Vec::new(), Vec::new(), Vec::new()];
    let mut last = None;
    // The first round warms up: a GPU compiles its kernel in it.
    for round in 0..=arguments.rounds {
        let copy = volume.clone();
        let start = Instant::now();
        let field = Field::new(copy, scene);
        let prepared = Instant::now();
        let image = backend.raycast(&field, camera, size, size)?;
        let cast = prepared.elapsed();
        let (_, generate) = backend.generate(&field, &params, Segmentation::Greedy)?;
        if round > 0 {
            for (all, one) in times.iter_mut().zip([prepared - start, cast, generate]) {
                all.push(one);
            }
        }
        last = Some(image);
    }
    let [prepare, raycast, generate] = times.map(|mut t| {
        t.sort_unstable();
        t[t.len() / 2]
    });
    let image = last.ok_or_else(|| anyhow::anyhow!("no round was made"))?;
    Ok(EffectCost { prepare, raycast, generate, image })
}

/// Prints the table: medians, and the PSNR of each picture against the one without effects.
pub(super) fn print(arguments: &cli::BenchArguments) -> anyhow::Result<()> {
    let (volume, scene) = open(&arguments.input)?;
    let itself = volume.voxels().clone();
    let volume = volume.with_color_field(ITSELF, itself)?;
    let backend = Backend::open(arguments.input.backend)?;
    let with = |effects: Effects| Scene { effects, ..scene.clone() }.check();
    let none = cost(arguments, &backend, &volume, &with(Effects::default())?)?;
    say!("{:40} {:>12} {:>12} {:>12} {:>12}", "effects", "prepare_ms", "raycast_ms", "generate_ms", "psnr_db");
    let line = |name: &str, c: &EffectCost| -> anyhow::Result<()> {
        let ms = |d: Duration| 1e3 * d.as_secs_f64();
        let db = psnr(&c.image, &none.image)?;
        say!("{name:40} {:12.1} {:12.1} {:12.1} {db:12.2}", ms(c.prepare), ms(c.raycast), ms(c.generate));
        Ok(())
    };
    line("none", &none)?;
    let alone = all(&scene, &volume);
    for (name, effects) in &alone {
        line(name, &cost(arguments, &backend, &volume, &with(effects.clone())?)?)?;
    }
    for (n, (a, x)) in alone.iter().enumerate() {
        for (b, y) in &alone[n + 1..] {
            line(&format!("{a}, {b}"), &cost(arguments, &backend, &volume, &with(x.and(y))?)?)?;
        }
    }
    Ok(())
}
