//! Block flags: one bit per block of points of a level, whether any of its residuals is not zero.
use super::grid::{BLOCK, Lattice};
use super::symbols::VolumeModels;
use crate::entropy::range_coder::Coder;

/// The flags of one level.
#[derive(Debug)]
pub(super) struct BlockFlags {
    /// Number of blocks along x, y, z.
    pub grid: Lattice,
    /// Whether each block has nonzero residuals.
    pub active: Vec<bool>,
}

impl BlockFlags {
    /// Cleared flags for all blocks of a lattice.
    pub(super) fn none(lattice: Lattice) -> Self {
        let grid = lattice.blocks();
        Self { grid, active: vec![false; grid.count()] }
    }

    /// Flags of the blocks along the row of points at `y`, `z` of a class.
    #[inline]
    pub(super) fn row(&self, y: usize, z: usize) -> &[bool] {
        &self.active[self.grid.row(y / BLOCK, z / BLOCK)..][..self.grid.dims[0]]
    }

    /// The same flags, mutable.
    #[inline]
    pub(super) fn row_mut(&mut self, y: usize, z: usize) -> &mut [bool] {
        &mut self.active[self.grid.row(y / BLOCK, z / BLOCK)..][..self.grid.dims[0]]
    }

    /// Codes the flags, or reads them. `above` are those of the next coarser level, whose blocks are twice as wide.
    pub(super) fn code(
        &mut self,
        models: &mut VolumeModels,
        coder: &mut impl Coder,
        above: Option<&Self>,
        level: usize,
    ) {
        let nx = self.grid.dims[0];
        for (y, z) in self.grid.rows() {
            for x in 0..nx {
                let at = x + self.grid.row(y, z);
                let context = self.context([x, y, z], above) * 2 + usize::from(level == 0);
                self.active[at] = models.flag(coder, context, self.active[at]);
            }
        }
    }

    /// Context of a flag: those of five neighboring blocks already coded, and of the coarser block that contains it.
    fn context(&self, [x, y, z]: [usize; 3], above: Option<&Self>) -> usize {
        let here = |x, y, z| usize::from(self.active[x + self.grid.row(y, z)]);
        let before = [
            if x > 0 { here(x - 1, y, z) } else { 0 },
            if y > 0 { here(x, y - 1, z) } else { 0 },
            if z > 0 { here(x, y, z - 1) } else { 0 },
            if y > 0 && x + 1 < self.grid.dims[0] { here(x + 1, y - 1, z) } else { 0 },
            if z > 0 && y + 1 < self.grid.dims[1] { here(x, y + 1, z - 1) } else { 0 },
        ];
        let parent = above.map_or(1, |a| usize::from(a.active[x / 2 + a.grid.row(y / 2, z / 2)]));
        before.into_iter().fold(parent, |c, f| c * 2 + f)
    }
}
