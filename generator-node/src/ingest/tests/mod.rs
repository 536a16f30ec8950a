//! The ingest state machine, held to its promises: admission before bytes, a bound on memory, one run of agreeing ranks.

mod bricks;
mod fields;
mod group;
mod lost;
mod runs;

use super::{Admit, BrickOffer, CompleteStep, Core, IngestError, RunSpec};
use glam::DVec3;
use lamina_model::{FullPolicy, Grid, Volume, VoxelType, Voxels};
use std::time::{Duration, Instant};
use tonic::{Code, Status};

/// Uneven on purpose: three ranks own slabs of 3, 1 and 3 planes.
const DIMS: [u64; 3] = [2, 3, 7];
const SLABS: [(u64, u64); 3] = [(0, 3), (3, 1), (4, 3)];
const VOXELS: u64 = DIMS[0] * DIMS[1] * DIMS[2];
const STEP_BYTES: u64 = 2 * VOXELS;
const WORKING_BYTES: u64 = 2 * STEP_BYTES + 12 * VOXELS;
const IDLE: Duration = Duration::from_secs(30);

fn spec(ranks: u32, full_policy: FullPolicy) -> RunSpec {
    let grid = Grid::new(DIMS.map(|d| d as usize), DVec3::ONE, DVec3::ZERO).unwrap();
    let (name, voxel_type) = ("blast".into(), VoxelType::U16);
    RunSpec { name, voxel_type, ranks, full_policy, ..RunSpec::of_one_rank("density", grid) }
}

/// What the run shows of a step.
fn volume_of(step: CompleteStep) -> Volume {
    let shown = step.spec.shown_fields(step.spec.shown(), step.spec.scene.as_ref()).unwrap();
    step.into_volume(&shown).unwrap().0
}

/// A node with room for `waiting` steps, and the time of the test's start.
struct Node {
    core: Core,
    start: Instant,
}

impl Node {
    fn with_room_for(waiting: u64) -> Self {
        Self { core: Core::new(WORKING_BYTES + waiting * STEP_BYTES, 9, IDLE), start: Instant::now() }
    }

    /// The same with a run "a" that all `ranks` have opened.
    fn serving(waiting: u64, ranks: u32, policy: FullPolicy) -> Self {
        let mut node = Self::with_room_for(waiting);
        for rank in 0..ranks {
            assert_eq!(node.open(spec(ranks, policy), rank, "", "a").unwrap(), "a");
        }
        node
    }

    fn open(&mut self, spec: RunSpec, rank: u32, resume: &str, fresh: &str) -> Result<String, IngestError> {
        self.core.open(spec, rank, resume, fresh.into(), self.start)
    }

    fn admit_box(&mut self, step: u64, rank: u32, z0: u64, nz: u64) -> Result<Admit, IngestError> {
        self.core.admit("a", &offer(step, step as f64, rank, [0, 0, z0], [DIMS[0], DIMS[1], nz]), self.start)
    }

    /// Asks for a rank's own slab of three.
    fn admit(&mut self, step: u64, rank: u32) -> Result<Admit, IngestError> {
        let (z0, nz) = SLABS[rank as usize];
        self.admit_box(step, rank, z0, nz)
    }

    /// Asks for the whole grid, as the only rank.
    fn admit_whole(&mut self, step: u64) -> Result<Admit, IngestError> {
        self.admit_box(step, 0, 0, DIMS[2])
    }

    fn receive(&mut self, step: u64, rank: u32, bytes: Vec<u8>) -> Option<bool> {
        self.core.receive("a", step, (rank, 0), bytes, self.start).unwrap()
    }

    /// Admission and bytes of a rank's slab.
    fn push(&mut self, step: u64, rank: u32) -> Option<bool> {
        let granted = self.admit(step, rank).unwrap();
        assert_eq!(granted, Admit::Granted(slab(rank).len()));
        self.receive(step, rank, slab(rank))
    }

    fn push_slabs(&mut self, step: u64) {
        let complete = [0, 1, 2].map(|rank| self.push(step, rank).unwrap());
        assert_eq!(complete, [false, false, true]);
    }

