//! What the kernel looks up: the ray caster's text with counters put in, which it writes instead of colours.

use crate::count::cases;
use crate::gpu::GpuKernels;
use crate::gpu::effects::Set;
use crate::gpu::pipelines::RAYCAST;
use crate::gpu::resident::Kind;
use lamina_device::testing;

/// Where each count is raised, and the three sums that are told: exact in single precision for counts below 4096.
const COUNTERS: [(&str, &str); 8] = [
    ("(*walk).next = step + 1u;", "counts.samples += 1.0;"),
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

#[test]
fn what_is_not_asked_for_is_not_looked_up() {
    let Some(gpu) = testing::gpu() else { return };
    let kernels = GpuKernels::new(gpu).unwrap();
    let source = counting();
    let pixels: Vec<(u32, u32)> = (0..256).map(|n| (n % 16, n / 16)).collect();
    for (effects, asked) in cases::asked() {
        let (field, camera) = cases::field(effects.clone());
        let gpu = &kernels.gpu;
        let counting = gpu.run("compiling", || {
            Ok::<_, lamina_device::DeviceError>(kernels.pipelines.march_of(gpu, Kind::Single, Set::of(&field), &source))
        });
        kernels.state.lock().unwrap().marches.push(counting.unwrap());
        let told = kernels.raycast_pixels(&field, &camera, 16, 16, &pixels).unwrap();
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
