//! Effects: every level near the oracle for each alone and for pairs; the oracle itself against closed forms.

use crate::agreement::{compare, compare_pictures};
use crate::fields::{DIMS, field, values};
use glam::DVec3;
use lamina_compute::gpu::testing;
use lamina_model::effects::{ClipBox, ClipPlane, ColorField, ColorPoint, DepthCue, Effects, Isosurface, Shading};
use lamina_model::{Camera, ControlPoint, Grid, ScalarRange, Scale, Scene, Segmentation, VdiParams};
use lamina_model::{TransferFunction, Volume, Voxels};
use lamina_raycast::gpu::GpuKernels;
use lamina_raycast::{Backend, Field, reference, simd::Level};

/// Each effect alone.
fn effects() -> Vec<(&'static str, Effects)> {
    let light = Some(DVec3::new(0.3, 1.0, 0.7));
    let none = Effects::default;
    let surface = |value, color, opacity| Isosurface { value, color, opacity };
    let surfaces = vec![surface(0.62, [0.2, 0.9, 0.9], 0.7), surface(0.35, [0.9, 0.3, 0.2], 0.3)];
    // In the middle of the test field's box.
    let plane = ClipPlane { normal: DVec3::new(1.0, 0.4, -0.3), offset: 5.0 + 44.0 - 5.0 };
    let clip_box = ClipBox { min: DVec3::new(-1.0, 103.0, 8.0), max: DVec3::new(11.5, 116.0, 21.0) };
    let corner = |at, color| ColorPoint { at, color };
    let map = vec![
        corner(0.1, [0.9, 0.1, 0.2]),
        corner(0.4, [0.1, 0.8, 0.9]),
        corner(0.41, [0.7, 0.2, 0.9]),
        corner(0.9, [1.0; 3]),
    ];
    let range = ScalarRange::new(1.0, 1000.0, Scale::Log10).unwrap();
    let second = ColorField { name: "second".into(), range, points: map };
    vec![
        ("colors", Effects { color_field: Some(second), ..none() }),
        ("shading", Effects { light, shading: Some(Shading::default()), ..none() }),
        ("shadows", Effects { light, shadows: Some(0.8), ..none() }),
        ("occlusion", Effects { ambient_occlusion: Some(0.9), ..none() }),
        ("surfaces", Effects { isosurfaces: surfaces, ..none() }),
        ("plane", Effects { clip_planes: vec![plane], ..none() }),
        ("box", Effects { clip_box: Some(clip_box), ..none() }),
        ("pre-integrated", Effects { pre_integrated: true, ..none() }),
        ("cue", Effects { depth_cue: Some(DepthCue { color: [0.5, 0.6, 0.7], strength: 0.8 }), ..none() }),
    ]
}

/// Alone, and with each other.
fn sets() -> Vec<(String, Effects)> {
    let alone = effects();
    let mut sets: Vec<_> = alone.iter().map(|(name, e)| ((*name).to_owned(), e.clone())).collect();
    for (n, (a, x)) in alone.iter().enumerate() {
        sets.extend(alone[n + 1..].iter().map(|(b, y)| (format!("{a} and {b}"), x.and(y))));
    }
    sets
}

/// The test field with effects: bytes, and f32 with holes; a second field over three decades, whole and with other holes.
fn fields(effects: &Effects) -> Vec<Field> {
    let v = values(DIMS);
    let u8s = Voxels::U8(v.iter().map(|x| (255.0 * x).round() as u8).collect());
    let holes = |(n, x): (usize, &f64)| if n % 997 == 5 { f32::NAN } else { *x as f32 };
    let f32s = Voxels::F32(v.iter().enumerate().map(holes).collect());
    let decades =
        |n: usize| 1000.0_f64.powf(((n % DIMS[0]) as f64 / 16.0 + (n / DIMS[0] % DIMS[1]) as f64 / 32.0) / 2.0);
    let whole = Voxels::U16((0..v.len()).map(|n| decades(n).round() as u16).collect());
    let torn = (0..v.len()).map(|n| if n % 1009 == 7 { f64::INFINITY } else { decades(n) });
    let torn = Voxels::F64(torn.collect());
    let with = |voxels: Voxels, hi: f64, second: Voxels| {
        let plain = field(DIMS, voxels.clone(), hi, Scale::Linear, 1.3);
        let mut effects = effects.clone();
        effects.isosurfaces.iter_mut().for_each(|s| s.value *= hi);
        let scene = Scene { effects, ..plain.scene().clone() }.check().unwrap();
        let volume = Volume::new(*plain.grid(), voxels).unwrap().with_color_field("second", second).unwrap();
        Field::new(volume, &scene)
    };
    vec![with(u8s, 255.0, whole), with(f32s, 1.0, torn)]
}