    fn push_whole(&mut self, step: u64) {
        assert_eq!(self.admit_whole(step).unwrap(), Admit::Granted(STEP_BYTES as usize));
        assert_eq!(self.receive(step, 0, values(0, DIMS[2])), Some(true));
    }

    fn next_number(&mut self) -> Option<u64> {
        self.core.take_complete(Instant::now()).map(|complete| complete.step)
    }
}

fn offer(step: u64, time: f64, rank: u32, start: [u64; 3], dims: [u64; 3]) -> BrickOffer {
    BrickOffer { step, time, rank, index: 0, bricks: 1, start, dims }
}

/// Planes `z0..z0 + nz` of a field whose value is the voxel's own index.
fn values(z0: u64, nz: u64) -> Vec<u8> {
    let plane = DIMS[0] * DIMS[1];
    (z0 * plane..(z0 + nz) * plane).flat_map(|i| (i as u16).to_le_bytes()).collect()
}

fn slab(rank: u32) -> Vec<u8> {
    let (z0, nz) = SLABS[rank as usize];
    values(z0, nz)
}

fn refused<T: std::fmt::Debug>(result: Result<T, IngestError>, code: Code, words: &[&str]) {
    let status = Status::from(result.unwrap_err());
    assert_eq!(status.code(), code, "{status}");
    for word in words {
        assert!(status.message().contains(word), "\"{}\" does not say \"{word}\"", status.message());
    }
}

#[test]
fn three_uneven_slabs_in_any_order_make_the_exact_volume() {
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    assert_eq!(node.push(0, 2), Some(false));
    assert_eq!(node.push(0, 0), Some(false));
    assert_eq!(node.push(0, 1), Some(true));
    let complete: CompleteStep = node.core.take_complete(Instant::now()).unwrap();
    assert_eq!((complete.step, complete.time, complete.run_id.as_str()), (0, 0.0, "a"));
    let expected = Voxels::U16((0..VOXELS as u16).collect());
    assert_eq!(volume_of(complete), Volume::new(spec(1, FullPolicy::Block).grid, expected).unwrap());
}

#[test]
fn slabs_of_two_fields_make_both_and_count_for_both() {
    let two = |ranks| RunSpec { color_field: Some(("heat".into(), VoxelType::F32)), ..spec(ranks, FullPolicy::Block) };
    let (step, working) = (6 * VOXELS, 2 * 6 * VOXELS + 24 * VOXELS);
    let short = Core::new(step + working - 1, 9, IDLE).open(two(3), 0, "", "a".into(), Instant::now());
    assert!(matches!(short, Err(IngestError::Exhausted { .. })));
    let mut node = Node { core: Core::new(step + working, 9, IDLE), start: Instant::now() };
    let mut complete = None;
    for rank in 0..3 {
        node.open(two(3), rank, "", "a").unwrap();
    }
    let heat = |n: u64| n as f32 * 0.5 - 3.0;
    for rank in [1, 0, 2] {
        let (z0, nz) = SLABS[rank as usize];
        let plane = DIMS[0] * DIMS[1];
        let bytes: Vec<u8> =
            slab(rank).into_iter().chain((z0 * plane..(z0 + nz) * plane).flat_map(|n| heat(n).to_le_bytes())).collect();
        assert_eq!(node.admit(0, rank).unwrap(), Admit::Granted(bytes.len()));
        complete = node.receive(0, rank, bytes);
    }
    assert_eq!(complete, Some(true));
    let volume = volume_of(node.core.take_complete(Instant::now()).unwrap());
    assert_eq!(volume.voxels(), &Voxels::U16((0..VOXELS as u16).collect()));
    assert_eq!(volume.color_field(), Some(("heat", &Voxels::F32((0..VOXELS).map(heat).collect()))));
    assert!(matches!(node.admit(1, 0), Ok(Admit::Granted(_))), "its memory is free again");
}

#[test]
fn admission_counts_a_whole_step_before_a_byte_is_there() {
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    assert_eq!(node.admit(0, 1).unwrap(), Admit::Granted(slab(1).len()));
    assert_eq!(node.admit(0, 0).unwrap(), Admit::Granted(slab(0).len()), "the step's memory is reserved once");
    node.receive(0, 1, slab(1));
    assert_eq!(node.admit(1, 1).unwrap(), Admit::Wait);
}

