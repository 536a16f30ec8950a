//! What the kernel looks up: the ray caster's text with counters put in, which it writes instead of colors.

use crate::Field;
use crate::count::cases;
use crate::gpu::GpuKernels;
use crate::gpu::pipelines::MarchPipelines;
use crate::kernel::RAYCAST;
use crate::kernel::effects::EffectSet;
use crate::kernel::field::VoxelKind;
use lamina_compute::gpu::testing;
use lamina_model::Effects;

/// Where each count is raised, and the three sums that are told: exact in single precision for counts below 4096.
const COUNTERS: [(&str, &str); 8] = [
    ("(*state).next = step + 1u;", "counts.samples += 1.0;"),
    ("fn value_at(index: vec3f, u: ptr<function, f32>) -> bool {", "counts.fetches += 1.0;"),
    ("fn gradient_at(index: vec3f, gradient: ptr<function, vec3f>) -> bool {", "counts.gradients += 1.0;"),
    (
        "fn light_at(index: vec3f, start: u32) -> f32 {",
        "if SHADOWED && start == 0u { counts.shadows += 1.0; } else { counts.occlusion += 1.0; }",
    ),
    ("fn own_color(index: vec3f, color: ptr<function, vec3f>) {", "counts.colors += 1.0;"),
    ("colors[3u * n] = color.x;", "colors[3u * n] = counts.samples + 4096.0 * counts.fetches;"),
    ("colors[3u * n + 1u] = color.y;", "colors[3u * n + 1u] = counts.gradients + 4096.0 * counts.colors;"),
    ("colors[3u * n + 2u] = color.z;", "colors[3u * n + 2u] = counts.shadows + 4096.0 * counts.occlusion;"),
];

fn counting() -> String {
    let counts =
        "struct Counts { samples: f32, fetches: f32, gradients: f32, shadows: f32, occlusion: f32, colors: f32 }
        var<private> counts: Counts;\n";
    COUNTERS.iter().fold(format!("{counts}{RAYCAST}"), |text, (place, counter)| {
        assert_eq!(text.matches(place).count(), 1, "{place}");
        text.replace(place, &format!("{place}\n{counter}"))
    })
}

/// The ray caster's text without all that is for effects.
fn without_effects() -> String {
    let start = RAYCAST.find("    if EFFECTS {\n        let clipped").unwrap();
    let length = RAYCAST[start..].find("\n    }\n").unwrap() + "\n    }\n".len();
    let bare = format!("{}{}", &RAYCAST[..start], &RAYCAST[start + length..]);
    let effects = include_str!("../../kernel/effects.wgsl");
    // What the pipeline sets has to be there.
    let switches: Vec<&str> = effects.lines().filter(|line| line.starts_with("override")).collect();
    let bare = bare.replace(effects, &switches.join("\n")).replace("EFFECTS ||", "");
    assert!(!bare.contains("shade_sample(") && !bare.contains("if EFFECTS"));
    bare
}

#[test]
fn without_effects_no_bit_differs_from_a_kernel_that_never_had_them() {
    let (field, camera) = cases::field(Effects::default());
    let picture = |source: String| {
        let kernels = GpuKernels::new(testing::gpu()?).unwrap();
        put(&kernels, &field, &source);
        Some(kernels.raycast_pixels(&field, &camera, 16, 16, &pixels()).unwrap())
    };
    let [Some(ours), Some(bare)] = [RAYCAST.to_owned(), without_effects()].map(picture) else { return };
    assert!(ours.iter().any(|c| c[0] > 0.0) && ours == bare);
}

fn pixels() -> Vec<(u32, u32)> {
    (0..256).map(|n| (n % 16, n / 16)).collect()
}

/// Makes `source` the kernel for `field`.
fn put(kernels: &GpuKernels, field: &Field, source: &str) {
    let march = MarchPipelines::with_ray_caster(VoxelKind::Single, EffectSet::of(field), source.to_owned().into());
    kernels.state.lock().marches.push(march);
}

#[test]
fn what_is_not_asked_for_is_not_looked_up() {
    let Some(gpu) = testing::gpu() else { return };
    let kernels = GpuKernels::new(gpu).unwrap();
    let source = counting();
    for (effects, asked) in cases::asked() {
        let (field, camera) = cases::field(effects.clone());
        put(&kernels, &field, &source);
        let told = kernels.raycast_pixels(&field, &camera, 16, 16, &pixels()).unwrap();
        let sum = |channel: usize| {
            told.iter().fold([0, 0], |[low, high], c| {
                let both = c[channel] as u64;
                [low + both % 4096, high + both / 4096]
            })
        };
        let ([samples, fetches], [gradients, colors], [shadows, occlusion]) = (sum(0), sum(1), sum(2));
        assert!(samples > 100, "{effects:?}");
        // The field is interpolated once a sample and six times a gradient; what is more are ends of steps and surfaces.
        let values = fetches - samples - 6 * gradients;
        cases::check(&effects, asked, [values, gradients, shadows, occlusion, colors]);
    }
}
