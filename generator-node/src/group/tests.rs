//! Groups of threads: what they make together is what one node makes.

use super::*;
use crate::ingest::{GridBox, RunSpec};
use crate::triggers::Statistics;
use glam::DVec3;
use lamina_codec::{DecodeLimits, EncodeOptions, band_sizes, decode, encode};
use lamina_model::{
    Coordinates, Effects, Grid, SamplePlan, Scene, Segmentation, SquaredError, VdiParams, Volume, VolumeParams,
    VoxelType, Voxels, psnr, suggest::suggest,
};
use lamina_raycast::{Backend, Field, reduce};
use std::sync::Arc;

const DIMS: [usize; 3] = [21, 18, 15];

fn grid() -> Grid {
    Grid::new(DIMS, DVec3::new(1.0, 0.8, 1.2), DVec3::new(-3.0, 2.0, 0.5)).unwrap()
}

fn value(x: usize, y: usize, z: usize) -> f32 {
    let p = DVec3::new(x as f64 / 20.0, y as f64 / 17.0, z as f64 / 14.0);
    if (x, y, z) == (4, 9, 9) {
        return f32::NAN;
    }
    let blob = |c: DVec3, w: f64| (-(p - c).length_squared() / (w * w)).exp();
    (blob(DVec3::splat(0.4), 0.25) + 0.7 * blob(DVec3::new(0.7, 0.6, 0.8), 0.2)) as f32
}

fn bytes_of(b: &GridBox) -> Vec<u8> {
    let ([x0, y0, z0], [nx, ny, nz]) = (b.start(), b.dims());
    let rows = (z0..z0 + nz).flat_map(|z| (y0..y0 + ny).map(move |y| (y, z)));
    rows.flat_map(|(y, z)| (x0..x0 + nx).flat_map(move |x| value(x, y, z).to_le_bytes())).collect()
}

fn spec() -> RunSpec {
    RunSpec::of_one_rank("f", grid())
}

fn at(start: [usize; 3], dims: [usize; 3]) -> GridBox {
    GridBox::new(start.map(|n| n as u64), dims.map(|n| n as u64), &grid()).unwrap()
}

/// Members' boxes: one, two uneven slabs, and three of which the first has an L and the last nothing but the last plane.
fn layouts() -> Vec<Vec<Vec<GridBox>>> {
    vec![
        vec![vec![at([0; 3], DIMS)]],
        vec![vec![at([0; 3], [21, 18, 4])], vec![at([0, 0, 4], [21, 18, 11])]],
        vec![
            vec![at([0; 3], [21, 7, 14]), at([0, 7, 0], [9, 11, 14])],
            vec![at([9, 7, 0], [12, 11, 14])],
            vec![at([0, 0, 14], [21, 18, 1])],
        ],
        vec![vec![], vec![at([0; 3], DIMS)], vec![], vec![]],
    ]
}

/// A group whose members hold `steps` steps, all alike.
fn group(layout: &[Vec<GridBox>], steps: u64) -> Arc<Root> {
    group_of(layout, |_| steps)
}

/// The same of members that hold `steps(member)` steps.
fn group_of(layout: &[Vec<GridBox>], steps: impl Fn(u32) -> u64) -> Arc<Root> {
    group_with(layout, &spec(), bytes_of, steps)
}

/// The same of a run of its own, whose bricks have the bytes that `bytes` gives.
fn group_with(
    layout: &[Vec<GridBox>],
    spec: &RunSpec,
    bytes: impl Fn(&GridBox) -> Vec<u8>,
    steps: impl Fn(u32) -> u64,
) -> Arc<Root> {
    let mut root = None;
    for ((outbox, inbox), boxes) in lamina_mpi::in_process(layout.len() as u32).into_iter().zip(layout) {
        let channels = receive(inbox);
        let held = HeldSteps::default();
        // A member without ranks never holds a step.
        let steps = if boxes.is_empty() { 0 } else { steps(outbox.rank()) };
        for step in 0..steps {
            let bricks = boxes.iter().map(|b| (*b, bytes(b).into())).collect();
            held.lock().insert(("a".into(), step), HeldStep { spec: spec.clone(), bricks });
        }
        let member = Member::new(outbox.clone(), channels.member, held, Backend::cpu());
        std::thread::spawn(move || member.run());
        root.get_or_insert_with(|| Arc::new(Root::new(outbox, channels.replies)));
    }
    root.unwrap()
}