#[test]
fn block_waits_until_a_step_is_taken_and_drops_nothing() {
    let mut node = Node::serving(2, 1, FullPolicy::Block);
    node.push_whole(0);
    node.push_whole(1);
    assert_eq!(node.admit_whole(2).unwrap(), Admit::Wait);
    assert_eq!(node.next_number(), Some(0));
    node.push_whole(2);
    assert_eq!(node.admit_whole(3).unwrap(), Admit::Wait);
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 0);
}

#[test]
fn drop_newest_keeps_what_waits_and_counts() {
    let mut node = Node::serving(2, 1, FullPolicy::DropNewest);
    node.push_whole(0);
    node.push_whole(1);
    assert_eq!(node.admit_whole(2).unwrap(), Admit::Dropped);
    assert_eq!(node.admit_whole(3).unwrap(), Admit::Dropped);
    assert_eq!((node.next_number(), node.next_number(), node.next_number()), (Some(0), Some(1), None));
    node.push_whole(4);
    assert_eq!(node.core.take_complete(Instant::now()).unwrap().dropped_steps, 2);
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 2);
}

#[test]
fn drop_oldest_keeps_the_newest_within_the_bound_and_counts() {
    let mut node = Node::serving(2, 1, FullPolicy::DropOldest);
    (0..10).for_each(|step| node.push_whole(step));
    assert_eq!((node.next_number(), node.next_number(), node.next_number()), (Some(8), Some(9), None));
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 8);
}

#[test]
fn steps_that_have_waited_long_are_passed_over_for_the_newest_where_the_oldest_are_dropped() {
    for (policy, taken, dropped) in [(FullPolicy::DropOldest, 4, 4), (FullPolicy::Block, 0, 0)] {
        let mut node = Node::serving(9, 1, policy);
        (0..5).for_each(|step| node.push_whole(step));
        let step = node.core.take_complete(node.start + Duration::from_secs(2)).unwrap();
        assert_eq!((step.step, step.dropped_steps), (taken, dropped));
    }
}

#[test]
fn no_more_steps_wait_than_viewers_may_be_behind() {
    let mut node = Node::serving(99, 1, FullPolicy::DropOldest);
    (0..12).for_each(|step| node.push_whole(step));
    assert_eq!(std::iter::from_fn(|| node.next_number()).collect::<Vec<_>>(), (3..12).collect::<Vec<_>>());
    let mut node = Node::serving(99, 3, FullPolicy::DropOldest);
    for (step, rank) in [0, 1, 2].into_iter().flat_map(|rank| (0..12).map(move |step| (step, rank))) {
        node.push(step, rank);
    }
    assert_eq!(std::iter::from_fn(|| node.next_number()).count(), 9, "a rank was twelve steps behind");
    let mut node = Node::serving(99, 1, FullPolicy::Block);
    (0..9).for_each(|step| node.push_whole(step));
    assert_eq!(node.admit_whole(9).unwrap(), Admit::Wait);
}

#[test]
fn a_byte_less_than_needed_is_a_step_less() {
    for policy in [FullPolicy::Block, FullPolicy::DropNewest] {
        let mut node = Node { core: Core::new(WORKING_BYTES + 2 * STEP_BYTES - 1, 9, IDLE), start: Instant::now() };
        node.open(spec(1, policy), 0, "", "a").unwrap();
        node.push_whole(0);
        assert!(matches!(node.admit_whole(1).unwrap(), Admit::Wait | Admit::Dropped));
    }
}

#[test]
fn what_one_rank_saw_dropped_is_dropped_for_all_and_counted_once() {
    let mut node = Node::serving(1, 3, FullPolicy::DropNewest);
    node.push(0, 0);
    assert_eq!(node.admit(1, 0).unwrap(), Admit::Dropped);
    node.push(0, 1);
    node.push(0, 2);
    assert_eq!(node.next_number(), Some(0), "room again");
    assert_eq!(node.admit(1, 1).unwrap(), Admit::Dropped);
    assert_eq!(node.admit(1, 2).unwrap(), Admit::Dropped);
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 1);
}

