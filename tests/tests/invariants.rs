//! What holds of every scene: properties tried on random ones.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{Codec, DecodeLimits, EncodeOptions, Layout, decode, encode, quantize};
use lamina_compute::gpu::testing;
use lamina_model::camera::CameraFields;
use lamina_model::composite::{Accumulator, TRANSMITTANCE_FLOOR};
use lamina_model::effects::{ClipPlane, DepthCue, Effects, Isosurface, Shading};
use lamina_model::{
    Camera, ControlPoint, Grid, Image, Intermediate, ScalarRange, Scale, Scene, Segmentation, Supersegment,
    TransferFunction, Vdi, VdiParams, Volume, Voxels, psnr,
};
use lamina_raycast::gpu::GpuKernels as CastKernels;
use lamina_raycast::simd::{self, Level, Shot};
use lamina_raycast::{Backend, Field, reference};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube};
use lamina_vdi_render::gpu::GpuKernels as DrawKernels;
use lamina_vdi_render::{Detail, PreparedVdi, reference as drawn};
use proptest::prelude::*;
use std::sync::LazyLock;

const SIZE: [u32; 2] = [21, 13];

/// A volume, the scene it is seen under, how it is generated, and another camera.
#[derive(Debug, Clone)]
struct World {
    volume: Volume,
    scene: Scene,
    params: VdiParams,
    novel: Camera,
}

impl World {
    fn field(&self) -> Field {
        Field::new(self.volume.clone(), &self.scene)
    }

    fn shot(&self) -> Shot<'_> {
        Shot { camera: &self.scene.camera, size: SIZE, floor: TRANSMITTANCE_FLOOR as f32 }
    }

    fn vdi(&self) -> Vdi {
        Backend::cpu().generate(&self.field(), &self.params, Segmentation::Greedy).unwrap().0
    }
}

fn vector(range: std::ops::Range<f64>) -> impl Strategy<Value = DVec3> {
    [range.clone(), range.clone(), range].prop_map(DVec3::from)
}

/// Half of them at an end.
fn channel() -> impl Strategy<Value = f64> {
    prop_oneof![2 => 0.0..=1.0_f64, 1 => Just(0.0), 1 => Just(1.0)]
}

/// Ascending corners; positions repeat, and opacities are often 0 or 1.
fn points() -> impl Strategy<Value = Vec<ControlPoint>> {
    let opacity = prop_oneof![Just(0.0), Just(1.0), 0.0..1.0, Just(1e-7)];
    let point = ((0_u32..=8).prop_map(|n| f64::from(n) / 8.0), [channel(), channel(), channel()], opacity)
        .prop_map(|(at, color, opacity)| ControlPoint { at, color, opacity });
    prop::collection::vec(point, 1..6).prop_map(|mut points| {
        points.sort_by(|a, b| a.at.total_cmp(&b.at));
        points
    })
}

/// An eye in or about a box, at one of its points.
fn camera(low: DVec3, size: DVec3) -> impl Strategy<Value = Camera> {
    (vector(-3.0..4.0), vector(0.0..1.0), 5.0..120.0_f64).prop_filter_map("a camera", move |(eye, target, fov)| {
        Camera::new(low + eye * size.max_element(), low + target * size, DVec3::new(0.1, 1.0, 0.2), fov).ok()
    })
}

fn world() -> impl Strategy<Value = World> {
    let grid = (prop::array::uniform3(2_usize..8), vector(0.1..2.0), vector(-5.0..5.0))
        .prop_map(|(dims, spacing, origin)| Grid::new(dims, spacing, origin).unwrap());
    grid.prop_flat_map(|grid| {
        let bounds = grid.bounds();
        let hole = prop_oneof![20 => -0.3..1.3_f32, 1 => Just(f32::NAN)];
        (
            prop::collection::vec(hole, grid.voxels()),
            (points(), prop::option::of(0.05..5.0_f64)),
            [camera(bounds.min, bounds.size()), camera(bounds.min, bounds.size())],
            ([channel(), channel(), channel()].prop_map(|c| c.map(|x| x as f32)), 0.1..3.0_f64),
            (1_u32..20, prop_oneof![Just(0.0), 0.0..0.5_f64]),
        )
            .prop_map(
                move |(voxels, (points, unit_length), [camera, novel], (background, step_voxels), (r, gamma))| {
                    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
                    let transfer = TransferFunction::new(range, unit_length, points).unwrap();
                    let params = VdiParams::new(r, gamma).unwrap().with_step_voxels(step_voxels).unwrap();
                    let volume = Volume::new(grid, Voxels::F32(voxels)).unwrap();
                    World {
                        volume,
                        scene: Scene { transfer, camera, background, step_voxels, effects: Default::default() },
                        params,
                        novel,
                    }
                },
            )
    })
}

