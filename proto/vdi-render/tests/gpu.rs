//! The GPU kernels against the oracle, on any Vulkan device, hardware or software. Without one the tests print that they are
//! skipped; with REQUIRE_GPU=1 they fail instead.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_compute::gpu::{Choice, testing};
use lamina_model::{
    Aabb, Camera, ControlPoint, Effects, Image, ReferenceSamples, SamplePlan, ScalarRange, Scale, Scene, Supersegment,
    TransferFunction, Vdi, VdiHeader, VdiParams,
};
use lamina_vdi_render::gpu::{GpuError, GpuKernels};
use lamina_vdi_render::{Backend, Detail, PreparedVdi, reference};
use std::ops::Deref;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

// What single precision costs. Places in the image are off by some 1e-7 of the image, 3e-5 of a pixel at r = 257; depths by
// as much of the box, 3e-5 of a step in 300. A boundary crossed that much earlier or later moves as much optical depth from
// one supersegment to another: some 1e-5 of a channel. A ray that hardly moves in the VDI's image or depth, as all do in
// views near the generation camera's, stretches that over its way: some 1e-4, as 1e-3 bounds. And where a ray just passes
// by the corner of something opaque, it may hit it.
/// Every channel lies this near to the oracle's, or to what the oracle gives for rays displaced by [`DISPLACED`]. Of twelve
/// other draws of the lists three exceed it, in 5 of some 9 million pixels, by up to a fifth.
const MAX_CHANNEL: f32 = 1e-3;
/// Of a VDI's pixel or of a step, whichever is smaller in the world.
const DISPLACED: f64 = 1.0 / 2000.0;
/// Over all pixels within [`MAX_CHANNEL`].
const MIN_PSNR_DB: f64 = 90.0;
/// Share of pixels that only a displaced ray explains.
const MAX_DISPLACED: f64 = 0.002;

fn open() -> Option<GpuKernels> {
    testing::gpu().map(|gpu| GpuKernels::new(gpu).unwrap())
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
        params: VdiParams::new(resolution, 0.1).unwrap(),
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

/// Views about, in and behind the volume; sizes whose pixel centers lie on no pixel boundary of the VDI.
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
    let exact = reference::render(vdi, &camera, width, height).unwrap();
    let rendered = picture(kernels, &PreparedVdi::new(vdi.clone()), &camera, [width, height]).unwrap();
    let place = |n: usize| (n as u32 % width, n as u32 / width);
    let (mut found, mut suspects, mut squares) = (Agreement::default(), Vec::new(), 0.0);
    for (n, (a, b)) in exact.pixels().iter().zip(rendered.pixels()).enumerate() {
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
        for (range, color) in ranges.iter_mut().zip(reference::render_pixels(vdi, &camera, width, height, &suspects)) {
            for (c, value) in color.into_iter().enumerate() {
                range[0][c] = range[0][c].min(value);
                range[1][c] = range[1][c].max(value);
            }
        }
    }
    for (range, &(i, j)) in ranges.iter().zip(&suspects) {
        let n = (j * width + i) as usize;
        for (c, value) in rendered.pixels()[n].into_iter().enumerate() {
            let explained = (range[0][c] - MAX_CHANNEL..=range[1][c] + MAX_CHANNEL).contains(&value);
            let (r, position, exact) = (vdi.resolution(), camera.position(), exact.pixels()[n]);
            assert!(explained, "r {r}, from {position}, ({i}, {j}): {value} for {exact:?}, beside it {range:?}");
        }
    }
    found
}

fn picture<V: Deref<Target = Vdi>>(
    kernels: &GpuKernels,
    vdi: &PreparedVdi<V>,
    camera: &Camera,
    size: [u32; 2],
) -> Result<Image, GpuError> {
    let colors = kernels.picture(vdi, camera, size, Detail::Nearest)?;
    Ok(Image::new(size[0], size[1], colors).unwrap())
}

fn assert_agrees(kernels: &GpuKernels, vdi: &Arc<Vdi>, view: (Camera, u32, u32)) -> Agreement {
    let found = agreement(kernels, vdi, view);
    let (r, position) = (vdi.resolution(), view.0.position());
    assert!(found.psnr_db > MIN_PSNR_DB && found.displaced <= MAX_DISPLACED, "r {r}, from {position}: {found:?}");
    found
}

