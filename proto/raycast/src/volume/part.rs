//! The part of a grid that a field holds: a box of cells that are its own, and the sample points stored for them.
//!
//! Where several processes hold one grid, each casts the steps of a ray whose samples lie in its own cells. Steps are counted from
//! the ray's entry into the whole grid, and positions are those of the whole grid, so that every sample is taken once, with the
//! same arithmetic, whoever takes it.

use glam::DVec3;
use lamina_model::{Camera, Grid, Invalid, Scene};
use std::ops::Range;

/// A box of cells of a grid, and of the sample points that are stored for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridPart {
    whole: [usize; 3],
    start: [usize; 3],
    dims: [usize; 3],
    cells: [Range<usize>; 3],
}

impl GridPart {
    /// All of `grid`.
    pub fn whole(grid: &Grid) -> Self {
        let dims = grid.dims();
        Self { whole: dims, start: [0; 3], dims, cells: dims.map(|n| 0..(n - 1).max(1)) }
    }

    /// Layers of points around a box that its samples under `scene` need.
    pub fn ghost_layers(scene: &Scene) -> usize {
        // Shading looks a point further, effects half a step; clipped steps are sampled elsewhere in theirs.
        let beside = 3 + scene.step_voxels.ceil().clamp(1.0, 64.0) as usize;
        if scene.effects.is_none() { 1 } else { beside }
    }

    /// The cells that begin with the sample points of the box of `dims` points from `start` on, stored with `ghost` layers of
    /// points around them, 1 or more. Boxes that make up the grid's points make up its cells. `None` if it has no cell: a box of
    /// the last points alone.
    ///
    /// # Errors
    /// If the box does not lie in `grid`.
    pub fn of_points(grid: &Grid, start: [usize; 3], dims: [usize; 3], ghost: usize) -> Result<Option<Self>, Invalid> {
        let whole = grid.dims();
        if (0..3).any(|a| dims[a] == 0 || start[a].checked_add(dims[a]).is_none_or(|end| end > whole[a])) {
            let reason = format!("{dims:?} sample points from {start:?} do not lie in a grid of {whole:?}");
            return Err(Invalid::new("part", reason));
        }
        let cells = [0, 1, 2].map(|a| start[a]..(start[a] + dims[a]).min((whole[a] - 1).max(1)));
        if cells.iter().any(Range::is_empty) {
            return Ok(None);
        }
        let first = start.map(|s| s.saturating_sub(ghost));
        let end = [0, 1, 2].map(|a| (start[a] + dims[a] + ghost.max(1)).min(whole[a]));
        Ok(Some(Self { whole, start: first, dims: [0, 1, 2].map(|a| end[a] - first[a]), cells }))
    }

    /// Index of the first stored point.
    pub fn start(&self) -> [usize; 3] {
        self.start
    }

    /// Stored points per axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The cells that are its own.
    pub fn cells(&self) -> &[Range<usize>; 3] {
        &self.cells
    }

    /// True if all cells are its own.
    pub fn is_whole(&self) -> bool {
        self.dims == self.whole && self.cells.iter().zip(self.whole).all(|(own, n)| *own == (0..(n - 1).max(1)))
    }

    /// Columns and rows of the rays of a `side` x `side` picture of `camera` that may meet its cells on `grid`.
    pub(crate) fn pixels(&self, grid: &Grid, camera: &Camera, side: u32) -> [Range<u32>; 2] {
        let everything = [0..side, 0..side];
        if self.is_whole() {
            return everything;
        }
        let half = 0.5 * f64::from(side);
        let (mut least, mut most) = ([f64::MAX; 2], [f64::MIN; 2]);
        for n in 0..8 {
            let cell = [0, 1, 2].map(|a| if n >> a & 1 == 0 { self.cells[a].start } else { self.cells[a].end } as f64);
            let seen = camera.view_from_world(grid.origin() + DVec3::from_array(cell) * grid.spacing());
            // An axis with one point is drawn one spacing thick; what is beside the eye may be anywhere.
            if seen.z <= 1e-6 * seen.length() || self.whole.contains(&1) {
                return everything;
            }
            let scale = half / (seen.z * camera.tan_half_fov());
            for (a, place) in [half + scale * seen.x, half - scale * seen.y].into_iter().enumerate() {
                (least[a], most[a]) = (least[a].min(place), most[a].max(place));
            }
        }
        // A pixel more on each side: samples are rounded.
        [0, 1].map(|a| {
            let end = (most[a].ceil() + 1.0).clamp(0.0, f64::from(side)) as u32;
            ((least[a].floor() - 1.0).clamp(0.0, f64::from(end)) as u32)..end
        })
    }

    /// True if the cell around `index` (units of the grid's sample points, clamped into it) is its own.
    pub(crate) fn owns(&self, index: DVec3) -> bool {
        (0..3).all(|a| {
            let last = (self.whole[a] - 1) as f64;
            let cell = (index[a].clamp(0.0, last) as usize).min((self.whole[a] - 1).saturating_sub(1));
            self.cells[a].contains(&cell)
        })
    }

    /// `index`, of the whole grid, counted from the first stored point.
    pub(crate) fn local(&self, index: DVec3) -> DVec3 {
        index - DVec3::from_array(self.start.map(|s| s as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_of_all_points_own_every_cell_once() {
        let grid = Grid::new([5, 4, 9], DVec3::ONE, DVec3::ZERO).unwrap();
        let parts: Vec<GridPart> = [
            ([0, 0, 0], [5, 4, 3]),
            ([0, 0, 3], [2, 4, 5]),
            ([2, 0, 3], [3, 4, 5]),
            // The last plane begins no cell.
            ([0, 0, 8], [5, 4, 1]),
        ]
        .into_iter()
        .filter_map(|(start, dims)| GridPart::of_points(&grid, start, dims, 1).unwrap())
        .collect();
        assert_eq!(parts.len(), 3);
        for n in 0..1000 {
            let index = DVec3::new(f64::from(n % 10) * 0.5, f64::from(n / 10 % 10) * 0.4, f64::from(n / 100) * 0.9);
            assert_eq!(parts.iter().filter(|part| part.owns(index)).count(), 1, "{index}");
        }
        assert_eq!((parts[1].start(), parts[1].dims()), ([0, 0, 2], [3, 4, 7]));
        assert!(!parts[1].is_whole() && GridPart::whole(&grid).is_whole());
        assert!(GridPart::of_points(&grid, [0; 3], [5, 4, 9], 1).unwrap().unwrap().is_whole());
        assert!(GridPart::of_points(&grid, [0, 0, 8], [5, 4, 2], 1).is_err());
        // A grid of one plane is one cell thick.
        let flat = Grid::new([4, 4, 1], DVec3::ONE, DVec3::ZERO).unwrap();
        assert!(GridPart::of_points(&flat, [0; 3], [4, 4, 1], 1).unwrap().unwrap().is_whole());
    }
}