/// A world with some effects.
fn lit_world() -> impl Strategy<Value = World> {
    let direction = || vector(-1.0..1.0).prop_filter("a direction", |v| v.length() > 0.1);
    let color = || [channel(), channel(), channel()];
    let surface =
        (-0.2..1.2_f64, color(), channel()).prop_map(|(value, color, opacity)| Isosurface { value, color, opacity });
    let cue = (color(), channel()).prop_map(|(color, strength)| DepthCue { color, strength });
    let light = (direction(), prop::option::of(Just(Shading::default())), prop::option::of(channel()));
    let plane = prop::option::of((direction(), vector(0.0..1.0)));
    let others = (prop::option::of(channel()), any::<bool>(), prop::option::of(cue));
    (world(), light, prop::collection::vec(surface, 0..3), plane, others).prop_map(
        |(mut world, (light, shading, shadows), isosurfaces, plane, (ambient_occlusion, pre_integrated, depth_cue))| {
            let bounds = world.volume.grid().bounds();
            let through = |at: DVec3| bounds.min + at * bounds.size();
            let planes = plane.map(|(normal, at)| ClipPlane { normal, offset: normal.dot(through(at)) });
            world.scene.effects = Effects {
                light: Some(light),
                shading,
                shadows,
                ambient_occlusion,
                isosurfaces,
                clip_planes: planes.into_iter().collect(),
                pre_integrated,
                depth_cue,
                ..Effects::default()
            };
            world
        },
    )
}

fn all_pixels() -> Vec<(u32, u32)> {
    (0..SIZE[1]).flat_map(|j| (0..SIZE[0]).map(move |i| (i, j))).collect()
}

/// `vdi` with all optical depths so divided that those of a step are 0.2 at most and those of a list 2.
fn thinned(vdi: &Vdi) -> Vdi {
    let depth = |s: &Supersegment| f64::from(s.optical_depth).min(1e3);
    let a_step = |s: &Supersegment| depth(s) / f64::from(s.end - s.start) / 0.2;
    let lists = vdi.offsets().windows(2).map(|w| &vdi.segments()[w[0] as usize..w[1] as usize]);
    let a_list = lists.map(|list| list.iter().map(depth).sum::<f64>() / 2.0).fold(1.0, f64::max);
    let most = vdi.segments().iter().map(a_step).fold(a_list, f64::max);
    let thin = |s: &Supersegment| Supersegment { optical_depth: (depth(s) / most) as f32, ..*s };
    Vdi::new(*vdi.header(), vdi.offsets().to_vec(), vdi.segments().iter().map(thin).collect()).unwrap()
}

/// `vdi` with the first supersegment of each list alone.
fn first_alone(vdi: &Vdi) -> Vdi {
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    for list in vdi.offsets().windows(2) {
        segments.extend(vdi.segments()[list[0] as usize..list[1] as usize].first());
        offsets.push(segments.len() as u32);
    }
    Vdi::new(*vdi.header(), offsets, segments).unwrap()
}

/// `vdi` with every supersegment of whole steps cut in two. A ray's last step may be shorter, so what ends there stays.
fn halved(vdi: &Vdi, share: f64) -> Vdi {
    let (header, r) = (vdi.header(), vdi.resolution());
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    for (i, j) in (0..r).flat_map(|j| (0..r).map(move |i| (i, j))) {
        let steps = header.ray_span(i, j).map_or(0.0, |(t_in, t_out)| (t_out - t_in) / header.step_length);
        for s in vdi.list(i, j) {
            let length = s.end - s.start;
            let cut = s.start + ((share * f64::from(length)) as u32).max(1);
            if cut >= s.end || f64::from(s.end) > steps {
                segments.push(*s);
                continue;
            }
            let part = |start: u32, end: u32| {
                let optical_depth = s.optical_depth * ((end - start) as f32 / length as f32);
                Supersegment { start, end, optical_depth, ..*s }
            };
            segments.extend([part(s.start, cut), part(cut, s.end)]);
        }
        offsets.push(segments.len() as u32);
    }
    Vdi::new(*header, offsets, segments).unwrap()
}