fn whole(scene: &Scene) -> Field {
    Field::new(Volume::new(grid(), Voxels::F32(floats(&bytes_of(&at([0; 3], DIMS))))).unwrap(), scene)
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

fn scene() -> Scene {
    suggest(&[&Volume::new(grid(), Voxels::F32(floats(&bytes_of(&at([0; 3], DIMS))))).unwrap()]).unwrap()
}

#[test]
fn a_group_makes_the_vdi_of_one_node() {
    let (scene, options) = (scene(), EncodeOptions::default());
    for layout in layouts() {
        let root = group(&layout, 3);
        for step in 0..3 {
            let field =
                GroupField::prepare(&root, ("a", step), (&spec(), "f", false), scene.clone(), layout.clone()).unwrap();
            assert_eq!(field.empty_voxels(), 1);
            for (gamma, segmentation) in [(0.0, Segmentation::Greedy), (0.02, Segmentation::Fitted)] {
                let params = VdiParams::new(33, gamma).unwrap();
                let alone = Backend::cpu().generate(&whole(&scene), &params, segmentation).unwrap().0;
                let together = field.generate(&params, segmentation).unwrap();
                assert!(gamma > 0.0 || together.bytes == encode(&alone, &options).unwrap(), "samples differ");
                let decoded = decode(&together.bytes, &DecodeLimits::default()).unwrap();
                assert_eq!(decoded.header(), alone.header());
                assert_eq!(decoded.segments().len() as u64, together.segments);
                let (a, b) = (alone.segments().len(), decoded.segments().len());
                assert!(a > 500 && a.abs_diff(b) * 50 < a, "{a} and {b} supersegments");
            }
        }
    }
}

#[test]
fn members_code_the_bands_of_a_large_vdi_to_the_bytes_of_one_node() {
    let scene = scene();
    // Of its 100^2 rays, so many samples are seen that they go in several bands.
    let params = VdiParams::new(100, 0.0).and_then(|params| params.with_step_voxels(0.1)).unwrap();
    let alone = Backend::cpu().generate(&whole(&scene), &params, Segmentation::Greedy).unwrap().0;
    let bytes = encode(&alone, &EncodeOptions::default()).unwrap();
    let bands = band_sizes(&bytes, &DecodeLimits::default()).unwrap().len();
    assert!(bands >= 3, "{bands} bands");
    for layout in layouts() {
        let field =
            GroupField::prepare(&group(&layout, 1), ("a", 0), (&spec(), "f", false), scene.clone(), layout.clone())
                .unwrap();
        assert!(field.generate(&params, Segmentation::Greedy).unwrap().bytes == bytes, "{} members", layout.len());
    }
}

#[test]
fn a_group_casts_the_shadows_of_one_node() {
    let effects = Effects { light: Some(DVec3::new(-1.0, 2.0, 0.5)), shadows: Some(0.8), ..Effects::default() };
    for effects in [effects.clone(), Effects { ambient_occlusion: Some(0.7), ..effects }] {
        let lit = Scene { effects, ..scene() };
        let plan = SamplePlan { image_size: 96, tile: 8, batches: 3, angles_deg: vec![10.0, 70.0, 200.0] };
        let alone = Backend::cpu().reference_slice(&whole(&lit), &plan, 0, 0..3).unwrap();
        let unlit = Backend::cpu().reference_slice(&whole(&scene()), &plan, 0, 0..3).unwrap();
        for layout in layouts() {
            let root = group(&layout, 1);
            let field = GroupField::prepare(&root, ("a", 0), (&spec(), "f", false), lit.clone(), layout).unwrap();
            let together = field.reference_slice(&plan, 0..3).unwrap();
            for ((a, b), unlit) in alone.colors.iter().zip(&together.colors).zip(&unlit.colors) {
                let [mut error, mut darkness] = [SquaredError::default(); 2];
                error.add_all(a, b);
                darkness.add_all(unlit, b);
                assert!(error.psnr_db() > 90.0, "{} dB", error.psnr_db());
                assert!(darkness.psnr_db() < 40.0, "{} dB from the unlit picture", darkness.psnr_db());
            }
        }
    }
}

#[test]
fn a_group_reduces_to_the_volume_of_one_node() {
    let scene = scene();
    for layout in layouts() {
        let root = group(&layout, 1);
        let field = GroupField::prepare(&root, ("a", 0), (&spec(), "f", false), scene.clone(), layout.clone()).unwrap();
        assert_eq!(field.longest_side(), 21);
        for longest in [21, 11, 4] {
            let params = VolumeParams::new(longest, 0.01).unwrap();
            let (alone, (together, _)) = (reduce(&whole(&scene), &params).unwrap(), field.reduce(&params).unwrap());
            assert_eq!((together.grid(), together.scene()), (alone.grid(), alone.scene()));
            // One voxel is missing: at full resolution it is in both.
            for (a, b) in alone.units().iter().zip(together.units()) {
                assert!(a.is_nan() == b.is_nan() && (a.is_nan() || (a - b).abs() < 0.01), "{a} {b}");
            }
            assert_eq!(together.units().iter().filter(|u| u.is_nan()).count(), usize::from(longest == 21));
        }
    }
}

#[test]
fn reference_pixels_of_a_group_are_those_of_one_node() {
    let scene = scene();
    let plan = SamplePlan { image_size: 96, tile: 8, batches: 3, angles_deg: vec![10.0, 70.0, 200.0] };
    let alone = Backend::cpu().reference_slice(&whole(&scene), &plan, 0, 1..3).unwrap();
    for layout in layouts() {
        let root = group(&layout, 1);
        let field = GroupField::prepare(&root, ("a", 0), (&spec(), "f", false), scene.clone(), layout).unwrap();
        let together = field.reference_slice(&plan, 1..3).unwrap();
        assert_eq!((&together.plan, &together.batches, together.colors.len()), (&alone.plan, &alone.batches, 3));
        for (a, b) in alone.colors.iter().zip(&together.colors) {
            let mut error = SquaredError::default();
            error.add_all(a, b);
            assert!(a.len() == b.len() && error.psnr_db() > 90.0, "{} dB", error.psnr_db());
        }
    }
}

#[test]
fn a_scene_can_be_chosen_from_a_coarse_volume() {
    for layout in layouts() {
        let root = group(&layout, 1);
        let shown = spec().shown_fields("f", None).unwrap();
        let coarse = root.coarse(("a", 0), (&spec(), &shown), &layout).unwrap();
        // So small a grid is not coarsened at all.
        let Voxels::F32(points) = coarse.voxels() else { panic!("another type") };
        let expected = floats(&bytes_of(&at([0; 3], DIMS)));
        assert!(
            points.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()) && points.len() == expected.len()
        );
    }
}

