//! Ranks with several bricks a step, or none.

use super::*;

/// Rank, index, how many it has, first sample point, dims.
type Part = (u32, u32, u32, [u64; 3], [u64; 3]);

/// Boxes of two ranks that fill the grid of 2 x 3 x 7: three of rank 0, uneven and L-shaped together; two of rank 2; none of rank 1.
const BOXES: [Part; 5] = [
    (0, 0, 3, [0, 0, 0], [2, 3, 2]),
    (0, 1, 3, [0, 0, 2], [1, 3, 5]),
    (0, 2, 3, [1, 0, 2], [1, 1, 5]),
    (2, 0, 2, [1, 1, 2], [1, 2, 1]),
    (2, 1, 2, [1, 1, 3], [1, 2, 4]),
];

fn boxed(step: u64, (rank, index, bricks, start, dims): Part) -> BrickOffer {
    BrickOffer { index, bricks, ..offer(step, 0.0, rank, start, dims) }
}

fn none_of(step: u64, rank: u32) -> BrickOffer {
    BrickOffer { bricks: 0, ..offer(step, 0.0, rank, [0; 3], [0; 3]) }
}

fn bytes_of([x0, y0, z0]: [u64; 3], [nx, ny, nz]: [u64; 3]) -> Vec<u8> {
    let value = |x, y, z| ((z * DIMS[1] + y) * DIMS[0] + x) as u16;
    let rows = (z0..z0 + nz).flat_map(|z| (y0..y0 + ny).map(move |y| (y, z)));
    rows.flat_map(|(y, z)| (x0..x0 + nx).flat_map(move |x| value(x, y, z).to_le_bytes())).collect()
}

impl Node {
    fn push_box(&mut self, step: u64, part: Part) -> Option<bool> {
        let (rank, index, _, start, dims) = part;
        let bytes = bytes_of(start, dims);
        assert_eq!(self.core.admit("a", &boxed(step, part), self.start).unwrap(), Admit::Granted(bytes.len()));
        self.core.receive("a", step, (rank, index), bytes, self.start).unwrap()
    }

    fn say_none(&mut self, step: u64, rank: u32) -> Option<bool> {
        assert_eq!(self.core.admit("a", &none_of(step, rank), self.start).unwrap(), Admit::Granted(0));
        self.core.receive("a", step, (rank, 0), vec![], self.start).unwrap()
    }
}

#[test]
fn several_bricks_of_a_rank_and_none_of_another_make_the_exact_volume() {
    let mut node = Node::serving(9, 3, FullPolicy::Block);
    let expected = Volume::new(spec(1, FullPolicy::Block).grid, Voxels::U16((0..VOXELS as u16).collect())).unwrap();
    // Whoever comes last completes the step: a brick, or who has none.
    for step in [0, 2, 4] {
        assert_eq!(node.say_none(step, 1), Some(false));
        let complete = [3, 0, 4, 1, 2].map(|n| node.push_box(step, BOXES[n]).unwrap());
        assert_eq!(complete, [false, false, false, false, true]);
        let complete = [0, 3, 1, 4, 2].map(|n| node.push_box(step + 1, BOXES[n]).unwrap());
        assert_eq!((complete, node.say_none(step + 1, 1)), ([false; 5], Some(true)));
    }
    for step in 0..6 {
        let complete = node.core.take_complete(Instant::now()).unwrap();
        assert_eq!(complete.step, step);
        assert_eq!(volume_of(complete), expected);
    }
}

#[test]
fn bricks_that_contradict_each_other_are_refused_by_name() {
    let admit = |parts: &[BrickOffer]| {
        let mut node = Node::serving(9, 3, FullPolicy::Block);
        let (last, first) = parts.split_last().unwrap();
        for part in first {
            node.core.admit("a", part, node.start).unwrap();
        }
        node.core.admit("a", last, node.start)
    };
    let all = BOXES.map(|part| boxed(0, part));
    let fewer = BrickOffer { bricks: 2, ..all[1] };
    refused(admit(&[all[0], fewer]), Code::InvalidArgument, &["rank 0 has 2 bricks, where it had 3"]);
    refused(admit(&[all[0], all[0]]), Code::AlreadyExists, &["rank 0"]);
    refused(admit(&[none_of(0, 1), none_of(0, 1)]), Code::AlreadyExists, &["rank 1"]);
    refused(admit(&[BrickOffer { index: 3, ..all[0] }]), Code::InvalidArgument, &["brick 3 of 3"]);
    refused(admit(&[BrickOffer { bricks: 1 << 17, ..all[0] }]), Code::InvalidArgument, &["at most 65536"]);
    refused(admit(&[all[0], BrickOffer { start: [0, 0, 1], ..all[1] }]), Code::InvalidArgument, &["overlap"]);
    let hole = BrickOffer { dims: [1, 2, 3], ..all[4] };
    let covered = format!("cover {} of {VOXELS}", VOXELS - 2);
    refused(admit(&[all[0], all[1], all[2], all[3], none_of(0, 1), hole]), Code::InvalidArgument, &[&covered]);
    // Nobody has anything.
    refused(admit(&[none_of(0, 0), none_of(0, 1), none_of(0, 2)]), Code::InvalidArgument, &["cover 0 of"]);
}

#[test]
fn a_brick_that_never_comes_gives_back_its_own_reservation_alone() {
    let mut node = Node::serving(9, 3, FullPolicy::Block);
    assert_eq!(node.push_box(0, BOXES[0]), Some(false));
    node.core.admit("a", &boxed(0, BOXES[1]), node.start).unwrap();
    node.core.abort("a", 0, (0, 1));
    // It comes after all, and the step is whole.
    assert_eq!(node.push_box(0, BOXES[1]), Some(false));
    let complete = [2, 3, 4].map(|n| node.push_box(0, BOXES[n]).unwrap());
    assert_eq!((complete, node.say_none(0, 1)), ([false; 3], Some(true)));
    // A rank that goes on to the next step with a brick missing gives the step up.
    assert_eq!(node.push_box(1, BOXES[0]), Some(false));
    assert_eq!(node.push_box(2, BOXES[0]), Some(false));
    refused(node.core.admit("a", &boxed(1, BOXES[1]), node.start), Code::InvalidArgument, &["ascend"]);
    assert_eq!(node.core.admit("a", &boxed(1, BOXES[3]), node.start).unwrap(), Admit::Dropped);
}

#[test]
fn a_step_that_finds_no_room_is_dropped_with_all_bricks_of_its_ranks() {
    let mut node = Node::serving(1, 3, FullPolicy::DropNewest);
    let complete = [0, 1, 2, 3, 4].map(|n| node.push_box(0, BOXES[n]).unwrap());
    assert_eq!((complete, node.say_none(0, 1)), ([false; 5], Some(true)));
    for n in [0, 1, 2] {
        assert_eq!(node.core.admit("a", &boxed(1, BOXES[n]), node.start).unwrap(), Admit::Dropped, "brick {n}");
    }
}
