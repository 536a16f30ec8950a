//! What the door makes of what members say of their bricks, and what it tells them.

use super::*;
use crate::group::receive;
use glam::DVec3;
use lamina_model::Grid;
use tokio::sync::mpsc::UnboundedReceiver;

const NONE: Vec<u64> = Vec::new();

/// A door of two members, to each of which one rank of run "a" has come; and what each member hears.
fn two_members(full_policy: FullPolicy) -> (Door, Vec<UnboundedReceiver<MemberEvent>>) {
    let (mut outboxes, events): (Vec<_>, Vec<_>) =
        lamina_mpi::in_process(2).into_iter().map(|(outbox, inbox)| (outbox, receive(inbox).events)).unzip();
    let door = Door::new(outboxes.swap_remove(0));
    *door.members.lock() = vec![Some(v1::GroupReady::default()); 2];
    let grid = Grid::new([4, 4, 6], DVec3::ONE, DVec3::ZERO).unwrap();
    let spec = RunSpec { ranks: 2, full_policy, members: 2, ..RunSpec::of_one_rank("f", grid) };
    (0..2).for_each(|rank| drop(door.assign("a", &spec, rank, "")));
    (door, events)
}

/// Member `member` has the points of its half, planes `first` to `last`, of a step.
fn bring(door: &Door, member: u32, step: u64, (first, last): (u64, u64)) {
    let grid = Grid::new([4, 4, 6], DVec3::ONE, DVec3::ZERO).unwrap();
    let half = GridBox::new([0, 0, first], [4, 4, last - first], &grid).unwrap();
    let boxes = vec![crate::group::convert::box_message(&half)];
    door.arrive(
        member,
        &v1::GroupArrival { run_id: "a".into(), step, boxes, ..Default::default() },
        &Diagnostics::default(),
    );
}

/// The steps that a member is told to let go of.
fn dropped(events: &mut UnboundedReceiver<MemberEvent>) -> Vec<u64> {
    let mut steps = Vec::new();
    // Messages come through a thread of their own.
    let until = Instant::now() + Duration::from_millis(200);
    while Instant::now() < until {
        match events.try_recv() {
            Ok(MemberEvent::Dropped(step)) => steps.push(step.step),
            Ok(_) => {}
            Err(_) => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    steps
}

#[test]
fn members_let_go_of_steps_that_the_root_makes_nothing_of() {
    let (door, mut events) = two_members(FullPolicy::DropOldest);
    // Step 1 is whole and waits; of step 2 member 0 has its half only; step 3 is whole, and the present.
    for step in [1, 2, 3] {
        bring(&door, 0, step, (0, 2));
    }
    bring(&door, 1, 1, (2, 6));
    bring(&door, 1, 3, (2, 6));
    assert_eq!([dropped(&mut events[0]), dropped(&mut events[1])], [vec![2, 1], vec![1]]);
    // Its other half is late.
    bring(&door, 1, 2, (2, 6));
    assert_eq!([dropped(&mut events[0]), dropped(&mut events[1])], [NONE, vec![2]]);
    // The step that is taken is not dropped when the next is whole.
    assert_eq!(door.take().map(|step| (step.step, step.dropped_steps)), Some((3, 2)));
    (0..2).for_each(|member| bring(&door, member, 4, [(0, 2), (2, 6)][member as usize]));
    assert_eq!([dropped(&mut events[0]), dropped(&mut events[1])], [NONE, NONE]);
    assert_eq!(door.take().map(|step| step.step), Some(4));
}

#[test]
fn ranks_of_all_members_push_the_steps_that_the_root_takes() {
    let (door, mut events) = two_members(FullPolicy::DropOldest);
    door.tell_cadence(4);
    let heard = std::iter::from_fn(|| events[1].blocking_recv()).find(|e| matches!(e, MemberEvent::Cadence(_)));
    assert!(matches!(heard, Some(MemberEvent::Cadence(4))), "{heard:?}");
}

#[test]
fn no_step_is_dropped_where_the_simulation_waits() {
    let (door, mut events) = two_members(FullPolicy::Block);
    for (step, member) in (0..10).flat_map(|step| [(step, 0), (step, 1)]) {
        bring(&door, member, step, [(0, 2), (2, 6)][member as usize]);
    }
    assert_eq!([dropped(&mut events[0]), dropped(&mut events[1])], [NONE, NONE]);
    let taken: Vec<u64> = std::iter::from_fn(|| door.take()).map(|step| step.step).collect();
    assert_eq!(taken, (0..10).collect::<Vec<_>>());
}

#[test]
fn bricks_that_overlap_or_leave_a_hole_are_refused_and_let_go_of() {
    for (planes, words) in [((1, 6), "overlap"), ((3, 6), "cover 80 of 96 voxels")] {
        let (door, mut events) = two_members(FullPolicy::Block);
        bring(&door, 0, 0, (0, 2));
        bring(&door, 1, 0, planes);
        let heard: Vec<MemberEvent> = std::iter::from_fn(|| events[1].blocking_recv()).take(4).collect();
        let reason = heard.iter().find_map(|event| match event {
            MemberEvent::Refusal(refusal) => Some(refusal.reason.clone()),
            _ => None,
        });
        assert!(reason.as_ref().is_some_and(|reason| reason.contains(words)), "{heard:?}");
        assert!(matches!(&heard[3], MemberEvent::Dropped(step) if step.step == 0), "{heard:?}");
    }
}
