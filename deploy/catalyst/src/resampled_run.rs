//! A run whose mesh is no lattice: at each step the ranks sample what they have at the points of one, and send each other the values,
//! so that each hands over one slab of it. Collective at every step.

use crate::guard::caught;
use crate::mesh::{Domain, EvenGrid};
use crate::ranks::Ranks;
use crate::resample::{CellLocations, RankSlabs, Slab, sampled};
use lamina_client::{Brick, VoxelSlice};
use lamina_model::Grid;

/// The lattice, and where its points lie in this rank's cells.
#[derive(Debug)]
pub(crate) struct ResampledRun {
    slabs: RankSlabs,
    fields: usize,
    locations: Vec<CellLocations>,
}

impl ResampledRun {
    /// Of `fields` fields; with the grid of the run.
    pub(crate) fn new(lattice: EvenGrid, ranks: u32, fields: usize) -> Result<(Self, Grid), String> {
        let grid = lattice.grid()?;
        Ok((Self { slabs: RankSlabs { lattice, ranks }, fields, locations: Vec::new() }, grid))
    }

    /// Hands the step over. All ranks call it, also those that have nothing to show: theirs is an error, or no domain.
    pub(crate) fn push(
        &mut self,
        ranks: &Ranks,
        step: u64,
        found: Result<(Vec<Domain>, Vec<Vec<Domain>>), String>,
        hand_over: impl FnOnce(&[Brick<'_>]) -> Result<(), String>,
    ) -> Result<(), String> {
        let own = caught(|| {
            let (domains, more) = found?;
            sampled(&domains, &more, &mut self.locations, &self.slabs)
        });
        let nothing = || vec![Vec::new(); ranks.size as usize];
        let (parts, failed) = match own {
            Ok(parts) => (parts, None),
            Err(error) => (nothing(), Some(error)),
        };
        let received = ranks.exchange(step, parts)?;
        let layers = self.slabs.layers(ranks.rank);
        let mut slab = Slab::empty(layers.len() * self.slabs.layer(), self.fields);
        for part in &received {
            slab.take(part);
        }
        let [x, y, _] = self.slabs.lattice.dims;
        let (first, more) = slab.fields.split_first().ok_or("no field")?;
        let more: Vec<VoxelSlice<'_>> = more.iter().map(|values| VoxelSlice::F32(values)).collect();
        let brick = Brick::new([0, 0, layers.start], [x, y, layers.len()], VoxelSlice::F32(first));
        let brick = brick.with_more_fields(&more);
        let bricks: &[Brick<'_>] = if layers.is_empty() { &[] } else { &[brick] };
        hand_over(bricks)?;
        failed.map_or(Ok(()), Err)
    }
}
