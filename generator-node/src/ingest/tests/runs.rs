//! Who opens, joins, resumes, replaces and ends a run.

use super::{DIMS, IDLE, Node, offer, refused, slab, spec};
use crate::ingest::{Admit, RunSpec};
use lamina_model::FullPolicy;
use std::time::{Duration, Instant};
use tonic::Code;

#[test]
fn another_run_gets_the_node_only_when_this_one_is_closed_or_silent() {
    let other = || RunSpec { name: "other".into(), ..spec(1, FullPolicy::Block) };
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    let almost = node.start + IDLE - Duration::from_millis(1);
    let early = node.core.open(other(), 0, "", "b".into(), almost);
    refused(early, Code::FailedPrecondition, &["\"blast\"", "30 s", "another node"]);
    for rank in [0, 1, 1, 7] {
        node.core.close("a", rank, node.start).unwrap();
    }
    refused(node.open(other(), 0, "", "b"), Code::FailedPrecondition, &["\"blast\""]);
    node.core.close("a", 2, node.start).unwrap();
    assert_eq!(node.open(other(), 0, "", "b").unwrap(), "b");

    let mut node = Node::serving(1, 1, FullPolicy::Block);
    let pushed_at = node.start + IDLE / 2;
    node.core.admit("a", &offer(0, 0.0, 0, [0; 3], DIMS), pushed_at).unwrap();
    assert!(node.core.open(other(), 0, "", "b".into(), node.start + IDLE).is_err(), "a push is a sign of life");
    assert_eq!(node.core.open(other(), 0, "", "b".into(), pushed_at + IDLE).unwrap(), "b");
    refused(node.admit_whole(0), Code::NotFound, &["open it again"]);
}

#[test]
fn a_replaced_runs_incomplete_steps_free_their_memory_and_its_complete_ones_are_kept() {
    let mut node = Node::serving(2, 3, FullPolicy::Block);
    node.push_slabs(0);
    node.push(1, 0);
    assert_eq!(node.open(spec(3, FullPolicy::Block), 0, "", "b").unwrap(), "b");
    let ask =
        |node: &mut Node, step| node.core.admit("b", &offer(step, 0.0, 0, [0; 3], [2, 3, 3]), node.start).unwrap();
    assert!(matches!(ask(&mut node, 0), Admit::Granted(_)));
    assert_eq!(node.core.receive("b", 0, (0, 0), slab(0), node.start).unwrap(), Some(false));
    assert_eq!(ask(&mut node, 1), Admit::Wait, "the old run's complete step still counts");
    assert_eq!(node.core.take_complete(Instant::now()).unwrap().run_id, "a");
    assert!(matches!(ask(&mut node, 1), Admit::Granted(_)));
}

#[test]
fn a_restarted_simulation_gets_a_fresh_run_that_its_other_ranks_join() {
    let mut node = Node::serving(9, 3, FullPolicy::Block);
    node.push_slabs(7);
    let restarted = || spec(3, FullPolicy::Block);
    assert_eq!(node.open(restarted(), 0, "", "b").unwrap(), "b");
    assert_eq!(node.open(restarted(), 1, "", "c").unwrap(), "b");
    assert_eq!(node.open(restarted(), 2, "", "d").unwrap(), "b");
    let first = node.core.admit("b", &offer(0, 0.0, 0, [0; 3], [2, 3, 3]), node.start).unwrap();
    assert!(matches!(first, Admit::Granted(_)), "its steps count from the start");
}

#[test]
fn a_rank_that_closed_and_comes_again_is_a_new_start_though_others_never_closed() {
    let mut node = Node::serving(9, 3, FullPolicy::Block);
    node.push_slabs(7);
    node.core.close("a", 0, node.start).unwrap();
    assert_eq!(node.open(spec(3, FullPolicy::Block), 0, "", "b").unwrap(), "b");
}