#[test]
fn bytes_of_a_step_evicted_meanwhile_are_answered_as_dropped() {
    let mut node = Node::serving(1, 3, FullPolicy::DropOldest);
    assert!(matches!(node.admit(0, 1).unwrap(), Admit::Granted(_)));
    node.push(0, 0);
    assert_eq!(node.push(1, 0), Some(false), "step 0 made room");
    assert_eq!(node.receive(0, 1, slab(1)), None);
    assert_eq!(node.admit(0, 2).unwrap(), Admit::Dropped);
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 1);
}

#[test]
fn a_rank_far_behind_evicts_nothing_and_its_drops_are_counted_once() {
    let mut node = Node::serving(1, 3, FullPolicy::DropOldest);
    const FAR: u64 = 3000;
    (0..=FAR).for_each(|step| assert_eq!(node.push(step, 0), Some(false)));
    for rank in 1..3 {
        (0..FAR).for_each(|step| assert_eq!(node.admit(step, rank).unwrap(), Admit::Dropped));
    }
    assert_eq!((node.push(FAR, 1), node.push(FAR, 2)), (Some(false), Some(true)));
    assert_eq!(node.core.take_complete(Instant::now()).unwrap().dropped_steps, FAR);
}

#[test]
fn a_grid_larger_than_memory_is_refused_at_open() {
    let mut node = Node { core: Core::new(WORKING_BYTES + STEP_BYTES - 1, 9, IDLE), start: Instant::now() };
    let need = (WORKING_BYTES + STEP_BYTES).to_string();
    let opened = node.open(spec(1, FullPolicy::Block), 0, "", "a");
    refused(opened, Code::ResourceExhausted, &["memory_bytes", &need, "[2, 3, 7]"]);
}

#[test]
fn overlap_missing_coverage_and_disagreement_name_the_ranks() {
    let mut node = Node::serving(9, 3, FullPolicy::Block);
    node.push(0, 0);
    refused(node.admit_box(0, 1, 2, 2), Code::InvalidArgument, &["step 0", "ranks 0 and 1 overlap"]);
    node.push(1, 0);
    node.push(1, 1);
    refused(node.admit_box(1, 2, 5, 2), Code::InvalidArgument, &["step 1", "3 ranks", "36 of 42 voxels"]);
    node.push(2, 0);
    let late = node.core.admit("a", &offer(2, 2.5, 1, [0, 0, 3], [2, 3, 1]), node.start);
    refused(late, Code::InvalidArgument, &["rank 1", "2.5", "others 2"]);
    assert_eq!(node.admit(2, 2).unwrap(), Admit::Dropped, "a step in dispute is given up by all");
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 3);
}

#[test]
fn a_rank_that_describes_the_run_differently_is_named() {
    let mut node = Node::with_room_for(1);
    node.open(spec(3, FullPolicy::Block), 0, "", "a").unwrap();
    let mut other = spec(3, FullPolicy::Block);
    other.voxel_type = VoxelType::U8;
    refused(node.open(other, 2, "", "b"), Code::FailedPrecondition, &["blast", "rank 2", "type"]);
    let policy = node.open(spec(3, FullPolicy::DropNewest), 1, "", "b");
    refused(policy, Code::FailedPrecondition, &["rank 1", "policy"]);
}

#[test]
fn steps_ascend_within_a_rank() {
    let mut node = Node::serving(9, 1, FullPolicy::Block);
    node.push_whole(5);
    refused(node.admit_whole(5), Code::InvalidArgument, &["rank 0", "step 5 after step 5"]);
    refused(node.admit_whole(4), Code::InvalidArgument, &["rank 0", "step 4 after step 5"]);
    node.push_whole(u64::MAX);
}

#[test]
fn a_second_push_while_the_first_is_under_way_harms_nothing() {
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    assert!(matches!(node.admit(0, 0).unwrap(), Admit::Granted(_)));
    refused(node.admit(0, 0), Code::AlreadyExists, &["step 0", "rank 0", "twice"]);
    assert_eq!(node.receive(0, 0, slab(0)), Some(false));
    assert_eq!((node.push(0, 1), node.push(0, 2)), (Some(false), Some(true)));
}

