//! Ranks that fall silent: the others' steps are shown with a hole where theirs would be.

use super::*;

const LONG: Duration = Duration::from_secs(6);

/// Three ranks, of which the second brings step 0 and no more; the others bring step 1.
fn without_the_second(policy: FullPolicy) -> Node {
    let mut node = Node::serving(9, 3, policy);
    node.push_slabs(0);
    assert_eq!(node.next_number(), Some(0));
    assert_eq!((node.push(1, 0), node.push(1, 2)), (Some(false), Some(false)));
    node
}

#[test]
fn steps_without_a_silent_rank_are_whole_but_for_a_hole() {
    for policy in [FullPolicy::Block, FullPolicy::DropNewest] {
        let mut node = without_the_second(policy);
        assert_eq!((node.push(2, 0), node.push(2, 2)), (Some(false), Some(false)));
        assert!(!node.core.has_complete(), "it may be late");
        node.start += LONG;
        node.core.give_up_lost("a", node.start);
        for step in [1, 2] {
            let complete = node.core.take_complete(node.start).unwrap();
            assert_eq!((complete.step, &complete.lost_ranks[..], complete.dropped_steps), (step, &[1][..], 0));
            let volume = volume_of(complete);
            let Voxels::F32(values) = volume.voxels() else { panic!("a hole in integers") };
            let plane = (DIMS[0] * DIMS[1]) as usize;
            for (n, value) in values.iter().enumerate() {
                let lost = n / plane == 3;
                assert!(if lost { value.is_nan() } else { *value == n as f32 }, "voxel {n}: {value}");
            }
        }
        // From now on it is not waited for.
        assert_eq!((node.push(3, 0), node.push(3, 2)), (Some(false), Some(true)));
        assert_eq!(node.core.take_complete(node.start).unwrap().lost_ranks, [1]);
        // It comes back: what went without it stays so, and the next step is whole.
        assert_eq!(node.admit(2, 1).unwrap(), Admit::Dropped);
        node.push_slabs(4);
        let complete = node.core.take_complete(node.start).unwrap();
        assert_eq!((complete.step, complete.lost_ranks.len()), (4, 0));
    }
}

#[test]
fn a_silent_rank_is_waited_for_while_others_are_not_past_it_or_have_not_come() {
    let mut node = without_the_second(FullPolicy::Block);
    node.start += 100 * LONG;
    node.core.give_up_lost("a", node.start);
    // Rank 2 may wait for what rank 1 computes.
    assert_eq!(node.push(2, 0), Some(false));
    assert!(!node.core.has_complete());
    assert_eq!(node.push(2, 2), Some(true));
    assert_eq!([node.next_number(), node.next_number()], [Some(1), Some(2)]);

    let mut node = Node::with_room_for(9);
    for rank in [0, 2] {
        node.open(spec(3, FullPolicy::Block), rank, "", "a").unwrap();
    }
    for step in 0..3 {
        assert_eq!((node.push(step, 0), node.push(step, 2)), (Some(false), Some(false)));
    }
    node.start += LONG;
    node.core.give_up_lost("a", node.start);
    assert!(!node.core.has_complete(), "ranks may start far apart");
}

#[test]
fn a_brick_that_was_begun_and_never_came_is_part_of_the_hole() {
    let mut node = without_the_second(FullPolicy::Block);
    assert_eq!(node.admit(1, 1).unwrap(), Admit::Granted(slab(1).len()));
    assert_eq!((node.push(2, 0), node.push(2, 2)), (Some(false), Some(false)));
    node.start += LONG;
    node.core.give_up_lost("a", node.start);
    assert_eq!(node.core.take_complete(node.start).unwrap().lost_ranks, [1]);
    assert_eq!(node.receive(1, 1, slab(1)), None, "its step has gone");
}