#[test]
fn what_a_member_lacks_or_cannot_make_is_said_with_its_number_and_the_group_goes_on() {
    let layout = &layouts()[1];
    let root = group(layout, 1);
    let prepare = |step| GroupField::prepare(&root, ("a", step), (&spec(), "f", false), scene(), layout.clone());
    let missing = prepare(7).err().unwrap();
    assert!(missing.reason.contains("member 0") && missing.reason.contains("nothing of step 7"), "{missing}");
    let field = prepare(0).unwrap();
    let params = VdiParams::new(9, 0.1).unwrap();
    assert!(field.generate(&params, Segmentation::Fitted).is_ok());
    let absurd = field.reference_slice(&SamplePlan { tile: 0, ..SamplePlan::default() }, 0..1).err().unwrap();
    assert!(absurd.reason.contains("tile") || absurd.thing.contains("tile"), "{absurd}");
    // The step was taken: it cannot be prepared again.
    assert!(prepare(0).is_err());
    assert!(field.generate(&params, Segmentation::Fitted).is_ok());
}

#[test]
fn nobody_waits_for_what_a_member_that_lacks_the_step_cannot_send() {
    // As when a fast simulation has overtaken one member and not the other.
    let layout = &layouts()[1];
    let lacking = (layout.len() - 1) as u32;
    let root = group_of(layout, |member| u64::from(member != lacking) + 1);
    let prepare = |step| GroupField::prepare(&root, ("a", step), (&spec(), "f", false), scene(), layout.clone());
    let shown = spec().shown_fields("f", None).unwrap();
    let missing = root.coarse(("a", 1), (&spec(), &shown), layout).err().unwrap();
    assert!(missing.reason.contains("member 1 lacks points of step 1"), "{missing}");
    let begun = std::time::Instant::now();
    let missing = prepare(1).err().unwrap();
    assert!(missing.reason.contains("nothing of step 1"), "{missing}");
    assert!(begun.elapsed() < Duration::from_secs(30), "members wait a minute for one that is silent");
    assert!(prepare(0).is_ok(), "the group goes on");
}