#[test]
fn ranks_that_resume_after_a_node_restart_meet_under_the_old_id() {
    let mut node = Node::with_room_for(1);
    for rank in [2, 0, 1] {
        assert_eq!(node.open(spec(3, FullPolicy::Block), rank, "a", "fresh").unwrap(), "a");
    }
    assert_eq!(node.open(spec(3, FullPolicy::Block), 1, "a", "fresh").unwrap(), "a", "a lost connection resumes too");
    assert_eq!(node.push(3, 0), Some(false));
}

#[test]
fn ranks_with_different_ids_meet_in_one_run_instead_of_replacing_each_other() {
    let mut node = Node::with_room_for(1);
    let spec = || spec(3, FullPolicy::Block);
    assert_eq!(node.open(spec(), 1, "", "b").unwrap(), "b");
    assert_eq!(node.open(spec(), 0, "a", "c").unwrap(), "b", "rank 0 opened before the node was restarted");
    assert_eq!(node.open(spec(), 2, "a", "d").unwrap(), "b");
    refused(node.open(spec(), 0, "a", "e"), Code::FailedPrecondition, &["rank 0", "\"a\"", "\"b\""]);
    assert_eq!(node.core.close("b", 1, node.start).unwrap(), 0, "the run is untouched");
}

#[test]
fn a_rank_that_is_done_before_another_has_come_does_not_end_the_run() {
    let mut node = Node::with_room_for(3);
    let three = || spec(3, FullPolicy::Block);
    for rank in [0, 1] {
        assert_eq!(node.open(three(), rank, "", "a").unwrap(), "a");
        assert_eq!(node.push(0, rank), Some(false));
        assert_eq!(node.core.close("a", rank, node.start).unwrap(), 1, "it lacks a brick so far");
    }
    assert_eq!(node.open(three(), 2, "", "b").unwrap(), "a");
    assert_eq!(node.push(0, 2), Some(true));
    assert_eq!(node.core.close("a", 2, node.start).unwrap(), 0);
    assert_eq!(node.open(three(), 2, "", "b").unwrap(), "b", "now it has ended");
}

#[test]
fn the_end_of_a_run_drops_and_counts_its_incomplete_steps() {
    let mut node = Node::serving(2, 3, FullPolicy::Block);
    node.push(0, 0);
    node.push(1, 0);
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 0);
    assert_eq!(node.core.close("a", 1, node.start).unwrap(), 0);
    assert_eq!(node.core.close("a", 2, node.start).unwrap(), 2);
}

#[test]
fn a_run_whose_rank_never_came_stands_in_nobodys_way() {
    let left = || {
        let mut node = Node::with_room_for(3);
        assert_eq!(node.open(spec(2, FullPolicy::Block), 0, "", "a").unwrap(), "a");
        assert!(node.admit_box(0, 0, 0, 3).is_ok());
        node.core.close("a", 0, node.start).unwrap();
        node
    };
    let (same, later) = (|| spec(2, FullPolicy::Block), |node: &Node| node.start + IDLE);
    let mut node = left();
    assert_eq!(node.open(same(), 1, "", "b").unwrap(), "a", "its second rank, late");
    let mut node = left();
    let now = later(&node);
    assert_eq!(node.core.open(same(), 1, "", "b".into(), now).unwrap(), "b", "a new start, its second rank first");
    let mut node = left();
    assert_eq!(node.open(spec(3, FullPolicy::Block), 1, "", "b").unwrap(), "b", "a new start, described otherwise");
    let mut node = left();
    assert_eq!(node.open(RunSpec { name: "other".into(), ..same() }, 0, "", "b").unwrap(), "b", "another run");

    // One that was killed: nobody closed.
    let mut node = Node::serving(3, 3, FullPolicy::Block);
    let larger = || spec(5, FullPolicy::Block);
    refused(node.open(larger(), 4, "", "b"), Code::FailedPrecondition, &["rank 4", "silent for 30 s"]);
    let now = later(&node);
    assert_eq!(node.core.open(larger(), 4, "", "b".into(), now).unwrap(), "b");
}
