//! The GPU kernels against the scalar oracle, on any Vulkan device, be it in software. Without one the tests say that they
//! skip; with REQUIRE_GPU=1 they fail instead.

#![allow(clippy::unwrap_used)]

use glam::DVec3;
use lamina_device::{Choice, Gpu, Opened};
use lamina_model::{Aabb, Camera, GenerationParams, Supersegment, Vdi, VdiHeader};
use lamina_viz_node::kernel::gpu::{GpuError, GpuKernels};
use lamina_viz_node::kernel::{Backend, PreparedVdi, scalar};
use std::sync::{Arc, OnceLock};

// What single precision costs. Places in the image are off by some 1e-7 of the image, 3e-5 of a pixel at r = 257; depths by
// as much of the box, 3e-5 of a step in 300. A boundary crossed that much earlier or later moves as much optical depth from
// one supersegment to another: some 1e-4 of a channel, more only where what is stored jumps to opaque.
/// Every channel lies this near to the oracle's, or to what the oracle gives for rays displaced by [`DISPLACED`].
const MAX_CHANNEL: f32 = 1e-3;
/// Of a VDI's pixel or of a step, whichever is smaller in the world.
const DISPLACED: f64 = 1.0 / 2000.0;
/// Over all pixels within [`MAX_CHANNEL`].
const MIN_PSNR_DB: f64 = 70.0;
/// Share of pixels that only a displaced ray explains.
const MAX_DISPLACED: f64 = 0.01;

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

/// A linear congruential generator; the same lists every time.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, n: u32) -> u32 {
        (self.unit() * f64::from(n)) as u32
    }
}

fn look(position: [f64; 3], target: [f64; 3], fov: f64) -> Camera {
    Camera::new(position.into(), target.into(), DVec3::new(0.01, 1.0, 0.0), fov).unwrap()
}

/// A little askew: turned by 180 degrees, a frontal camera's diagonal rays run exactly through pixel corners.
fn outside() -> Camera {
    look([0.05, 0.03, 4.0], [0.02, -0.04, 0.0], 40.0)
}

fn inside() -> Camera {
    look([0.31, 0.22, 0.43], [-0.2, -0.1, -1.0], 70.0)
}

/// Five thousand times the box, 800,000 steps, away.
fn far() -> Camera {
    look([400.0, 300.0, 10_000.0], [0.02, -0.04, 0.0], 0.016)
}

fn header(camera: Camera, resolution: u32) -> VdiHeader {
    VdiHeader {
        camera,
        bounds: Aabb::new(DVec3::splat(-1.0), DVec3::new(1.0, 0.9, 1.1)).unwrap(),
        step_length: 0.013,
        params: GenerationParams::new(resolution, 0.1).unwrap(),
        transfer_id: 0,
        background: [0.1, 0.2, 0.4],
    }
}

/// Lists in about `share` of the pixels, in patches; one supersegment in `opaque` is opaque, if not 0.
fn random_vdi(camera: Camera, resolution: u32, share: f64, opaque: u32) -> Arc<Vdi> {
    let header = header(camera, resolution);
    let mut dice = Dice(u64::from(resolution) * 7 + 1);
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    let patch = (resolution / 12).max(1);
    let patches: Vec<bool> = (0..32 * 32).map(|_| dice.unit() < share).collect();
    for n in 0..resolution * resolution {
        let (i, j) = (n % resolution, n / resolution);
        let full = patches[(j / patch * 32 + i / patch) as usize % patches.len()];
        if let Some((t_in, t_out)) = header.ray_span(i, j).filter(|_| full) {
            let steps = header.steps(t_out - t_in);
            let mut depth = dice.below(40);
            while depth < steps {
                let end = (depth + 1 + dice.below(30)).min(steps);
                let solid = opaque > 0 && dice.below(opaque) == 0;
                let optical_depth = if solid { f32::INFINITY } else { (dice.unit().powi(3) * 1.5) as f32 + 1e-6 };
                let color = std::array::from_fn(|_| dice.unit() as f32);
                segments.push(Supersegment { start: depth, end, color, optical_depth });
                depth = end + dice.below(3) * dice.below(40);
            }
        }
        offsets.push(segments.len() as u32);
    }
    Arc::new(Vdi::new(header, offsets, segments).unwrap())
}