#[test]
fn pictures_agree_with_the_oracle_from_everywhere() {
    let Some(kernels) = kernels() else { return };
    let mut worst = Agreement { psnr_db: f64::INFINITY, ..Agreement::default() };
    let cameras = [(outside(), 1), (outside(), 2), (outside(), 33), (outside(), 257), (inside(), 33), (far(), 65)];
    for (generation, resolution) in cameras {
        for (share, opaque) in [(0.4, 0), (0.7, 6)] {
            let vdi = random_vdi(generation, resolution, share, opaque);
            for view in views(generation) {
                let found = assert_agrees(kernels, &vdi, view);
                worst.channel = worst.channel.max(found.channel);
                worst.displaced = worst.displaced.max(found.displaced);
                worst.psnr_db = worst.psnr_db.min(found.psnr_db);
            }
        }
    }
    println!("{}: {worst:?}", kernels.facts().name);
}

/// One pixel whose list is red, a gap, then green to the end of the box.
fn two_colors() -> Arc<Vdi> {
    let camera = Camera::new(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 40.0).unwrap();
    let header = header(camera, 1);
    let (t_in, t_out) = header.ray_span(0, 0).unwrap();
    let end = header.steps(t_out - t_in);
    let red = Supersegment { start: 10, end: 40, color: [1.0, 0.0, 0.0], optical_depth: 0.5 };
    let green = Supersegment { start: 60, end, color: [0.0, 1.0, 0.0], optical_depth: 2.0 };
    Arc::new(Vdi::new(header, vec![0, 2], vec![red, green]).unwrap())
}

#[test]
fn a_list_made_by_hand_has_the_colors_it_must_from_both_sides() {
    let Some(kernels) = kernels() else { return };
    let vdi = two_colors();
    let (near, far, background) = ((-0.5_f64).exp(), (-2.0_f64).exp(), vdi.header().background);
    let behind = near * far;
    for (z, red, green) in [(4.0, 1.0 - near, near * (1.0 - far)), (-4.0, far * (1.0 - near), 1.0 - far)] {
        // The center pixel looks along z.
        let camera = Camera::new(DVec3::new(0.0, 0.0, z), DVec3::ZERO, DVec3::Y, 40.0).unwrap();
        let image = picture(kernels, &PreparedVdi::new(vdi.clone()), &camera, [3, 3]).unwrap();
        let expected = [red, green, 0.0].map(|c| c as f32);
        let expected: [f32; 3] = std::array::from_fn(|c| expected[c] + behind as f32 * background[c]);
        assert!(difference(&image.pixels()[4], &expected) < 1e-5, "{:?} for {expected:?}", image.pixels()[4]);
    }
}

#[test]
fn a_ray_parallel_to_the_image_plane_agrees_with_the_oracle() {
    let Some(kernels) = kernels() else { return };
    let camera = Camera::new(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 40.0).unwrap();
    let vdi = random_vdi(camera, 64, 0.7, 9);
    // Row and column 16 of 33 look along -x exactly: depth does not change.
    for z in [0.3, 0.3 + 1e-13, -0.41] {
        let from = Camera::new(DVec3::new(3.0, 0.21, z), DVec3::new(0.0, 0.21, z), DVec3::Y, 40.0).unwrap();
        assert_agrees(kernels, &vdi, (from, 33, 33));
    }
}

#[test]
fn an_empty_vdi_is_background() {
    let Some(kernels) = kernels() else { return };
    let r = 24;
    let vdi = Vdi::new(header(outside(), r), vec![0; (r * r + 1) as usize], Vec::new()).unwrap();
    let image = picture(kernels, &PreparedVdi::new(&vdi), &outside(), [16, 8]).unwrap();
    assert!(image.pixels().iter().all(|&p| p == vdi.header().background));
}

#[test]
fn listed_pixels_are_those_of_the_picture_also_among_several_vdis() {
    let Some(kernels) = kernels() else { return };
    let vdis: Vec<_> = (30..36).map(|r| PreparedVdi::new(random_vdi(outside(), r, 0.5, 8))).collect();
    let camera = outside().rotated_about_y(40.0).unwrap();
    let pixels: Vec<_> = (0..48).flat_map(|j| (0..64).map(move |i| (i, j))).rev().collect();
    // More than are kept, each one twice.
    for vdi in vdis.iter().chain(&vdis) {
        let image = picture(kernels, vdi, &camera, [64, 48]).unwrap();
        let mut singly = kernels.pixels(vdi, &camera, [64, 48], &pixels, Detail::Nearest).unwrap();
        singly.reverse();
        assert_eq!(image.pixels(), singly);
    }
    assert!(matches!(picture(kernels, &vdis[0], &camera, [0, 8]), Err(GpuError::Invalid(_))));
    assert!(kernels.pixels(&vdis[0], &camera, [64, 48], &[], Detail::Nearest).unwrap().is_empty());
}