fn params() -> VdiParams {
    VdiParams::new(45, 0.02).unwrap().with_step_voxels(0.43).unwrap()
}

#[test]
fn lanes_equal_the_oracle() {
    for (name, effects) in sets() {
        for field in fields(&effects) {
            let camera = &field.scene().camera;
            let oracle = reference::raycast(&field, camera, 61, 47).unwrap();
            let list = reference::generate(&field, &params(), Segmentation::Greedy).unwrap();
            let mut first = None;
            for level in Level::available() {
                let backend = Backend::Cpu(level);
                let ours = backend.raycast(&field, camera, 61, 47).unwrap();
                compare_pictures(&format!("{name}, {level:?}"), &ours, &oracle);
                let vdi = backend.generate(&field, &params(), Segmentation::Greedy).unwrap().0;
                compare(&name, &vdi, &list);
                let all = backend.generate_all(&field, &params(), &[0.02], Segmentation::Greedy).unwrap();
                assert_eq!(all, std::slice::from_ref(&vdi));
                assert_eq!(first.get_or_insert((ours.clone(), vdi.clone())), &(ours, vdi), "levels, {name}");
            }
        }
    }
}

#[test]
fn the_gpu_equals_the_oracle() {
    let Some(gpu) = testing::gpu().map(|gpu| GpuKernels::new(gpu).unwrap()) else { return };
    // Each set is a kernel of its own, and compiling one takes a software device long: alone, and all together.
    let all = effects().iter().fold(Effects::default(), |sum, (_, e)| sum.and(e));
    for (name, effects) in effects().into_iter().chain([("all", all)]) {
        for field in fields(&effects) {
            let camera = &field.scene().camera;
            let ours = gpu.raycast(&field, camera, 61, 47).unwrap();
            compare_pictures(name, &ours, &reference::raycast(&field, camera, 61, 47).unwrap());
            let vdi = gpu.generate(&field, &params(), Segmentation::Greedy).unwrap().0;
            compare(name, &vdi, &reference::generate(&field, &params(), Segmentation::Greedy).unwrap());
        }
    }
}

/// A ramp along x from 0 to 1 over 16 units, white, of constant opacity 0.05 a unit, seen along -z through 8 units.
fn ramp(step_voxels: f64, opacity: [f64; 2], effects: Effects) -> Field {
    let grid = Grid::new([17, 9, 9], DVec3::ONE, DVec3::ZERO).unwrap();
    let voxels = Voxels::F32((0..17 * 81).map(|n| (n % 17) as f32 / 16.0).collect());
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [0.8; 3], opacity };
    let transfer =
        TransferFunction::new(range, Some(1.0), vec![point(0.0, opacity[0]), point(1.0, opacity[1])]).unwrap();
    let camera = Camera::new(DVec3::new(8.0, 4.0, 1e5), DVec3::new(8.0, 4.0, 4.0), DVec3::Y, 0.001).unwrap();
    let scene = Scene { transfer, camera, background: [0.0; 3], step_voxels, effects }.check().unwrap();
    Field::new(Volume::new(grid, voxels).unwrap(), &scene)
}

fn center(field: &Field) -> [f32; 3] {
    let levels = Level::available().into_iter().map(Backend::Cpu);
    let fast = levels.map(|b| b.raycast_pixels(field, &field.scene().camera, 3, 3, &[(1, 1)]).unwrap()[0]);
    let oracle = reference::raycast_pixels(field, &field.scene().camera, 3, 3, &[(1, 1)])[0];
    for color in fast {
        assert!((color[0] - oracle[0]).abs() < 2e-5, "{color:?} {oracle:?}");
    }
    oracle
}

fn near(ours: f32, exact: f64, tolerance: f64) {
    assert!((f64::from(ours) - exact).abs() < tolerance, "{ours} {exact}");
}

#[test]
fn clipping_cuts_steps_where_it_says() {
    // Between z = 1.3 and 6.05, which no step of 0.7 meets.
    let planes = [(DVec3::Z, 6.05), (-2.0 * DVec3::Z, -2.6)];
    let clip_planes = planes.map(|(normal, offset)| ClipPlane { normal, offset }).to_vec();
    let field = ramp(0.7, [0.05; 2], Effects { clip_planes, ..Effects::default() });
    near(center(&field)[0], 0.8 * (1.0 - 0.95_f64.powf(6.05 - 1.3)), 1e-6);
    let clip_box = Some(ClipBox { min: DVec3::new(0.0, 0.0, 2.0), max: DVec3::new(16.0, 8.0, 3.5) });
    near(
        center(&ramp(0.7, [0.05; 2], Effects { clip_box, ..Effects::default() }))[0],
        0.8 * (1.0 - 0.95_f64.powf(1.5)),
        1e-6,
    );
    let clip_box = Some(ClipBox { min: DVec3::splat(20.0), max: DVec3::splat(21.0) });
    assert_eq!(center(&ramp(0.7, [0.05; 2], Effects { clip_box, ..Effects::default() })), [0.0; 3]);
}