#[test]
fn what_members_compute_of_several_fields_is_what_one_node_does() {
    let names = ["v.x", "v.y", "v.z"];
    let run =
        RunSpec { more_fields: names.iter().map(|name| ((*name).to_owned(), VoxelType::F32)).collect(), ..spec() };
    let component = |axis: usize, x: usize, y: usize, z: usize| {
        let p = [x as f32 / 20.0, y as f32 / 17.0, z as f32 / 14.0];
        (6.0 * p[(axis + 1) % 3]).sin() * (5.0 * p[axis]).cos() + p[(axis + 2) % 3] * p[axis]
    };
    let field = |axis: usize, b: &GridBox| -> Vec<u8> {
        let ([x0, y0, z0], [nx, ny, nz]) = (b.start(), b.dims());
        let rows = (z0..z0 + nz).flat_map(|z| (y0..y0 + ny).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| (x0..x0 + nx).flat_map(move |x| component(axis, x, y, z).to_le_bytes())).collect()
    };
    let all = at([0; 3], DIMS);
    for (text, empty) in
        [("magnitude(curl(v))", 0), ("magnitude(curl(curl(v)))", 0), ("q_criterion(v) - density_of", 1)]
    {
        let text = text.replace("density_of", "f");
        let shown = run.shown_fields(&text, None).unwrap();
        let mut fields = vec![Some(Voxels::F32(floats(&bytes_of(&all))))];
        fields.extend((0..3).map(|axis| Some(Voxels::F32(floats(&field(axis, &all))))));
        let volume = shown.volume(grid(), fields).unwrap();
        let scene = suggest(&[&volume]).unwrap();
        let alone = Field::new(volume, &scene);
        let params = VdiParams::new(33, 0.0).unwrap();
        let expected = Backend::cpu().generate(&alone, &params, Segmentation::Greedy).unwrap().0;
        let expected = encode(&expected, &EncodeOptions::default()).unwrap();
        for layout in layouts() {
            let bytes = |b: &GridBox| (0..3).fold(bytes_of(b), |bytes, axis| [bytes, field(axis, b)].concat());
            let root = group_with(&layout, &run, bytes, |_| 1);
            let made =
                GroupField::prepare(&root, ("a", 0), (&run, &text, false), scene.clone(), layout.clone()).unwrap();
            assert_eq!(made.empty_voxels(), empty, "{text}");
            assert!(made.generate(&params, Segmentation::Greedy).unwrap().bytes == expected, "{text}: samples differ");
        }
    }
}