/// `world` and its lengths `factor` times as great.
fn scaled(world: &World, factor: f64) -> World {
    let (grid, scene) = (world.volume.grid(), &world.scene);
    let grid = Grid::new(grid.dims(), factor * grid.spacing(), factor * grid.origin()).unwrap();
    let camera = |camera: Camera| {
        let CameraFields { position, target, up, fov_y_deg } = camera.into();
        Camera::new(factor * position, factor * target, up, fov_y_deg).unwrap()
    };
    let (range, points) = (*scene.transfer.range(), scene.transfer.points().to_vec());
    let unit_length = scene.transfer.stated_unit_length().map(|l| factor * l);
    let transfer = TransferFunction::new(range, unit_length, points).unwrap();
    let mut effects = scene.effects.clone();
    effects.clip_planes.iter_mut().for_each(|p| p.offset *= factor);
    let scene = Scene { transfer, camera: camera(scene.camera), effects, ..scene.clone() };
    let volume = Volume::new(grid, world.volume.voxels().clone()).unwrap();
    World { volume, scene, novel: camera(world.novel), params: world.params }
}

fn with_threads<T: Send>(count: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap().install(work)
}

fn root_mean_square(a: &Image, b: &Image) -> f64 {
    10.0_f64.powf(-0.05 * psnr(a, b).unwrap())
}

