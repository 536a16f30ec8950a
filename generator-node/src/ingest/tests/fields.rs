//! Runs whose bricks carry several fields.

use super::*;
use lamina_field_expression::ShownFields;
use lamina_model::Coordinates;

fn named(shown: Option<&str>, names: &[&str]) -> RunSpec {
    let more_fields = names.iter().map(|name| ((*name).to_owned(), VoxelType::F32)).collect();
    RunSpec { more_fields, shown: shown.map(str::to_owned), ..spec(1, FullPolicy::Block) }
}

const VELOCITY: [&str; 3] = ["v.x", "v.y", "v.z"];

#[test]
fn what_is_shown_is_computed_from_the_fields_that_a_step_brings() {
    let run = named(Some("dot(v, v) + density"), &VELOCITY);
    let per_point = 2 + 3 * 4;
    assert_eq!(run.step_bytes(), VOXELS * per_point);
    // What is computed takes memory, too.
    let needed = 3 * run.step_bytes() + (12 + 4) * VOXELS;
    let mut small = Node { core: Core::new(needed - 1, 9, IDLE), start: Instant::now() };
    assert!(
        matches!(small.open(run.clone(), 0, "", "a"), Err(IngestError::Exhausted { needed_bytes, .. }) if needed_bytes == needed)
    );
    let mut node = Node { core: Core::new(needed, 9, IDLE), start: Instant::now() };
    node.open(run.clone(), 0, "", "a").unwrap();
    let offer = BrickOffer { step: 0, time: 0.0, rank: 0, index: 0, bricks: 1, start: [0; 3], dims: DIMS.map(|n| n) };
    assert_eq!(node.core.admit("a", &offer, node.start), Ok(Admit::Granted((VOXELS * per_point) as usize)));
    let mut bytes: Vec<u8> = (0..VOXELS).flat_map(|n| (n as u16).to_le_bytes()).collect();
    for axis in [1.0_f32, 2.0, 3.0] {
        bytes.extend((0..VOXELS).flat_map(|n| (axis * n as f32).to_le_bytes()));
    }
    assert_eq!(node.core.receive("a", 0, (0, 0), bytes, node.start).unwrap(), Some(true));
    let volume = volume_of(node.core.take_complete(node.start).unwrap());
    let expected = (0..VOXELS).map(|n| (14 * n * n + n) as f32).collect();
    assert_eq!(volume.voxels(), &Voxels::F32(expected));
}

#[test]
fn another_field_is_shown_where_there_is_the_memory_for_it() {
    let run = named(None, &VELOCITY);
    let spare = Core::new(3 * run.step_bytes() + (12 + 4) * VOXELS, 9, IDLE);
    let mut node = Node { core: spare, start: Instant::now() };
    node.open(run.clone(), 0, "", "a").unwrap();
    let of = |text: &str| run.shown_fields(text, None).unwrap();
    assert_eq!(node.core.show(&run, &of("magnitude(v)")), Ok(()));
    // A result, and three arrays of which derivatives are taken.
    let refused = node.core.show(&run, &of("divergence(curl(v))"));
    assert!(matches!(refused, Err(IngestError::Exhausted { .. })), "{refused:?}");
}

#[test]
fn fields_that_cannot_be_are_refused_by_name() {
    let refusal = |run: RunSpec| run.check(0, 1 << 30).unwrap_err().to_string();
    assert!(refusal(named(Some("magnitude(v)"), &["v.x", "v.y"])).contains("no field \"v\""));
    assert!(refusal(named(Some("pressure"), &VELOCITY)).contains("Fields: density, v.x, v.y, v.z"));
    assert!(refusal(named(None, &["a", "a"])).contains("two fields are named \"a\""));
    assert!(refusal(named(None, &["density"])).contains("two fields are named \"density\""));
    assert!(refusal(named(None, &[""])).contains("1 to 200 bytes"));
    assert!(refusal(named(None, &[&*"x".repeat(300)])).contains("1 to 200 bytes"));
    let many: Vec<String> = (0..65).map(|n| n.to_string()).collect();
    assert!(refusal(named(None, &many.iter().map(String::as_str).collect::<Vec<_>>())).contains("at most 64"));
    assert!(named(Some("magnitude(v)"), &VELOCITY).check(0, 1 << 30).is_ok());
    let colored =
        RunSpec { color_field: Some(("v.x".to_owned(), VoxelType::F32)), ..named(Some("v.z"), &VELOCITY[1..]) };
    assert!(
        colored.check(0, 1 << 30).is_ok()
            && colored.shown_fields("v.z", None).is_ok_and(|s: ShownFields| s.has_colors())
    );
}

#[test]
fn fields_at_uneven_points_are_resampled_before_anything_is_computed_from_them() {
    // Denser along z towards its end; x and y are even.
    let z: Vec<f64> = (0..DIMS[2]).map(|n| (1.0 + n as f64).ln()).collect();
    let axes = [vec![0.0, 0.5], vec![1.0, 1.25, 1.5], z.clone()];
    let coordinates = Coordinates::new(axes).unwrap();
    let grid = coordinates.grid().unwrap();
    let uneven = |shown: &str, members: u32| RunSpec {
        grid,
        coordinates: Some(coordinates.clone()),
        members,
        voxel_type: VoxelType::F64,
        shown: Some(shown.to_owned()),
        ..spec(1, FullPolicy::Block)
    };
    // 3 z + 2: its derivative is known wherever points are.
    for (shown, expected) in [("density", None), ("gradient(density).z", Some(3.0))] {
        let mut node = Node { core: Core::new(1 << 20, 9, IDLE), start: Instant::now() };
        node.open(uneven(shown, 1), 0, "", "a").unwrap();
        let offer = BrickOffer { step: 0, time: 0.0, rank: 0, index: 0, bricks: 1, start: [0; 3], dims: DIMS };
        node.core.admit("a", &offer, node.start).unwrap();
        let plane = (DIMS[0] * DIMS[1]) as usize;
        let bytes: Vec<u8> = z.iter().flat_map(|z| (3.0 * z + 2.0).to_le_bytes().repeat(plane)).collect();
        node.core.receive("a", 0, (0, 0), bytes, node.start).unwrap();
        let volume = volume_of(node.core.take_complete(node.start).unwrap());
        assert_eq!(volume.grid(), &grid);
        for (n, at) in grid.coordinates()[2].iter().enumerate() {
            let (found, expected) = (volume.voxels().get(n * plane), expected.unwrap_or(3.0 * at + 2.0));
            assert!((found - expected).abs() < 1e-5, "{shown} at {at}: {found}, not {expected}");
        }
    }
    // In a group each node needs memory for its half, before and after it is resampled, and for points from all around it.
    let [uneven, even] = [true, false].map(|is_uneven| {
        let run = uneven("density", 2);
        let run = RunSpec { coordinates: run.coordinates.clone().filter(|_| is_uneven), ..run };
        run.working_bytes(&run.shown_fields("density", None).unwrap())
    });
    assert_eq!(uneven - even, (2 * 8 / 2 + 8) * DIMS.iter().product::<u64>());
}