#[test]
fn statistics_and_pictures_of_parts_are_those_of_the_whole() {
    let scene = scene();
    let alone = Statistics::of(&Voxels::F32(floats(&bytes_of(&at([0; 3], DIMS)))));
    let picture = Backend::cpu().raycast(&whole(&scene), &scene.camera, 40, 40).unwrap();
    for layout in layouts() {
        let root = group(&layout, 1);
        let run = (&spec(), "f", true);
        let mut field = GroupField::prepare(&root, ("a", 0), run, scene.clone(), layout.clone()).unwrap();
        let together = field.take_statistics().unwrap();
        assert_eq!((together.min, together.max, together.missing), (alone.min, alone.max, 1));
        assert!((together.mean - alone.mean).abs() < 1e-12, "summed in another order");
        assert_eq!([0.0, 0.3, 0.99].map(|p| together.quantile(p)), [0.0, 0.3, 0.99].map(|p| alone.quantile(p)));
        assert_eq!(together.entropy(), alone.entropy());
        let bits = |of: &Statistics| of.samples.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&together), bits(&alone));
        let db = psnr(&picture, &field.picture(0.0, 40).unwrap()).unwrap();
        assert!(db > 90.0, "{db} dB");
    }
}

#[test]
fn steps_on_uneven_points_are_those_of_one_node() {
    // Denser towards one end of x, at the middle of y, and even along z.
    let along = |n: usize, f: fn(f64) -> f64| (0..n).map(|i| f(i as f64 / (n - 1) as f64)).collect::<Vec<_>>();
    let axes = [along(21, |t| 4.0 * t * t), along(18, |t| (t - 0.5).powi(3) + 0.2 * t), along(15, |t| 3.0 * t - 1.0)];
    let coordinates = Coordinates::new(axes).unwrap();
    let even = coordinates.grid().unwrap();
    let run = RunSpec { coordinates: Some(coordinates.clone()), grid: even, ..spec() };
    let volume = Volume::new(even, coordinates.resample(Voxels::F32(floats(&bytes_of(&at([0; 3], DIMS)))))).unwrap();
    let (scene, expected) = (suggest(&[&volume]).unwrap(), Statistics::of(volume.voxels()));
    let params = VdiParams::new(33, 0.0).unwrap();
    let alone = Backend::cpu().generate(&Field::new(volume.clone(), &scene), &params, Segmentation::Greedy).unwrap().0;
    let alone = encode(&alone, &EncodeOptions::default()).unwrap();
    for layout in layouts() {
        let root = group_with(&layout, &run, bytes_of, |_| 1);
        let shown = run.shown_fields("f", None).unwrap();
        let coarse = root.coarse(("a", 0), (&run, &shown), &layout).unwrap();
        let bits = |voxels: &Voxels| (0..voxels.len()).map(|n| voxels.get(n).to_bits()).collect::<Vec<_>>();
        // So small a grid is not coarsened at all.
        assert!(coarse.grid() == &even && bits(coarse.voxels()) == bits(volume.voxels()));
        let mut field = GroupField::prepare(&root, ("a", 0), (&run, "f", true), scene.clone(), layout.clone()).unwrap();
        let together = field.take_statistics().unwrap();
        assert_eq!(field.empty_voxels(), expected.missing, "around the one that is missing");
        assert_eq!((together.min, together.max, together.missing), (expected.min, expected.max, expected.missing));
        assert!(field.generate(&params, Segmentation::Greedy).unwrap().bytes == alone, "{} members", layout.len());
    }
}

#[test]
fn empty_points_without_a_cell_are_counted_too() {
    let layout = &layouts()[2];
    // The last plane has the points of no cell of its own; its first one is empty besides the one of `value`.
    let bytes = |b: &GridBox| {
        let mut bytes = bytes_of(b);
        if b.start() == [0, 0, 14] {
            bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        bytes
    };
    let root = group_with(layout, &spec(), bytes, |_| 1);
    let field = GroupField::prepare(&root, ("a", 0), (&spec(), "f", false), scene(), layout.clone()).unwrap();
    assert_eq!(field.empty_voxels(), 2);
}
