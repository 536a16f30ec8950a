//! Which blocks of a level have residuals at all, one flag a block.
use super::grid::{BLOCK, Grid};
use super::symbols::Models;
use crate::entropy::range_coder::Coder;

/// Flags of one level.
#[derive(Debug)]
pub struct Flags {
    /// Blocks along the axes.
    pub grid: Grid,
    /// Whether each has residuals.
    pub active: Vec<bool>,
}

impl Flags {
    /// None of the blocks of a lattice.
    pub fn none(lattice: Grid) -> Self {
        let grid = lattice.blocks();
        Self { grid, active: vec![false; grid.count()] }
    }

    /// Flags of the blocks with the row of points at `y`, `z`.
    #[inline]
    pub fn row(&self, y: usize, z: usize) -> &[bool] {
        &self.active[self.grid.row(y / BLOCK, z / BLOCK)..][..self.grid.dims[0]]
    }

    /// Likewise, to change them.
    #[inline]
    pub fn row_mut(&mut self, y: usize, z: usize) -> &mut [bool] {
        &mut self.active[self.grid.row(y / BLOCK, z / BLOCK)..][..self.grid.dims[0]]
    }

    /// Codes the flags or reads them; `above` are those of the coarser level, whose blocks are twice as wide.
    pub fn code(&mut self, models: &mut Models, coder: &mut impl Coder, above: Option<&Self>, level: usize) {
        let nx = self.grid.dims[0];
        for (y, z) in self.grid.rows() {
            for x in 0..nx {
                let at = x + self.grid.row(y, z);
                let context = self.context([x, y, z], above) * 2 + usize::from(level == 0);
                self.active[at] = models.flag(coder, context, self.active[at]);
            }
        }
    }

    /// Flags of the three neighbours before, of two beside them, and of the block above.
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
