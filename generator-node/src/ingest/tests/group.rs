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
