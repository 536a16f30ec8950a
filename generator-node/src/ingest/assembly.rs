//! One time step while its ranks' bricks arrive.

use super::brick::{BrickBytes, BrickOffer, GridBox};
use super::{IngestError, Remarks};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Debug)]
struct BrickSlot {
    rank: u32,
    index: u32,
    brick: GridBox,
    bytes: Option<BrickBytes>,
}

/// The bricks of one step: reserved when admitted, filled when received.
#[derive(Debug)]
pub(super) struct Assembly {
    /// Simulation time.
    pub time: f64,
    parts: Vec<BrickSlot>,
    /// How many bricks each rank has that has come.
    bricks: BTreeMap<u32, u32>,
    /// What ranks told beside their bricks.
    pub remarks: Remarks,
}

impl Assembly {
    /// An empty step.
    pub(super) fn new(time: f64) -> Self {
        Self { time, parts: Vec::new(), bricks: BTreeMap::new(), remarks: Remarks::default() }
    }

    /// Reserves the offered `brick`, if the rank has any, where it agrees with what is there; `voxels` is the whole grid's number.
    pub(super) fn reserve(
        &mut self,
        offer: &BrickOffer,
        ranks: u32,
        brick: Option<GridBox>,
        voxels: usize,
    ) -> Result<(), IngestError> {
        let BrickOffer { step, time, rank, index, bricks, .. } = *offer;
        if time.to_bits() != self.time.to_bits() {
            let first = self.time;
            return Err(IngestError::Refused(format!("step {step}: rank {rank} says time {time}, others {first}")));
        }
        match self.bricks.get(&rank) {
            Some(&before) if before != bricks => {
                let message = format!("step {step}: rank {rank} has {bricks} bricks, where it had {before}");
                return Err(IngestError::Refused(message));
            }
            Some(_) if bricks == 0 => return Err(IngestError::Repeated { step, rank }),
            _ => {}
        }
        if self.parts.iter().any(|p| (p.rank, p.index) == (rank, index)) {
            return Err(IngestError::Repeated { step, rank });
        }
        let overlapped = brick.and_then(|brick| self.parts.iter().find(|p| p.brick.overlaps(&brick)));
        if let Some(other) = overlapped {
            let message = format!(
                "step {step}: the bricks of ranks {} and {rank} overlap; each voxel belongs to one rank",
                other.rank
            );
            return Err(IngestError::Refused(message));
        }
        let new = usize::from(brick.is_some());
        let expected = self.expected() + if self.bricks.contains_key(&rank) { 0 } else { bricks as usize };
        let all_ranks = self.bricks.len() + usize::from(!self.bricks.contains_key(&rank)) == ranks as usize;
        let covered = self.parts.iter().map(|p| &p.brick).chain(&brick).map(GridBox::voxels).sum::<usize>();
        if all_ranks && self.parts.len() + new == expected && covered != voxels {
            let message = format!("step {step}: the bricks of all {ranks} ranks cover {covered} of {voxels} voxels");
            return Err(IngestError::Refused(message));
        }
        self.bricks.insert(rank, bricks);
        self.parts.extend(brick.map(|brick| BrickSlot { rank, index, brick, bytes: None }));
        Ok(())
    }

    /// Bricks of the ranks that have come.
    fn expected(&self) -> usize {
        self.bricks.values().map(|&n| n as usize).sum()
    }

    /// True if `rank` has reserved all its bricks.
    pub(super) fn has(&self, rank: u32) -> bool {
        let reserved = self.parts.iter().filter(|p| p.rank == rank).count();
        self.bricks.get(&rank).is_some_and(|&bricks| bricks as usize == reserved)
    }

    /// Gives up a reservation of `rank`; true if none is left.
    pub(super) fn release(&mut self, rank: u32, index: u32) -> bool {
        self.parts.retain(|p| (p.rank, p.index) != (rank, index));
        if self.parts.iter().all(|p| p.rank != rank) {
            self.bricks.remove(&rank);
        }
        self.bricks.is_empty()
    }

    /// Stores the bytes of a brick of `rank`.
    pub(super) fn fill(&mut self, rank: u32, index: u32, bytes: BrickBytes) {
        if let Some(part) = self.parts.iter_mut().find(|p| (p.rank, p.index) == (rank, index)) {
            part.bytes = Some(bytes);
        }
    }

    /// True if all bricks of so many ranks are in, but for those of `lost`, which are not waited for.
    pub(super) fn is_complete(&self, ranks: u32, lost: &BTreeSet<u32>) -> bool {
        let waited = self.bricks.iter().filter(|(rank, _)| !lost.contains(rank));
        let (here, expected) = waited.fold((0, 0), |(here, expected), (_, &n)| (here + 1, expected + n as usize));
        let mut parts = self.parts.iter().filter(|p| !lost.contains(&p.rank));
        here + lost.len() == ranks as usize && parts.clone().count() == expected && parts.all(|p| p.bytes.is_some())
    }

    /// Ranks all of whose bricks are in.
    pub(super) fn ranks_in(&self) -> BTreeSet<u32> {
        let mut lacking = self.bricks.clone();
        for part in self.parts.iter().filter(|p| p.bytes.is_some()) {
            lacking.entry(part.rank).and_modify(|n| *n = n.saturating_sub(1));
        }
        lacking.into_iter().filter(|(_, n)| *n == 0).map(|(rank, _)| rank).collect()
    }

    /// The boxes of each rank that has come.
    pub(super) fn boxes(&self) -> BTreeMap<u32, Vec<GridBox>> {
        let boxes = |rank| self.parts.iter().filter(|p| p.rank == rank).map(|p| p.brick).collect();
        self.bricks.keys().map(|&rank| (rank, boxes(rank))).collect()
    }

    /// The bricks with their bytes.
    pub(super) fn into_bricks(self) -> Vec<(GridBox, BrickBytes)> {
        self.parts.into_iter().filter_map(|p| Some((p.brick, p.bytes?))).collect()
    }
}