#[test]
fn light_on_a_ramp_is_blinn_and_phongs() {
    // The gradient is a sixteenth of the range a voxel along x; light falls from 60 degrees off it, the eye is on +z.
    let light = DVec3::new(0.5, 0.0, 0.75_f64.sqrt());
    let shading = Shading { ambient: 0.3, diffuse: 0.5, specular: 0.4, shininess: 4 };
    let effects = Effects { light: Some(light), shading: Some(shading), ..Effects::default() };
    let share = (1.0 / 16.0) / (1.0 / 16.0 + 0.01);
    let half = (light + DVec3::Z).normalize();
    let lit = 0.8 * ((1.0 - share) + share * (0.3 + 0.5 * 0.5)) + share * 0.4 * half.x.abs().powi(4);
    near(center(&ramp(0.5, [0.05; 2], effects))[0], lit * (1.0 - 0.95_f64.powf(8.0)), 1e-5);
}

#[test]
fn a_surface_hides_what_lies_behind_it() {
    // The eye on +x: the ramp falls along the ray, and crosses 0.3 after 11.2 units.
    let isosurfaces = vec![Isosurface { value: 0.3, color: [0.1, 0.6, 0.9], opacity: 1.0 }];
    let field = ramp(0.5, [0.05; 2], Effects { isosurfaces, ..Effects::default() });
    let camera = Camera::new(DVec3::new(1e5, 4.0, 4.0), DVec3::splat(4.0), DVec3::Y, 0.001).unwrap();
    let color = reference::raycast_pixels(&field, &camera, 3, 3, &[(1, 1)])[0];
    let through = 0.95_f64.powf(16.0 * 0.7);
    near(color[2], 0.8 * (1.0 - through) + 0.9 * through, 1e-5);
    // A step of 0.7 has no end there either.
    let isosurfaces = vec![Isosurface { value: 0.3, color: [0.1, 0.6, 0.9], opacity: 0.5 }];
    let field = ramp(0.7, [0.05; 2], Effects { isosurfaces, ..Effects::default() });
    let color = reference::raycast_pixels(&field, &camera, 3, 3, &[(1, 1)])[0];
    let rest = 0.8 * (1.0 - 0.95_f64.powf(16.0 * 0.3));
    near(color[2], 0.8 * (1.0 - through) + through * (0.5 * 0.9 + 0.5 * rest), 1e-5);
}

#[test]
fn integrated_a_single_step_sees_what_many_do() {
    // The eye on +x, steps of half the box: extinction is -ln(1 - opacity), opacity a line from 0 to 0.4.
    let camera = Camera::new(DVec3::new(1e5, 4.0, 4.0), DVec3::splat(4.0), DVec3::Y, 0.001).unwrap();
    let look = |step, pre_integrated| {
        let field = ramp(step, [0.0, 0.4], Effects { pre_integrated, ..Effects::default() });
        f64::from(reference::raycast_pixels(&field, &camera, 3, 3, &[(1, 1)])[0][0])
    };
    // The integral of -ln(1 - a) over a from 0 to 0.4 is 0.4 + 0.6 ln 0.6.
    let depth = 16.0 / 0.4 * (0.4 + 0.6 * 0.6_f64.ln());
    let exact = 0.8 * (1.0 - (-depth).exp());
    assert!((look(8.0, true) - exact).abs() < 1e-5, "{} {exact}", look(8.0, true));
    assert!((look(8.0, false) - exact).abs() > 5e-4, "{} {exact}", look(8.0, false));
}