#[test]
fn what_does_not_fit_says_what_would_help_and_is_drawn_by_the_processor() {
    let Some(kernels) = open() else { return };
    let vdi = PreparedVdi::new(random_vdi(outside(), 33, 0.5, 0));
    let kernels = kernels.with_array_bytes(1000);
    let refusal = picture(&kernels, &vdi, &outside(), [8, 8]).unwrap_err();
    assert!(matches!(refusal, GpuError::TooLarge { limit: 62, .. }), "{refusal}");
    assert!(refusal.to_string().contains("raise gamma, or run on the processor"), "{refusal}");
    let backend = Backend::on_gpu(kernels);
    let image = backend.render_vdi(&vdi, &outside(), 8, 8, Detail::Nearest).unwrap();
    assert_eq!(image, vdi.render(&outside(), 8, 8).unwrap());
    assert!(backend.render_vdi(&vdi, &outside(), 0, 8, Detail::Nearest).is_err());
}

#[test]
fn blended_pictures_are_the_processors() {
    let Some(kernels) = open() else { return };
    let vdi = PreparedVdi::new(random_vdi(outside(), 33, 0.5, 0));
    let camera = outside().rotated_about_y(30.0).unwrap();
    let backends = [Backend::on_gpu(kernels), Backend::default()];
    let [on_gpu, on_cpu] = backends.map(|b| b.render_vdi(&vdi, &camera, 96, 64, Detail::Cubic).unwrap());
    let pairs = on_gpu.pixels().iter().zip(on_cpu.pixels());
    // On the edge of two lists a place may fall to either, and counts a quarter.
    let apart = pairs.filter(|(a, b)| difference(a, b) > MAX_CHANNEL).count() as f64 / f64::from(96 * 64);
    assert!(apart <= 12.0 * MAX_DISPLACED, "{apart} of the pixels differ");
    let db = lamina_model::psnr(&on_gpu, &on_cpu).unwrap();
    assert!(db > 55.0, "{db} dB");
}

#[test]
fn quality_is_the_processors() {
    let Some(kernels) = open() else { return };
    let vdi = PreparedVdi::new(random_vdi(outside(), 65, 0.5, 0));
    let plan = SamplePlan { image_size: 96, tile: 8, batches: 4, angles_deg: vec![10.0, 60.0] };
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let points = [0.0, 1.0].map(|at| ControlPoint { at, color: [1.0; 3], opacity: 0.1 });
    let transfer = TransferFunction::new(range, None, points.to_vec()).unwrap();
    let scene =
        Scene { transfer, camera: outside(), background: [0.0; 3], step_voxels: 0.5, effects: Effects::default() };
    let colors = vec![vec![[0.3, 0.4, 0.5]; plan.samples_per_view()]; 2];
    let reference = ReferenceSamples { step: 0, batches: 0..plan.batches, plan, scene, colors };
    let (on_gpu, on_cpu) = (Backend::on_gpu(kernels), Backend::open(Choice::Cpu).unwrap());
    let [a, b] = [on_gpu, on_cpu].map(|backend| backend.quality_vdi(&vdi, &reference, 0..4, Detail::Cubic).unwrap());
    assert!((a.psnr_db() - b.psnr_db()).abs() < 1e-3);
    for (a, b) in a.views.iter().zip(&b.views) {
        let [db_a, db_b] = [a, b].map(lamina_model::ViewError::psnr_db);
        assert!((db_a - db_b).abs() < 1e-3, "{} degrees: {db_a} and {db_b} dB", a.angle_deg);
    }
}

/// Not a test: prints what a view costs.
#[test]
#[ignore = "prints times"]
fn times() {
    let Some(kernels) = kernels() else { return };
    for share in [0.3, 1.0] {
        let vdi = PreparedVdi::new(random_vdi(outside(), 256, share, 0));
        let camera = outside().rotated_about_y(30.0).unwrap();
        let time = |draw: &dyn Fn()| {
            let once = || {
                let start = Instant::now();
                draw();
                start.elapsed()
            };
            (0..5).map(|_| once()).min().unwrap()
        };
        let start = Instant::now();
        kernels.pixels(&vdi, &camera, [512, 512], &[(0, 0)], Detail::Nearest).unwrap();
        let upload = start.elapsed();
        let gpu = time(&|| drop(picture(kernels, &vdi, &camera, [512, 512]).unwrap()));
        let cpu = time(&|| drop(vdi.render(&camera, 512, 512).unwrap()));
        let (name, segments) = (&kernels.facts().name, vdi.vdi().segments().len());
        println!("{name}: {segments} supersegments: upload {upload:?}, view {gpu:?}; processor {cpu:?}");
    }
}