#[test]
fn times_ranks_boxes_and_runs_that_cannot_be_are_refused_and_cost_nothing() {
    let mut node = Node::serving(1, 1, FullPolicy::Block);
    let whole = |node: &mut Node, run: &str, time: f64, rank: u32, z0: u64| {
        node.core.admit(run, &offer(0, time, rank, [0, 0, z0], DIMS), node.start)
    };
    refused(whole(&mut node, "a", f64::NAN, 0, 0), Code::InvalidArgument, &["time NaN", "finite"]);
    refused(whole(&mut node, "a", f64::INFINITY, 0, 0), Code::InvalidArgument, &["time inf"]);
    refused(whole(&mut node, "a", 0.0, 1, 0), Code::InvalidArgument, &["rank 1", "1 ranks"]);
    refused(whole(&mut node, "a", 0.0, 0, 1), Code::InvalidArgument, &["brick", "[2, 3, 7]"]);
    refused(whole(&mut node, "a", 0.0, 0, u64::MAX), Code::InvalidArgument, &["brick"]);
    refused(whole(&mut node, "b", 0.0, 0, 0), Code::NotFound, &["\"b\"", "open it again"]);
    refused(node.admit_box(0, 0, 0, 0), Code::InvalidArgument, &["brick"]);
    node.push_whole(0);
}

#[test]
fn run_descriptions_that_cannot_be_are_refused() {
    let mut node = Node::with_room_for(1);
    let none = node.open(spec(0, FullPolicy::Block), 0, "", "a");
    refused(none, Code::InvalidArgument, &["rank 0 of 0"]);
    refused(node.open(spec(3, FullPolicy::Block), 3, "", "a"), Code::InvalidArgument, &["rank 3 of 3"]);
    let nameless = RunSpec { name: String::new(), ..spec(1, FullPolicy::Block) };
    refused(node.open(nameless, 0, "", "a"), Code::InvalidArgument, &["name"]);
}

#[test]
fn an_aborted_upload_frees_its_memory_and_may_be_repeated() {
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    assert!(matches!(node.admit(0, 0).unwrap(), Admit::Granted(_)));
    node.core.abort("a", 0, (0, 0));
    assert!(matches!(node.admit(1, 1).unwrap(), Admit::Granted(_)), "the aborted step's memory is free");
    node.core.abort("a", 1, (1, 0));
    assert_eq!(node.push(0, 0), Some(false));
    assert!(matches!(node.admit(0, 1).unwrap(), Admit::Granted(_)));
    node.core.abort("a", 0, (1, 0));
    assert_eq!((node.push(0, 1), node.push(0, 2)), (Some(false), Some(true)), "rank 0's brick outlived the abort");
    assert_eq!(node.core.close("a", 0, node.start).unwrap(), 0);
}

#[test]
fn a_step_a_rank_lost_goes_when_a_newer_one_completes() {
    let mut node = Node::serving(2, 3, FullPolicy::Block);
    node.push(0, 0);
    node.push(0, 1);
    assert_eq!((node.push(1, 0), node.push(1, 1), node.push(1, 2)), (Some(false), Some(false), Some(true)));
    let complete = node.core.take_complete(Instant::now()).unwrap();
    assert_eq!((complete.step, complete.dropped_steps), (1, 1));
    assert!(matches!(node.admit(2, 0).unwrap(), Admit::Granted(_)));
    node.receive(2, 0, slab(0));
    assert!(matches!(node.admit(3, 0).unwrap(), Admit::Granted(_)), "both steps' memory is free again");
}

#[test]
fn a_step_a_rank_lost_does_not_block_the_next_one_for_ever() {
    let mut node = Node::serving(1, 3, FullPolicy::Block);
    node.push(0, 0);
    assert_eq!(node.admit(1, 0).unwrap(), Admit::Wait);
    assert_eq!(node.push(1, 2), Some(false), "rank 2 went past step 0, which therefore cannot complete");
    assert_eq!(node.admit(0, 1).unwrap(), Admit::Dropped);
    assert_eq!((node.push(1, 0), node.push(1, 1)), (Some(false), Some(true)));
    assert_eq!(node.core.take_complete(Instant::now()).unwrap().dropped_steps, 1);
}