#[test]
fn shadows_and_cues_have_closed_forms() {
    // Light from behind the eye: at depth d the medium lets 0.95^d through. The picture is the integral of that.
    let effects = Effects { light: Some(DVec3::Z), shadows: Some(1.0), ..Effects::default() };
    let exact = 0.8 * 0.5 * (1.0 - 0.95_f64.powf(16.0));
    near(center(&ramp(0.25, [0.05; 2], effects))[0], exact, 1e-3);
    // Half way over at the far corner; all depths of the box are nearly alike from afar, so the mean is a linear fade's.
    let cue = DepthCue { color: [0.0; 3], strength: 0.5 };
    let k = -(0.95_f64.ln());
    let faded = |z: f64| 0.8 * (1.0 - 0.5 * z / 8.0);
    // The integral of faded(z) k exp(-k z) over 0..8, in closed form.
    let e = (-k * 8.0_f64).exp();
    let exact = 0.8 * (1.0 - e) - 0.05 * ((1.0 - e) / k - 8.0 * e);
    assert!((faded(8.0) - 0.4).abs() < 1e-12);
    near(center(&ramp(0.25, [0.05; 2], Effects { depth_cue: Some(cue), ..Effects::default() }))[0], exact, 1e-3);
}

#[test]
fn a_second_field_gives_the_color_of_every_depth() {
    // The second field is z, black at 0 and red at 8; the eye on +z. The picture is the integral of that over 0.95^depth.
    let range = ScalarRange::new(0.0, 8.0, Scale::Linear).unwrap();
    let points = vec![ColorPoint { at: 0.0, color: [0.0; 3] }, ColorPoint { at: 1.0, color: [1.0, 0.0, 0.0] }];
    let color_field = Some(ColorField { name: "z".into(), range, points });
    let look = |name: &str, second: Voxels, backend: Option<Backend>| {
        let plain = ramp(0.25, [0.05; 2], Effects { color_field: color_field.clone(), ..Effects::default() });
        let voxels = Voxels::F32(vec![0.5; 17 * 81]);
        let volume = Volume::new(*plain.grid(), voxels).unwrap().with_color_field(name, second).unwrap();
        let (field, camera) = (Field::new(volume, plain.scene()), plain.scene().camera);
        let pixels = [(1, 1)];
        backend.map_or_else(
            || reference::raycast_pixels(&field, &camera, 3, 3, &pixels)[0],
            |b| b.raycast_pixels(&field, &camera, 3, 3, &pixels).unwrap()[0],
        )
    };
    let heights = Voxels::U8((0..17 * 81).map(|n| (n / 17 / 9) as u8).collect());
    let k = -(0.95_f64.ln());
    let e = (-k * 8.0_f64).exp();
    let exact = (1.0 - e) - ((1.0 - e) / k - 8.0 * e) / 8.0;
    for backend in Level::available().into_iter().map(|l| Some(Backend::Cpu(l))).chain([None]) {
        let [red, green, blue] = look("z", heights.clone(), backend.clone());
        near(red, exact, 2e-5);
        assert_eq!([green, blue], [0.0; 2]);
        // Not finite, or another field: the transfer function's own.
        let own = 0.8 * (1.0 - e);
        near(look("z", Voxels::F32(vec![f32::NAN; 17 * 81]), backend.clone())[1], own, 1e-5);
        near(look("time", heights.clone(), backend)[1], own, 1e-5);
    }
}

