//! Bricks handed over in memory that client and node both map.
#![cfg(target_os = "linux")]

use crate::{Node, SIDE, VOXELS, admitted, any_port, connect, options, push_half, push_until, push_whole};
use lamina_client::{Client, ClientError, FullPolicy, RunOptions, Summary};
use lamina_generator_node::Config;
use lamina_model::VoxelType;
use lamina_rpc::v1::{self, ingest_client::IngestClient, push_part::Part};

/// Memory regions of this process that were memfds of clients or nodes.
fn mapped_slots() -> usize {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines().filter(|line| line.contains("memfd:lamina")).count()
}

#[test]
fn a_client_on_the_nodes_host_shares_memory_unless_the_node_does_not() {
    let node = Node::generator(4);
    let mut client = connect(&node, 0, 1, FullPolicy::Block);
    assert!(client.shares_memory());
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    assert!(mapped_slots() >= 2, "one at each end");

    let config = Config { shared_memory: false, ..Config::default() };
    let other = Node::configured(any_port(), config);
    let mut client = connect(&other, 0, 1, FullPolicy::Block);
    assert!(!client.shares_memory());
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
}

#[test]
fn what_waits_for_other_ranks_never_leaves_a_rank_without_room() {
    // Far more incomplete steps than a ring has slots.
    let node = Node::generator(20);
    let [mut first, mut second] = [0, 1].map(|rank| connect(&node, rank, 2, FullPolicy::Block));
    for step in 0..12 {
        assert_eq!(push_half(&mut first, step, 0).unwrap(), admitted(false));
    }
    for step in 0..12 {
        assert_eq!(push_half(&mut second, step, 1).unwrap(), admitted(true));
    }
    assert!(first.shares_memory() && second.shares_memory());
    let closed = Summary { pushed: 12, dropped: 0, lost: 0, run_dropped_steps: Some(0) };
    assert_eq!([first, second].map(Client::close), [closed; 2]);
}

#[test]
fn a_buffer_outlives_its_node_and_is_pushed_to_the_next_one() {
    let node = Node::generator(4);
    let mut client = connect(&node, 0, 1, FullPolicy::Block);
    assert_eq!(push_whole(&mut client, 0).unwrap(), admitted(true));
    let mut buffer = client.buffer([0; 3], [SIDE; 3]).unwrap();
    let address = node.kill();
    buffer.voxels_mut::<f32>().unwrap().fill(3.0);
    let lost = client.push_buffer(1, 1.0, buffer);
    assert!(matches!(lost, Err(ClientError::Unreachable { .. })), "{lost:?}");
    // Computed into while there is no node at all, pushed when there is one again.
    let mut buffer = client.buffer([0; 3], [SIDE; 3]).unwrap();
    buffer.voxels_mut::<f32>().unwrap().fill(4.0);
    let _restarted = Node::generator_at(address, 4);
    push_until(2, |step| push_whole(&mut client, step), Result::is_ok).0.unwrap();
    assert!(client.shares_memory());
    assert_eq!(client.push_buffer(1 << 40, 2.0, buffer).unwrap(), admitted(true));
    let mut buffer = client.buffer([0; 3], [SIDE; 3]).unwrap();
    buffer.voxels_mut::<f32>().unwrap().fill(5.0);
    assert_eq!(client.push_buffer(2 << 40, 3.0, buffer).unwrap(), admitted(true));
}

#[test]
fn buffers_that_cannot_be_of_the_run_are_refused() {
    let node = Node::generator(4);
    let mut client = connect(&node, 0, 1, FullPolicy::Block);
    for dims in [[0, 1, 1], [usize::MAX; 3]] {
        assert!(matches!(client.buffer([0; 3], dims), Err(ClientError::Invalid(_))), "{dims:?}");
    }
    let mut buffer = client.buffer([0; 3], [SIDE; 3]).unwrap();
    assert_eq!(buffer.voxels_mut::<f32>().unwrap().len(), VOXELS);
    assert!(buffer.voxels_mut::<f64>().unwrap_err().reason.contains("float64"));
    // Elsewhere than in the grid.
    let outside = client.push_buffer(0, 0.0, buffer.at([1, 0, 0]));
    assert!(matches!(outside, Err(ClientError::Refused(_))), "{outside:?}");

    // One byte a voxel, and colors of eight.
    let odd = RunOptions {
        voxel_type: VoxelType::U8,
        color_field: Some(("heat".into(), VoxelType::F64)),
        ..options(&node.url())
    };
    drop(client);
    let other = Node::generator(8);
    let mut client = Client::connect(RunOptions { generator: other.url(), ..odd }).unwrap();
    let unaligned = client.buffer([0; 3], [1, 1, 3]).unwrap_err();
    assert!(unaligned.to_string().contains("unaligned"), "{unaligned}");
    let mut buffer = client.buffer([0; 3], [SIDE; 3]).unwrap();
    let (voxels, colors) = buffer.fields_mut::<u8, f64>().unwrap();
    assert_eq!((voxels.len(), colors.len()), (VOXELS, VOXELS));
    assert!(client.push_buffer(0, 0.0, buffer).is_ok());
}

#[tokio::test]
async fn a_slot_that_was_not_handed_over_is_refused_and_its_reservation_comes_back() {
    let node = Node::generator(1);
    let mut ingest = IngestClient::new(node.channel().await);
    let options = options(&node.url());
    let open = v1::OpenRequest {
        name: options.name,
        field: options.field,
        grid: Some((&options.grid).into()),
        voxel_type: v1::VoxelType::F32.into(),
        ranks: 1,
        ..Default::default()
    };
    let run_id = ingest.open(open).await.unwrap().into_inner().run_id;
    let n = SIDE as u64;
    for step in 0..3 {
        let header = v1::BrickHeader { run_id: run_id.clone(), step, nx: n, ny: n, nz: n, ..Default::default() };
        let shared = Part::Shared(v1::SharedBrick { ring: 7, slot: 3 });
        let parts = [Part::Header(header), shared].map(|part| v1::PushPart { part: Some(part) });
        let mut answers = ingest.push(futures::stream::iter(parts)).await.unwrap().into_inner();
        assert_eq!(answers.message().await.unwrap().unwrap().admission(), v1::Admission::Admitted);
        let refused = answers.message().await.unwrap_err();
        assert!(refused.message().contains("slot 3 of ring 7 was not handed over"), "{refused}");
    }
}
