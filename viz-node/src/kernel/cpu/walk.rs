//! The way of a line through the VDI's pixels: a 2-D DDA over tiles, and over the pixels of those that may hold
//! something.
//!
//! The boundary at column k is met at mu = (k - column(0)) / change. That number is the same whichever level computes
//! it, and it and the depths grow monotonely also as rounded. So skipping a tile skips exactly the pixels whose masks
//! would have said the same: what is visited, and with which ends, does not depend on the tiles.

use super::index::{Index, SHIFTS, Slabs};
use super::line::{Line, Point};
use std::ops::ControlFlow::{self, Break, Continue};

/// One axis of a walk over the tiles of one level.
#[derive(Clone, Copy)]
struct Axis {
    cell: i32,
    step: i32,
    /// The boundary ahead, in pixels.
    boundary: f64,
    boundary_step: f64,
    start: f64,
    per_change: f64,
    /// mu at the boundary ahead.
    next: f64,
}

impl Axis {
    /// The tile at `mu`, between tiles `lo` and `hi`. A boundary met at `mu` itself is passed.
    #[inline(always)]
    fn new(line: &Line, axis: usize, shift: u32, mu: f64, lo: i32, hi: i32) -> Self {
        let (start, change) = (line.start[axis], line.change[axis]);
        let forward = change >= 0.0;
        let place = (start + change * mu) as i32 >> shift;
        let (step, first, last) = if forward { (1, lo, hi) } else { (-1, hi, lo) };
        let cell = place.max(lo).min(hi);
        let boundary = f64::from((cell + i32::from(forward)) << shift);
        let boundary_step = f64::from(step << shift);
        let mut axis =
            Self { cell, step, boundary, boundary_step, start, per_change: line.per_change[axis], next: 0.0 };
        axis.next = axis.mu(boundary);
        // Rounding of the place: what counts is the order of the boundaries' mu.
        while axis.next <= mu && axis.cell != last {
            axis.advance();
        }
        while axis.cell != first && axis.mu(axis.boundary - boundary_step) > mu {
            axis.cell -= step;
            axis.boundary -= boundary_step;
            axis.next = axis.mu(axis.boundary);
        }
        axis
    }

    #[inline(always)]
    fn mu(&self, boundary: f64) -> f64 {
        (boundary - self.start) * self.per_change
    }

    #[inline(always)]
    fn advance(&mut self) {
        self.cell += self.step;
        self.boundary += self.boundary_step;
        self.next = self.mu(self.boundary);
    }
}

/// Visits, in order, the pixels in which `line` may meet something, with the points where it enters and leaves each,
/// until `visit` breaks. Pixels are counted from the occupied rectangle's corner.
#[inline]
pub fn walk(
    index: &Index,
    line: &Line,
    mut visit: impl FnMut([i32; 2], Point, Point) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let all = index.size.map(|n| (n as i32 - 1) >> SHIFTS[2]);
    through(index, line, 2, line.at(0.0), line.at(1.0), [0, 0], all, |tile, from, to| {
        let (lo, hi) = children(index, 2, tile);
        through(index, line, 1, from, to, lo, hi, |tile, from, to| {
            let (lo, hi) = children(index, 1, tile);
            through(index, line, 0, from, to, lo, hi, &mut visit)
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
    let mut x = Axis::new(line, 0, SHIFTS[level], from.mu, lo[0], hi[0]);
    let mut y = Axis::new(line, 1, SHIFTS[level], from.mu, lo[1], hi[1]);
    loop {
        let x_first = x.next <= y.next;
        let mu = if x_first { x.next } else { y.next };
        let at_end = mu >= end.mu;
        let to = if at_end { end } else { line.at(mu) };
        let mask = index.masks[level][y.cell as usize * width + x.cell as usize];
        let met = mask & Slabs::bits(from.slab.min(to.slab), from.slab.max(to.slab)) != 0;
        if met && to.mu > from.mu && visit([x.cell, y.cell], from, to).is_break() {
            return Break(());
        }
        if at_end {
            return Continue(());
        }
        from = to;
        if x_first {
            x.advance();
        } else {
            y.advance();
        }
    }
}
