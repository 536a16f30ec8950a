//! A node of a group: it hears of some ranks only, and of how many they are.

use super::*;

fn member() -> Node {
    let mut node = Node::with_room_for(9);
    assert_eq!(node.open(RunSpec { members: 2, ..spec(3, FullPolicy::Block) }, 1, "", "a").unwrap(), "a");
    node
}

#[test]
fn steps_are_whole_once_it_is_known_how_many_ranks_come_here() {
    let mut node = member();
    // Rank 1 is in, and nobody has said that it is alone.
    assert_eq!(node.push(0, 1), Some(false));
    assert!(!node.core.has_complete());
    node.core.tell_ranks("a", 1, node.start);
    assert!(node.core.has_complete());
    assert_eq!(node.push(1, 1), Some(true));
    assert_eq!([node.next_number(), node.next_number()], [Some(0), Some(1)]);
    // Told before the run is there, as by the root of a group whose other ranks were first.
    let mut node = Node::with_room_for(9);
    node.core.tell_ranks("a", 1, node.start);
    node.open(RunSpec { members: 2, ..spec(3, FullPolicy::Block) }, 1, "", "a").unwrap();
    assert_eq!(node.push(0, 1), Some(true));
}

#[test]
fn a_root_without_ranks_keeps_its_run_while_members_hear_of_it() {
    let mut node = member();
    node.core.tell_ranks("a", 0, node.start);
    let other = |node: &mut Node, seconds| {
        let spec = RunSpec { name: "other".into(), members: 2, ..spec(1, FullPolicy::Block) };
        node.core.open(spec, 0, "", "b".into(), node.start + Duration::from_secs(seconds))
    };
    refused(other(&mut node, 20), Code::FailedPrecondition, &["serves run \"blast\""]);
    node.core.heard("a", node.start + Duration::from_secs(25));
    refused(other(&mut node, 50), Code::FailedPrecondition, &["serves run \"blast\""]);
    assert_eq!(other(&mut node, 60).unwrap(), "b");
}

#[test]
fn a_silent_rank_of_a_node_that_the_others_are_past_leaves_a_hole_of_its_own_boxes() {
    let mut node = member();
    node.core.tell_ranks("a", 2, node.start);
    node.open(RunSpec { members: 2, ..spec(3, FullPolicy::Block) }, 2, "", "a").unwrap();
    assert_eq!((node.push(0, 1), node.push(0, 2)), (Some(false), Some(true)));
    assert_eq!(node.next_number(), Some(0));
    // Rank 2 goes on, and so do the other nodes.
    assert_eq!(node.push(1, 2), Some(false));
    node.core.overdue("a", (1, 1.0), node.start);
    assert!(!node.core.has_complete(), "it was heard just now");
    node.start += Duration::from_secs(6);
    node.core.overdue("a", (1, 1.0), node.start);
    let complete = node.core.take_complete(node.start).unwrap();
    assert_eq!((complete.step, &complete.lost_ranks[..]), (1, &[1][..]));
    let boxes = |step: &CompleteStep| step.boxes().copied().collect::<Vec<_>>();
    assert_eq!(boxes(&complete).len(), 2);
    let (_, bricks) = complete.into_bricks();
    // Integers have no NaN.
    assert!(bricks[1].1.iter().all(|byte| *byte == 0) && bricks[0].1[..] == slab(2)[..]);
    // It is not waited for any more; where nothing comes at all, the root's word completes the step.
    assert_eq!(node.push(2, 2), Some(true));
    assert_eq!(node.next_number(), Some(2));
    node.start += Duration::from_secs(6);
    node.core.overdue("a", (3, 3.0), node.start);
    let complete = node.core.take_complete(node.start).unwrap();
    assert_eq!((complete.step, complete.time, &complete.lost_ranks[..]), (3, 3.0, &[1, 2][..]));
    // Told again, and of steps before: nothing comes twice.
    node.core.overdue("a", (3, 3.0), node.start);
    node.core.overdue("a", (2, 2.0), node.start);
    assert!(!node.core.has_complete());
    // Both are back.
    assert_eq!([1, 2].map(|rank| node.admit(3, rank).unwrap()), [Admit::Dropped, Admit::Dropped]);
    assert_eq!((node.push(4, 1), node.push(4, 2)), (Some(false), Some(true)));
    assert_eq!(node.core.take_complete(node.start).unwrap().lost_ranks, [0; 0]);
}

#[test]
fn what_the_root_refuses_is_told_each_rank_once() {
    let mut node = member();
    node.core.tell_ranks("a", 2, node.start);
    node.open(RunSpec { members: 2, ..spec(3, FullPolicy::Block) }, 2, "", "a").unwrap();
    assert_eq!((node.push(0, 1), node.push(0, 2)), (Some(false), Some(true)));
    assert_eq!(node.push(1, 1), Some(false));
    node.core.refuse("b", "another run's");
    node.core.refuse("a", "step 0: bricks overlap");
    refused(node.admit(1, 2), Code::InvalidArgument, &["step 0: bricks overlap"]);
    refused(node.admit(2, 1), Code::InvalidArgument, &["step 0: bricks overlap"]);
    assert_eq!(node.next_number(), Some(0));
    assert_eq!(node.core.figures().memory_bytes.0, 0, "bricks of refused steps stay");
    assert_eq!(node.admit(2, 2).unwrap(), Admit::Dropped);
    assert_eq!((node.push(3, 1), node.push(3, 2)), (Some(false), Some(true)));
}

#[test]
fn a_member_goes_over_to_the_run_that_the_root_has_opened_last() {
    let spec = RunSpec { members: 2, ..spec(3, FullPolicy::Block) };
    let mut node = Node::with_room_for(9);
    let join = |node: &mut Node, rank, run: &str| node.core.join(spec.clone(), rank, run, node.start);
    let push = |node: &mut Node, rank: u32| {
        let (z0, nz) = SLABS[rank as usize];
        let offer = offer(0, 0.0, rank, [0, 0, z0], [DIMS[0], DIMS[1], nz]);
        assert_eq!(node.core.admit("b", &offer, node.start).unwrap(), Admit::Granted(slab(rank).len()));
        node.core.receive("b", 0, (rank, 0), slab(rank), node.start).unwrap()
    };
    // The root's word may come after the rank that it sends.
    refused(join(&mut node, 1, "a"), Code::NotFound, &["no run \"a\""]);
    node.core.follow("a");
    assert_eq!((join(&mut node, 1, "a").unwrap(), join(&mut node, 2, "a").unwrap()), ("a".into(), "a".into()));
    node.core.tell_ranks("a", 2, node.start);
    assert_eq!(node.push(0, 1), Some(false));
    // The simulation was killed and started again at once: its ranks were here, and have not left.
    node.core.follow("b");
    assert_eq!(node.core.figures().memory_bytes.0, 0, "bricks of the run before stay");
    refused(node.admit(0, 2), Code::NotFound, &["no run \"a\""]);
    refused(join(&mut node, 2, "a"), Code::NotFound, &["no run \"a\""]);
    assert_eq!((join(&mut node, 1, "b").unwrap(), join(&mut node, 2, "b").unwrap()), ("b".into(), "b".into()));
    node.core.tell_ranks("b", 2, node.start);
    node.core.follow("b");
    assert_eq!((push(&mut node, 1), push(&mut node, 2)), (Some(false), Some(true)));
}
