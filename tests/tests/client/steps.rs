//! All is well.

use crate::{Node, SIDE, VOXELS, admitted, any_port, connect, cube, options, push_planes, refusal};
use lamina_client::{Brick, Client, ClientError, FullPolicy, RunOptions, Summary};
use lamina_generator_node::Config;
use lamina_model::suggest::suggest;
use lamina_model::{ColorField, Effects, ScalarRange, Scale, Scene, Volume, VoxelType, Voxels};

#[test]
fn three_ranks_hand_in_uneven_slabs_and_the_last_completes_the_step() {
    let node = Node::generator(2);
    let mut ranks = [0, 1, 2].map(|rank| connect(&node, rank, 3, FullPolicy::Block));
    assert!(ranks.iter().all(|c| c.run_id() == ranks[0].run_id()));
    let slabs = [(0, 1), (1, 5), (6, 2)];
    for step in 0..5 {
        let receipts = [2, 0, 1].map(|r| push_planes(&mut ranks[r], step, slabs[r].0, slabs[r].1).unwrap());
        assert_eq!(receipts, [admitted(false), admitted(false), admitted(true)]);
    }
    let closed = Summary { pushed: 5, dropped: 0, lost: 0, run_dropped_steps: Some(0) };
    assert_eq!(ranks.map(Client::close), [closed; 3]);
}

#[test]
fn steps_of_a_fast_simulation_are_admitted_or_dropped_and_none_is_refused() {
    let node = Node::generator(2);
    let mut client = connect(&node, 0, 1, FullPolicy::DropOldest);
    let pushed = (0..4000).map(|step| push_planes(&mut client, step, 0, SIDE));
    let refused: Vec<_> = pushed.filter_map(Result::err).collect();
    assert!(refused.is_empty(), "{} steps: {}", refused.len(), refused[0]);
    assert_eq!(client.close().lost, 0);
}

#[test]
fn every_voxel_type_arrives() {
    fn push<T>(voxel_type: VoxelType, voxels: Vec<T>)
    where
        for<'a> &'a Vec<T>: Into<lamina_client::VoxelSlice<'a>>,
    {
        let node = Node::generator(8);
        let mut client = Client::connect(RunOptions { voxel_type, ..options(&node.url()) }).unwrap();
        let receipt = client.push(0, 0.0, &Brick::new([0; 3], [SIDE; 3], &voxels));
        assert_eq!(receipt.unwrap(), admitted(true), "{voxel_type}");
    }
    push(VoxelType::U8, vec![1_u8; VOXELS]);
    push(VoxelType::U16, vec![1_u16; VOXELS]);
    push(VoxelType::I16, vec![-1_i16; VOXELS]);
    push(VoxelType::F32, vec![f32::NAN; VOXELS]);
    push(VoxelType::F64, vec![1e300_f64; VOXELS]);
}

#[test]
fn a_second_field_arrives_with_the_first_and_must_be_the_one_the_scene_asks_for() {
    let node = Node::generator(8);
    let color_field = Some(("temperature".to_owned(), VoxelType::U8));
    let named = |name: &str| {
        let range = ScalarRange::new(0.0, 255.0, Scale::Linear).unwrap();
        let colors = ColorField { name: name.into(), range, points: ColorField::cool_to_warm() };
        let (grid, voxels) = (cube(SIDE), Voxels::F32((0..VOXELS).map(|n| n as f32).collect()));
        let scene = suggest(&[&Volume::new(grid, voxels).unwrap()]).unwrap();
        Some(Scene { effects: Effects { color_field: Some(colors), ..Effects::default() }, ..scene })
    };
    let open = |scene, color_field: &Option<(String, VoxelType)>| {
        Client::connect(RunOptions { scene, color_field: color_field.clone(), ..options(&node.url()) })
    };
    let message = refusal(open(named("temperature"), &None).map(drop));
    assert!(message.contains("\"temperature\"") && message.contains("color_field"), "{message}");
    let message = refusal(open(named("pressure"), &color_field).map(drop));
    assert!(message.contains("\"pressure\"") && message.contains("Fields: density, temperature"), "{message}");

    // So does a node whose own scene asks for one.
    let config = Config { scene: named("temperature"), ..Config::default() };
    let other = Node::configured(any_port(), config);
    let message = refusal(Client::connect(options(&other.url())).map(drop));
    assert!(message.contains("\"temperature\"") && message.contains("no field"), "{message}");
    let pushes = RunOptions { color_field: color_field.clone(), ..options(&other.url()) };
    Client::connect(pushes).unwrap();

    let mut client = open(named("temperature"), &color_field).unwrap();
    let (density, heat) = (vec![1.0_f32; VOXELS], vec![7_u8; VOXELS]);
    let brick = Brick::new([0; 3], [SIDE; 3], &density);
    for (step, (brick, words)) in
        [(brick, "no voxels of temperature"), (brick.with_colors(&heat[1..]), "511 voxels of temperature")]
            .into_iter()
            .enumerate()
    {
        match client.push(step as u64, 0.0, &brick) {
            Err(ClientError::Invalid(e)) => assert!(e.reason.contains(words), "{e}"),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(client.push(2, 0.0, &brick.with_colors(&heat)).unwrap(), admitted(true));
}