#[test]
fn opaque_media_and_faint_surfaces_stay_finite() {
    // A block of ones in zeros, opaque from 0.5 on: steps end on the plateau that a surface of value 1 begins at.
    let grid = Grid::new([9; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let inside = |n: usize| [n % 9, n / 9 % 9, n / 81].iter().all(|c| (2..7).contains(c));
    let voxels = || Voxels::F32((0..729).map(|n| f32::from(u8::from(inside(n)))).collect());
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [0.8; 3], opacity };
    let points = vec![point(0.0, 0.0), point(0.5, 0.0), point(0.5, 1.0), point(1.0, 1.0)];
    let transfer = TransferFunction::new(range, Some(1.0), points).unwrap();
    let camera = Camera::new(DVec3::new(4.1, 3.9, 30.0), DVec3::new(4.1, 3.9, 4.0), DVec3::Y, 20.0).unwrap();
    for (value, opacity, again) in
        [(1.0, 1.0, 1.0), (1.0, 0.3, 1.0), (0.3, 0.0, 0.6), (0.3, 1e-9, 0.6), (0.3, 1e-17, 0.3)]
    {
        let surface = |value| Isosurface { value, color: [0.2, 0.9, 0.4], opacity };
        let effects = Effects { isosurfaces: vec![surface(value), surface(again)], ..Effects::default() };
        let scene = Scene { transfer: transfer.clone(), camera, background: [0.0; 3], step_voxels: 0.5, effects };
        let field = Field::new(Volume::new(grid, voxels()).unwrap(), &scene.check().unwrap());
        let oracle = reference::raycast(&field, &camera, 24, 24).unwrap();
        let pictures =
            Level::available().into_iter().map(|l| Backend::Cpu(l).raycast(&field, &camera, 24, 24).unwrap());
        for picture in pictures.chain([oracle]) {
            let good = picture.pixels().as_flattened().iter().all(|c| (0.0..=1.0).contains(c));
            assert!(good, "surfaces {value}, {again} of opacity {opacity}");
        }
        let vdi = reference::generate(&field, &params(), Segmentation::Greedy).unwrap();
        assert!(vdi.segments().iter().all(|s| s.color.iter().all(|c| c.is_finite()) && !s.optical_depth.is_nan()));
    }
}

/// A field rising along x through a needle of opacity, in steps longer than the needle: whatever is opaque where the field
/// has no value, the needle's optical depth is 2 / 0.3 of the integral of -ln(1 - a) up to 0.3.
#[test]
fn what_is_opaque_elsewhere_in_the_range_hides_nothing_from_pre_integration() {
    let grid = Grid::new([17, 9, 9], DVec3::ONE, DVec3::ZERO).unwrap();
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [0.8; 3], opacity };
    let needle = [point(0.55, 0.0), point(0.6, 0.3), point(0.65, 0.0)];
    let below = [point(0.0, 1.0), point(0.1, 1.0), point(0.1, 0.0)];
    let above = [point(0.97, 0.0), point(0.97, 1.0)];
    let camera = Camera::new(DVec3::new(1e5, 4.0, 4.0), DVec3::new(8.0, 4.0, 4.0), DVec3::Y, 0.001).unwrap();
    let gpu = testing::gpu().map(|gpu| GpuKernels::new(gpu).unwrap());
    let depth = 2.0 / 0.3 * (0.7 * 0.7_f64.ln() + 0.3);
    let expected = 0.8 * -(-depth).exp_m1();
    for points in [[&needle[..], &[]].concat(), [&below[..], &needle].concat(), [&below[..], &needle, &above].concat()]
    {
        let voxels = Voxels::F32((0..17 * 81).map(|n| 0.15 + 0.05 * (n % 17) as f32).collect());
        let transfer = TransferFunction::new(range, Some(1.0), points).unwrap();
        let effects = Effects { pre_integrated: true, ..Effects::default() };
        let scene = Scene { transfer, camera, background: [0.0; 3], step_voxels: 4.0, effects }.check().unwrap();
        let field = Field::new(Volume::new(grid, voxels).unwrap(), &scene);
        let on_gpu = gpu.as_ref().map(|gpu| gpu.raycast_pixels(&field, &camera, 3, 3, &[(1, 1)]).unwrap()[0]);
        for found in [Some(center(&field)), on_gpu].into_iter().flatten() {
            assert!((f64::from(found[0]) - expected).abs() < 2e-4, "{found:?}, {expected}");
        }
    }
}

/// One layer of sample points is a slab one spacing thick, lit alike from both sides: the integral of kappa exp(-kappa s)
/// times the light, which falls from 1 to exp(-kappa), linearly on its coarse grid.
#[test]
fn a_single_layer_is_shadowed_alike_from_both_sides() {
    let grid = Grid::new([17, 17, 1], DVec3::ONE, DVec3::ZERO).unwrap();
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let points = vec![ControlPoint { at: 0.0, color: [1.0; 3], opacity: 0.9 }];
    let transfer = TransferFunction::new(range, Some(1.0), points).unwrap();
    let kappa = 10.0_f64.ln();
    let lit = |s: f64| kappa * (-kappa * s).exp() * (1.0 - 0.9 * s);
    let expected = (0..1000).map(|n| lit((f64::from(n) + 0.5) / 1000.0)).sum::<f64>() / 1000.0;
    let gpu = testing::gpu().map(|gpu| GpuKernels::new(gpu).unwrap());
    for side in [1.0, -1.0] {
        let camera = Camera::new(DVec3::new(8.0, 8.0, side * 1e5), DVec3::new(8.0, 8.0, 0.0), DVec3::Y, 1e-4).unwrap();
        let effects = Effects { light: Some(DVec3::Z * side), shadows: Some(1.0), ..Effects::default() };
        let background = [0.0; 3];
        let scene = Scene { transfer: transfer.clone(), camera, background, step_voxels: 1.0 / 32.0, effects };
        let volume = Volume::new(grid, Voxels::F32(vec![0.5; 289])).unwrap();
        let field = Field::new(volume, &scene.check().unwrap());
        let on_gpu = gpu.as_ref().map(|gpu| gpu.raycast_pixels(&field, &camera, 3, 3, &[(1, 1)]).unwrap()[0]);
        for found in [Some(center(&field)), on_gpu].into_iter().flatten() {
            assert!((f64::from(found[0]) - expected).abs() < 1e-3, "{side}: {found:?}, {expected}");
        }
    }
}