fn greatest_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn colors_are_numbers_from_0_to_1(world in prop_oneof![world(), lit_world()]) {
        let (field, vdi, [w, h]) = (world.field(), world.vdi(), SIZE);
        let camera = &world.scene.camera;
        for picture in [
            reference::raycast(&field, camera, w, h).unwrap(),
            Backend::cpu().raycast(&field, camera, w, h).unwrap(),
            drawn::render(&vdi, camera, w, h).unwrap(),
            drawn::render(&vdi, &world.novel, w, h).unwrap(),
            PreparedVdi::new(&vdi).render(camera, w, h).unwrap(),
            PreparedVdi::new(&vdi).render(&world.novel, w, h).unwrap(),
        ] {
            let colors = picture.pixels().as_flattened();
            prop_assert!(colors.iter().all(|c| (0.0..=1.0).contains(c)), "{colors:?}");
        }
    }

    #[test]
    fn transmittance_is_the_product_of_a_segments_parts(depth in prop_oneof![0.0..40.0_f64, 0.0..1e-6_f64],
        cut in 0.0..1.0_f64) {
        let light = |depths: &[f64]| {
            let mut light = Accumulator::default();
            depths.iter().for_each(|&d| light.add([0.3, 0.6, 0.9], d));
            light
        };
        let (whole, parts) = (light(&[depth]), light(&[cut * depth, (1.0 - cut) * depth]));
        prop_assert!((whole.transmittance - parts.transmittance).abs() < 1e-12);
        prop_assert!((0..3).all(|c| (whole.color[c] - parts.color[c]).abs() < 1e-12));
    }

    #[test]
    fn a_supersegment_in_two_is_drawn_as_one(world in world(), share in 0.0..1.0_f64) {
        // Where little comes through, rays end: thin enough that none does.
        let (whole, [w, h]) = (thinned(&world.vdi()), SIZE);
        let parts = halved(&whole, share);
        let [a, b] = [&whole, &parts].map(|vdi| drawn::render(vdi, &world.novel, w, h).unwrap());
        prop_assert!(greatest_difference(a.pixels(), b.pixels()) < 1e-6);
        let [a, b] = [&whole, &parts].map(|vdi| PreparedVdi::new(vdi).render(&world.novel, w, h).unwrap());
        prop_assert!(greatest_difference(a.pixels(), b.pixels()) < 3e-6, "single precision, many supersegments a ray");
        // One supersegment a ray, whose every ray is a list's own.
        let (whole, r) = (first_alone(&whole), whole.resolution());
        let parts = halved(&whole, share);
        let [a, b] = [&whole, &parts].map(|vdi| PreparedVdi::new(vdi).render(&world.scene.camera, r, r).unwrap());
        prop_assert!(greatest_difference(a.pixels(), b.pixels()) < 1e-6, "single precision, one");
    }

    #[test]
    fn neither_order_nor_neighbors_nor_threads_nor_level_change_a_bit(world in prop_oneof![world(),
        lit_world()], chunk in 1_usize..40, turn in 1_usize..273) {
        let (field, pixels, [w, h]) = (world.field(), all_pixels(), SIZE);
        // A prime beside 273 = 21 x 13 and any start visit every pixel once.
        let order: Vec<usize> = (0..pixels.len()).map(|n| (turn + 101 * n) % pixels.len()).collect();
        let vdi = with_threads(1, || simd::generate(Level::Portable, &field, &world.params,
            Segmentation::Greedy).unwrap());
        let cast = with_threads(1, || simd::raycast(Level::Portable, &field, &world.shot()));
        let novel = with_threads(1, || PreparedVdi::new(&vdi).at_level(Level::Portable).render(&world.novel, w,
            h).unwrap());
        for level in Level::available() {
            let prepared = PreparedVdi::new(&vdi).at_level(level);
            let other = with_threads(3, || simd::generate(level, &field, &world.params, Segmentation::Greedy).unwrap());
            prop_assert!(other == vdi, "{:?}", level);
            prop_assert!(with_threads(3, || simd::raycast(level, &field, &world.shot())) == cast, "{:?}", level);
            prop_assert!(with_threads(3, || prepared.render(&world.novel, w, h).unwrap()) == novel, "{:?}", level);
            for some in order.chunks(chunk) {
                let listed: Vec<_> = some.iter().map(|&n| pixels[n]).collect();
                let these = simd::raycast_pixels(level, &field, &world.shot(), &listed);
                prop_assert!(these.into_iter().eq(some.iter().map(|&n| cast[n])), "{:?}", level);
                let these = prepared.pixels(&world.novel, [w, h], &listed, Detail::Nearest);
                prop_assert!(these.into_iter().eq(some.iter().map(|&n| novel.pixels()[n])), "{:?}", level);
            }
        }
    }

    #[test]
    fn what_was_decoded_is_encoded_as_it_was(world in world()) {
        let vdi = world.vdi();
        for (codec, layout) in [
            (Codec::Bzip2, Layout::Columns), (Codec::Zstd, Layout::Columns), (Codec::ContextMixing, Layout::Columns),
            (Codec::Bzip2, Layout::Plain), (Codec::Zstd, Layout::Plain),
        ] {
            let options = EncodeOptions { codec, layout, ..EncodeOptions::BZIP2 };
            let bytes = encode(&vdi, &options).unwrap();
            let back = decode(&bytes, &DecodeLimits::default()).unwrap();
            prop_assert_eq!(back.offsets(), vdi.offsets());
            let ends = |vdi: &Vdi| vdi.segments().iter().map(|s| (s.start, s.end)).collect::<Vec<_>>();
            prop_assert_eq!(ends(&back), ends(&vdi));
            if layout == Layout::Columns {
                prop_assert!(back == quantize(&vdi));
            }
            prop_assert!(encode(&back, &options).unwrap() == bytes);
        }
    }

    #[test]
    fn a_greater_world_with_a_greater_unit_length_looks_the_same(world in prop_oneof![world(), lit_world()],
        power in -30..30_i32) {
        // Powers of two: no rounding differs, so nothing may.
        let (other, [w, h]) = (scaled(&world, 2.0_f64.powi(power)), SIZE);
        let lists = |world: &World| (world.vdi().offsets().to_vec(), world.vdi().segments().to_vec());
        prop_assert!(lists(&world) == lists(&other));
        let slow = |world: &World| reference::generate(&world.field(), &world.params,
            Segmentation::Greedy).unwrap().segments().to_vec();
        prop_assert!(slow(&world) == slow(&other));
        let cast = |world: &World| Backend::cpu().raycast(&world.field(), &world.scene.camera, w, h).unwrap();
        prop_assert!(cast(&world) == cast(&other));
        let novel = |world: &World| PreparedVdi::new(&world.vdi()).render(&world.novel, w, h).unwrap();
        prop_assert!(novel(&world) == novel(&other));
    }
}

