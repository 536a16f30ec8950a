//! The way of a line through the VDI's pixels: a 2-D DDA over tiles, and over the pixels of those that may hold something.
//!
//! The boundary at column k is met at mu = (k - column(0)) / change. That number is the same whichever level computes it,
//! and it and the depths grow monotonely also as rounded. So skipping a tile skips exactly the pixels whose masks would
//! have said the same: what is visited, and with which ends, does not depend on the tiles.

use super::index::{Index, SHIFTS};
use super::line::{Line, Point};
use std::ops::ControlFlow::{self, Break, Continue};

/// A place in the grid of tiles of one level, and where the line leaves it.
struct Cells<'a> {
    line: &'a Line,
    shift: u32,
    cell: [i32; 2],
    /// mu at the next boundary, per axis.
    next: [f64; 2],
}

impl<'a> Cells<'a> {
    /// The tile at `mu`, between tiles `lo` and `hi`. A boundary met at `mu` itself is passed.
    #[inline(always)]
    fn new(line: &'a Line, level: usize, mu: f64, lo: [i32; 2], hi: [i32; 2]) -> Self {
        let mut cells = Self { line, shift: SHIFTS[level], cell: [0; 2], next: [0.0; 2] };
        for axis in 0..2 {
            let place = (line.start[axis] + line.change[axis] * mu) as i32 >> cells.shift;
            cells.cell[axis] = place.max(lo[axis]).min(hi[axis]);
            cells.next[axis] = cells.leaves(axis, cells.cell[axis]);
            // Rounding of the place: what counts is the order of the boundaries' mu.
            let (step, last) = if line.forward(axis) { (1, hi[axis]) } else { (-1, lo[axis]) };
            let first = if line.forward(axis) { lo[axis] } else { hi[axis] };
            while cells.next[axis] <= mu && cells.cell[axis] != last {
                cells.advance(axis);
            }
            while cells.cell[axis] != first && cells.leaves(axis, cells.cell[axis] - step) > mu {
                cells.cell[axis] -= step;
                cells.next[axis] = cells.leaves(axis, cells.cell[axis]);
            }
        }
        cells
    }

    /// mu at which the line leaves column or row `cell`.
    #[inline(always)]
    fn leaves(&self, axis: usize, cell: i32) -> f64 {
        let boundary = (cell + i32::from(self.line.forward(axis))) << self.shift;
        (f64::from(boundary) - self.line.start[axis]) * self.line.per_change[axis]
    }

    #[inline(always)]
    fn advance(&mut self, axis: usize) {
        self.cell[axis] += if self.line.forward(axis) { 1 } else { -1 };
        self.next[axis] = self.leaves(axis, self.cell[axis]);
    }
}

impl Line {
    #[inline(always)]
    fn forward(&self, axis: usize) -> bool {
        self.change[axis] >= 0.0
    }
}

/// Visits, in order, the pixels in which `line` may meet something, with the points where it enters and leaves each, until
/// `visit` breaks. Pixels are numbered row by row in the occupied rectangle.
#[inline]
pub fn walk(index: &Index, line: &Line, mut visit: impl FnMut(usize, Point, Point) -> ControlFlow<()>) -> ControlFlow<()> {
    let all = index.size.map(|n| (n as i32 - 1) >> SHIFTS[2]);
    through(index, line, 2, line.at(0.0), line.at(1.0), [0, 0], all, |tile, from, to| {
        let (lo, hi) = children(index, 2, tile);
        through(index, line, 1, from, to, lo, hi, |tile, from, to| {
            let (lo, hi) = children(index, 1, tile);
            through(index, line, 0, from, to, lo, hi, |[i, j], from, to| {
                visit(j as usize * index.size[0] as usize + i as usize, from, to)
            })
        })
    })
}

/// First and last tile of the next finer level inside `tile`.
#[inline(always)]
fn children(index: &Index, level: usize, tile: [i32; 2]) -> ([i32; 2], [i32; 2]) {
    let (shift, finer) = (SHIFTS[level] - SHIFTS[level - 1], SHIFTS[level - 1]);
    let last = index.size.map(|n| (n as i32 - 1) >> finer);
    let hi = [0, 1].map(|axis| (((tile[axis] + 1) << shift) - 1).min(last[axis]));
    (tile.map(|k| k << shift), hi)
}

/// Visits the tiles of one level between two points that hold something at the line's depths.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn through(
    index: &Index,
    line: &Line,
    level: usize,
    mut from: Point,
    end: Point,
    lo: [i32; 2],
    hi: [i32; 2],
    mut visit: impl FnMut([i32; 2], Point, Point) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let width = ((index.size[0] - 1) >> SHIFTS[level]) as usize + 1;
    let mut cells = Cells::new(line, level, from.mu, lo, hi);
    loop {
        let axis = usize::from(cells.next[1] < cells.next[0]);
        let mu = cells.next[axis];
        let at_end = mu >= end.mu;
        let to = if at_end { end } else { line.at(mu) };
        if to.mu > from.mu {
            let mask = index.masks[level][cells.cell[1] as usize * width + cells.cell[0] as usize];
            if mask & index.slabs.between(from, to) != 0 && visit(cells.cell, from, to).is_break() {
                return Break(());
            }
        }
        if at_end {
            return Continue(());
        }
        from = to;
        cells.advance(axis);
    }
}