/// Views about, in and behind the volume; sizes whose pixel centres lie on no pixel boundary of the VDI.
fn views(generation: Camera) -> Vec<(Camera, u32, u32)> {
    let mut views: Vec<_> = [0.0, 10.0, 60.0, 90.0, 180.0].map(|a| generation.rotated_about_y(a).unwrap()).into();
    views.push(look([0.3, -0.4, 0.2], [-0.5, 0.1, -0.3], 80.0));
    views.push(look([0.01, 0.9, 0.0], [0.1, -1.0, 0.05], 60.0));
    views.push(look([-3000.0, 2000.0, 6000.0], [0.0, 0.0, 0.0], 0.02));
    // At the generation camera's own position, looking elsewhere and with another angle.
    let own = generation.position();
    views.push(Camera::new(own, DVec3::new(0.3, 0.2, 0.0), DVec3::new(0.2, 1.0, 0.1), 50.0).unwrap());
    let mut views: Vec<_> = views.into_iter().map(|c| (c, 64, 64)).collect();
    views.push((generation.rotated_about_y(30.0).unwrap(), 96, 32));
    views
}

#[derive(Debug, Default, Clone, Copy)]
struct Agreement {
    channel: f32,
    displaced: f64,
    psnr_db: f64,
}

fn difference(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Cameras that see the same from a little beside.
fn displaced(vdi: &Vdi, camera: &Camera) -> Vec<Camera> {
    let header = vdi.header();
    let depth = header.camera.view_from_world(header.bounds.center()).z.abs().max(0.1);
    let pixel = 2.0 * header.camera.tan_half_fov() * depth / f64::from(vdi.resolution());
    let by = DISPLACED * pixel.min(header.step_length);
    let sides =
        (0..27).filter(|&n| n != 13).map(|n| DVec3::from_array([n % 3, n / 3 % 3, n / 9].map(|k| f64::from(k - 1))));
    let up = (camera.direction(0.5, 0.0, 1, 1) - camera.direction(0.5, 1.0, 1, 1)).normalize();
    let beside = |side: DVec3| {
        Camera::new(camera.position() + by * side, camera.target() + by * side, up, camera.fov_y_deg()).unwrap()
    };
    sides.map(beside).collect()
}

fn agreement(kernels: &GpuKernels, vdi: &Arc<Vdi>, (camera, width, height): (Camera, u32, u32)) -> Agreement {
    let exact = scalar::render(vdi, &camera, width, height).unwrap();
    let drawn = kernels.render(&PreparedVdi::new(vdi.clone()), &camera, width, height).unwrap();
    let place = |n: usize| (n as u32 % width, n as u32 / width);
    let (mut found, mut suspects, mut squares) = (Agreement::default(), Vec::new(), 0.0);
    for (n, (a, b)) in exact.pixels().iter().zip(drawn.pixels()).enumerate() {
        let d = difference(a, b);
        if d <= MAX_CHANNEL {
            found.channel = found.channel.max(d);
            squares += a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        } else {
            suspects.push(place(n));
        }
    }
    found.displaced = suspects.len() as f64 / f64::from(width * height);
    found.psnr_db = -10.0 * (squares / f64::from(3 * width * height)).log10();
    let mut ranges = vec![[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; suspects.len()];
    for camera in if suspects.is_empty() { Vec::new() } else { displaced(vdi, &camera) } {
        for (range, color) in ranges.iter_mut().zip(scalar::render_pixels(vdi, &camera, width, height, &suspects)) {
            for (c, value) in color.into_iter().enumerate() {
                range[0][c] = range[0][c].min(value);
                range[1][c] = range[1][c].max(value);
            }
        }
    }
    for (range, (i, j)) in ranges.iter().zip(&suspects) {
        let n = (j * width + i) as usize;
        for (c, value) in drawn.pixels()[n].into_iter().enumerate() {
            let explained = (range[0][c] - MAX_CHANNEL..=range[1][c] + MAX_CHANNEL).contains(&value);
            let (r, position, exact) = (vdi.resolution(), camera.position(), exact.pixels()[n]);
            if !explained {
                println!("r {r}, from {position}, ({i}, {j}): {value} for {exact:?}, {range:?}");
                found.displaced += 1.0;
            }
        }
    }
    found
}

#[test]
fn pictures_agree_with_the_oracle_from_everywhere() {
    let Some(kernels) = kernels() else { return };
    let cameras = [(outside(), 1), (outside(), 2), (outside(), 33), (outside(), 257), (inside(), 33), (far(), 65)];
    for (generation, resolution) in cameras {
        for (share, opaque) in [(0.4, 0), (0.7, 6)] {
            let vdi = random_vdi(generation, resolution, share, opaque);
            for view in views(generation) {
                let a = agreement(kernels, &vdi, view);
                println!("r {resolution} opaque {opaque} from {}: {a:?}", view.0.position());
            }
        }
    }
}
