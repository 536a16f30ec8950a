//! One time step while its ranks' bricks arrive.

use super::IngestError;
use super::brick::{BrickBytes, BrickOffer, GridBox};

#[derive(Debug)]
struct BrickSlot {
    rank: u32,
    brick: GridBox,
    bytes: Option<BrickBytes>,
}

/// The bricks of one step: reserved when admitted, filled when received.
#[derive(Debug)]
pub(super) struct Assembly {
    /// Simulation time.
    pub time: f64,
    parts: Vec<BrickSlot>,
}

impl Assembly {
    /// An empty step.
    pub(super) fn new(time: f64) -> Self {
        Self { time, parts: Vec::new() }
    }

    /// Reserves the offered `brick` for its rank if it agrees with what is there; `voxels` is the whole grid's number.
    pub(super) fn reserve(
        &mut self,
        offer: &BrickOffer,
        ranks: u32,
        brick: GridBox,
        voxels: usize,
    ) -> Result<(), IngestError> {
        let BrickOffer { step, time, rank, .. } = *offer;
        if time.to_bits() != self.time.to_bits() {
            let first = self.time;
            return Err(IngestError::Refused(format!("step {step}: rank {rank} says time {time}, others {first}")));
        }
        if self.has(rank) {
            return Err(IngestError::Repeated { step, rank });
        }
        if let Some(other) = self.parts.iter().find(|p| p.brick.overlaps(&brick)) {
            let message = format!(
                "step {step}: the bricks of ranks {} and {rank} overlap; each voxel belongs to one rank",
                other.rank
            );
            return Err(IngestError::Refused(message));
        }
        let covered: usize = self.parts.iter().map(|p| p.brick.voxels()).sum::<usize>() + brick.voxels();
        if self.parts.len() + 1 == ranks as usize && covered != voxels {
            let message = format!("step {step}: the bricks of all {ranks} ranks cover {covered} of {voxels} voxels");
            return Err(IngestError::Refused(message));
        }
        self.parts.push(BrickSlot { rank, brick, bytes: None });
        Ok(())
    }

    /// True if `rank` has reserved its part.
    pub(super) fn has(&self, rank: u32) -> bool {
        self.parts.iter().any(|p| p.rank == rank)
    }

    /// Gives up `rank`'s reservation; true if none is left.
    pub(super) fn release(&mut self, rank: u32) -> bool {
        self.parts.retain(|p| p.rank != rank);
        self.parts.is_empty()
    }

    /// Stores `rank`'s bytes; true if all `ranks` are in.
    pub(super) fn fill(&mut self, rank: u32, ranks: u32, bytes: BrickBytes) -> bool {
        if let Some(part) = self.parts.iter_mut().find(|p| p.rank == rank) {
            part.bytes = Some(bytes);
        }
        self.parts.len() == ranks as usize && self.parts.iter().all(|p| p.bytes.is_some())
    }

    /// The bricks with their bytes.
    pub(super) fn into_bricks(self) -> Vec<(GridBox, BrickBytes)> {
        self.parts.into_iter().filter_map(|p| Some((p.brick, p.bytes?))).collect()
    }
}
