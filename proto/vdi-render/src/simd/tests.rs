//! The fast path against the oracle, on VDIs made of random lists.

use super::super::reconstruction::FLAT;
use super::super::{Backend, reference};
use super::*;
use glam::DVec3;
use lamina_model::{Aabb, Supersegment, VdiHeader, VdiParams, psnr};

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

fn frontal() -> Camera {
    Camera::new(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 40.0).unwrap()
}

/// A little askew: turned by 180 degrees, a frontal camera's diagonal rays run exactly through pixel corners.
fn outside() -> Camera {
    Camera::new(DVec3::new(0.05, 0.03, 4.0), DVec3::new(0.02, -0.04, 0.0), DVec3::new(0.01, 1.0, 0.0), 40.0).unwrap()
}

fn inside() -> Camera {
    Camera::new(DVec3::new(0.31, 0.22, 0.43), DVec3::new(-0.2, -0.1, -1.0), DVec3::Y, 70.0).unwrap()
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
            let (steps, last) = (header.steps(t_out - t_in), (t_out - t_in) / header.step_length);
            let mut depth = dice.below(40);
            while depth < steps {
                let end = (depth + 1 + dice.below(30)).min(steps);
                let solid = opaque > 0 && dice.below(opaque) == 0;
                // A last step that the box cuts short holds no more than its share.
                let share = (f64::from(end).min(last) - f64::from(depth)).max(1e-6) / f64::from(end - depth);
                let optical_depth = (dice.unit().powi(3) * 1.5 + 1e-6) * share;
                let optical_depth = if solid { f32::INFINITY } else { optical_depth as f32 };
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
    let turned = |angle: f64| generation.rotated_about_y(angle).unwrap();
    let at = |p: [f64; 3], t: [f64; 3], fov| Camera::new(p.into(), t.into(), DVec3::new(0.1, 1.0, 0.0), fov).unwrap();
    let mut views: Vec<_> = [0.0, 10.0, 60.0, 90.0, 180.0].map(|a| (turned(a), 64, 64)).into();
    views.push((turned(30.0), 96, 32));
    views.push((turned(30.0), 48, 80));
    views.push((at([0.3, -0.4, 0.2], [-0.5, 0.1, -0.3], 80.0), 64, 64));
    views.push((at([0.0, 0.9, 0.0], [0.1, -1.0, 0.05], 60.0), 64, 64));
    views.push((at([0.2, 0.1, 7.0], [0.0, 0.0, 0.0], 30.0), 64, 64));
    // At the generation camera's own position, looking elsewhere and with another angle.
    let own = generation.position();
    views.push((Camera::new(own, DVec3::new(0.3, 0.2, 0.0), DVec3::new(0.2, 1.0, 0.1), 50.0).unwrap(), 64, 64));
    views.push((Camera::new(own + 1e-13, DVec3::new(0.3, 0.2, 0.0), DVec3::Y, 50.0).unwrap(), 64, 64));
    views
}

fn assert_agrees(vdi: &Arc<Vdi>, (camera, width, height): &(Camera, u32, u32)) -> f32 {
    let (size, prepared) = ([*width, *height], PreparedVdi::new(vdi.clone()));
    let pixels: Vec<_> = (0..*height).flat_map(|j| (0..*width).map(move |i| (i, j))).collect();
    let image = |pixels| Image::new(*width, *height, pixels).unwrap();
    let drawn = |detail| image(prepared.rows(camera, size, 0..*height, detail));
    let nearest = reference::render_pixels(vdi, camera, *width, *height, &pixels);
    let cubic = reference::cubic_pixels(vdi, camera, size, &pixels);
    // A ray that begins in something opaque at the generation camera itself, and leaves its image at once, may see it or not.
    let generation = vdi.header().camera.position();
    let bounds = &vdi.header().bounds;
    let is_inside = generation.cmpge(bounds.min).all() && generation.cmple(bounds.max).all();
    let at_apex = is_inside && camera.position().distance(generation) < 1e-9;
    let mut worst_of_all = 0.0_f32;
    // Where the inner ring's spread is that of `FLAT`, one may count it as none and the other not.
    for (detail, exact, most) in [(Detail::Nearest, nearest, 2e-4), (Detail::Cubic, cubic, 2e-4 + FLAT)] {
        if detail == Detail::Cubic && at_apex {
            continue;
        }
        let (exact, fast) = (image(exact), drawn(detail));
        let differences = exact.pixels().as_flattened().iter().zip(fast.pixels().as_flattened());
        let worst = differences.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let db = psnr(&fast, &exact).unwrap();
        let (r, position) = (vdi.resolution(), camera.position());
        assert!(
            worst < most && db > 95.0,
            "r {r}, from {position}, {width} x {height}, {detail:?}: {worst:e}, {db} dB"
        );
        worst_of_all = worst_of_all.max(worst);
    }
    worst_of_all
}

#[test]
fn blending_changes_nothing_where_rays_are_the_vdis_own() {
    let vdi = random_vdi(outside(), 33, 0.7, 4);
    let prepared = PreparedVdi::new(vdi.clone());
    let draw = |detail| Backend::default().render_vdi(&prepared, &outside(), 33, 33, detail).unwrap();
    let [nearest, blended] = [Detail::Nearest, Detail::Cubic].map(draw);
    let worst = nearest.pixels().as_flattened().iter().zip(blended.pixels().as_flattened());
    let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // The same lists; only how a place in the pixel is rounded differs.
    assert!(worst < 1e-5, "{worst:e}");
}

#[test]
fn pictures_agree_with_the_oracle_from_everywhere() {
    let mut worst = 0.0_f32;
    for (generation, resolution) in [(outside(), 1), (outside(), 2), (outside(), 33), (outside(), 257), (inside(), 33)]
    {
        for (share, opaque) in [(0.2, 0), (1.0, 0), (0.6, 6)] {
            let vdi = random_vdi(generation, resolution, share, opaque);
            for view in views(generation) {
                worst = worst.max(assert_agrees(&vdi, &view));
            }
        }
    }
    println!("largest difference {worst:e}");
}

#[test]
fn all_levels_of_lanes_draw_the_same_to_the_bit() {
    for (generation, resolution) in [(outside(), 1), (outside(), 2), (inside(), 33), (frontal(), 64), (outside(), 257)]
    {
        let vdi = random_vdi(generation, resolution, 0.6, 6);
        for (camera, width, height) in views(generation) {
            let mut rendered = Level::available().into_iter().map(|level| {
                let prepared = PreparedVdi { level, ..PreparedVdi::new(vdi.clone()) };
                [Detail::Nearest, Detail::Cubic].map(|d| prepared.rows(&camera, [width, height], 0..height, d))
            });
            let plain = rendered.next().unwrap();
            assert!(rendered.all(|image| image == plain), "r {resolution}, from {}", camera.position());
        }
    }
}

#[test]
fn a_ray_parallel_to_the_image_plane_agrees_with_the_oracle() {
    let vdi = random_vdi(frontal(), 64, 0.7, 9);
    // Row and column 16 of 33 look along -x exactly: depth does not change.
    for z in [0.3, 0.3 + 1e-13, -0.41] {
        let from = Camera::new(DVec3::new(3.0, 0.21, z), DVec3::new(0.0, 0.21, z), DVec3::Y, 40.0).unwrap();
        assert_agrees(&vdi, &(from, 33, 33));
    }
}

#[test]
fn an_empty_vdi_is_background_and_costs_nothing() {
    let r = 24;
    let vdi = Arc::new(Vdi::new(header(outside(), r), vec![0; (r * r + 1) as usize], Vec::new()).unwrap());
    let prepared = PreparedVdi::new(vdi.clone());
    assert_eq!(prepared.size_bytes(), 0);
    for (camera, width, height) in views(outside()) {
        let image = prepared.render(&camera, width, height).unwrap();
        assert!(image.pixels().iter().all(|&p| p == vdi.header().background));
    }
}

#[test]
fn skipping_tiles_threads_and_single_pixels_change_no_bit() {
    for generation in [outside(), inside()] {
        let vdi = random_vdi(generation, 100, 0.3, 8);
        let prepared = PreparedVdi::new(vdi.clone());
        let patient = PreparedVdi {
            vdi: vdi.clone(),
            grid: AccelerationGrid::new(&vdi).without_gaps(),
            level: Level::detect(),
            id: 0,
        };
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        for (camera, width, height) in views(generation) {
            for detail in [Detail::Nearest, Detail::Cubic] {
                let draw = |vdi: &PreparedVdi| vdi.rows(&camera, [width, height], 0..height, detail);
                let image = draw(&prepared);
                assert_eq!(image, draw(&patient), "gaps, from {}", camera.position());
                assert_eq!(image, one_thread.install(|| draw(&prepared)));
                let pixels: Vec<_> = (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).rev().collect();
                let mut singly = prepared.pixels(&camera, [width, height], &pixels, detail);
                singly.reverse();
                assert_eq!(image, singly);
            }
        }
    }
}

#[test]
fn what_is_prepared_stays_small() {
    for (share, resolution) in [(0.1, 128), (1.0, 128)] {
        let vdi = random_vdi(outside(), resolution, share, 0);
        let decoded = size_of_val(vdi.segments()) + size_of_val(vdi.offsets());
        let beside = PreparedVdi::new(vdi).size_bytes();
        assert!(beside < 3 * decoded, "{beside} bytes beside {decoded}");
    }
}