// Fewer: a driver in software compiles some pipelines of a world for a second each.
proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn on_a_gpu_colors_are_numbers_from_0_to_1_and_order_changes_no_bit(world in world()) {
        static KERNELS: LazyLock<Option<(CastKernels, DrawKernels)>> = LazyLock::new(|| {
            let cast = CastKernels::new(testing::gpu()?).unwrap();
            Some((cast, DrawKernels::new(testing::gpu()?).unwrap()))
        });
        let (Some((cast, draw)), [w, h]) = (&*KERNELS, SIZE) else { return Ok(()) };
        let (field, vdi, mut pixels) = (world.field(), world.vdi(), all_pixels());
        pixels.reverse();
        let (prepared, from, novel) = (PreparedVdi::new(&vdi), &world.scene.camera, &world.novel);
        let seen = (cast.raycast(&field, from, w, h), cast.raycast_pixels(&field, from, w, h, &pixels));
        let drawn = draw.picture(&prepared, novel, [w, h], Detail::Cubic).unwrap();
        let drawn = (Image::new(w, h, drawn), draw.pixels(&prepared, novel, [w, h], &pixels, Detail::Cubic));
        for (picture, listed) in [(seen.0.unwrap(), seen.1.unwrap()), (drawn.0.unwrap(), drawn.1.unwrap())] {
            let colors = picture.pixels().as_flattened();
            prop_assert!(colors.iter().all(|c| (0.0..=1.0).contains(c)), "{colors:?}");
            prop_assert!(picture.pixels().iter().rev().eq(&listed));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_vdi_comes_to_the_ray_cast_image_with_small_gamma_and_great_r(
        eye in vector(-1.0..1.0).prop_filter("some way", |eye| eye.length() > 0.2),
        angle_deg in prop_oneof![-60.0..-5.0_f64, 5.0..60.0_f64],
    ) {
        const SIDE: u32 = 40;
        let camera = Camera::new(4.0 * eye.normalize(), DVec3::ZERO, DVec3::new(0.1, 1.0, 0.2), 40.0).unwrap();
        let scene = Scene { camera, ..front_scene(clumps_transfer()) };
        let field = Field::new(sampled_cube(24, clumps), &scene);
        let vdi = |r, gamma| Backend::cpu().generate(&field, &VdiParams::new(r, gamma).unwrap(),
            Segmentation::Greedy).unwrap().0;
        let drawn = |r, gamma, camera: &Camera| PreparedVdi::new(&vdi(r, gamma)).render(camera, SIDE, SIDE).unwrap();
        let cast = Backend::cpu().raycast(&field, &camera, SIDE, SIDE).unwrap();

        let by_r = [SIDE / 8, SIDE / 4, SIDE / 2, SIDE].map(|r| root_mean_square(&drawn(r, 0.0, &camera), &cast));
        prop_assert!(by_r.is_sorted_by(|a, b| a > b) && by_r[3] < 1e-5, "{by_r:?}");
        let own = [0.1, 0.01, 0.001, 0.0].map(|gamma| root_mean_square(&drawn(SIDE, gamma, &camera), &cast));
        prop_assert!(own.iter().all(|e| *e < 1e-5), "merging keeps the light of a whole ray: {own:?}");
        let fitted = |gammas: &[f64]| {
            let params = VdiParams::new(SIDE, 0.0).unwrap();
            Backend::cpu().represent_all(&field, &params.into(), gammas, Segmentation::Fitted).unwrap()
        };
        for (gamma, all) in [0.1, 0.01, 0.001, 0.0].into_iter().zip(fitted(&[0.1, 0.01, 0.001, 0.0])) {
            let params = VdiParams::new(SIDE, gamma).unwrap();
            let (one, _) = Backend::cpu().represent(&field, &params.into(), Segmentation::Fitted).unwrap();
            prop_assert!(one == all, "one march for all gammas, gamma {gamma}");
            let Intermediate::Vdi(vdi) = one else { unreachable!() };
            let image = PreparedVdi::new(&*vdi).render(&camera, SIDE, SIDE).unwrap();
            prop_assert!(root_mean_square(&image, &cast) < 1e-5, "fitting keeps the light of a whole ray too");
        }

        let novel = camera.rotated_about_y(angle_deg).unwrap();
        let limit = drawn(4 * SIDE, 0.0, &novel);
        let by_gamma = [0.1, 0.01, 0.001, 0.0001].map(|gamma| root_mean_square(&drawn(4 * SIDE, gamma, &novel),
            &limit));
        prop_assert!(by_gamma.is_sorted_by(|a, b| a >= b) && by_gamma[3] < 1e-4, "{by_gamma:?}");
        let truth = Backend::cpu().raycast(&field, &novel, SIDE, SIDE).unwrap();
        let by_r = [SIDE, 4 * SIDE].map(|r| root_mean_square(&drawn(r, 0.0, &novel), &truth));
        // Seen from nearly the same side few rays are good enough already.
        prop_assert!(by_r[1] < (0.6 * by_r[0]).max(0.006) && by_r[1] < 0.01, "{by_r:?}");
    }
}
