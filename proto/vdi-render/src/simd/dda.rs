//! Traversal of the VDI's pixels along eight lines together: row by row, and within a row column by column; transposed for
//! steep lines.
//!
//! A line crosses the boundary of column k at mu = (k - column(0)) / change, and is in a pixel between two boundaries. These
//! values depend on the line alone, not on the lines traversed with it nor on the tiles visited, and they are monotone even when
//! rounded: so each line visits every pixel that it crosses once, in order, and neither skipped tiles nor the choice of
//! neighbors changes a bit. The lines share only the list of pixels visited.

use super::packet::{Heading, LinePacket};
use lamina_compute::simd::{Lanes, SimdF32, SimdMask};

/// A walk over the tiles of 2^`shift` x 2^`shift` pixels inside a tile of a coarser level.
pub(super) struct TileWalk<L: Lanes> {
    heading: Heading,
    shift: u32,
    /// First and last tile along rows.
    within: [i32; 2],
    /// Parts of the lines from the next row on.
    from: L::F,
    to: L::F,
    /// Current row, and number of rows after it.
    row: i32,
    rows_left: i32,
    /// Parts of the lines in the current row, from the next tile on.
    row_from: L::F,
    row_to: L::F,
    /// Next tile, and number of tiles from it on.
    ahead: i32,
    ahead_left: i32,
}

/// A tile, with the parts of the lines inside it.
#[derive(Clone, Copy)]
pub(super) struct CrossedTile<L: Lanes> {
    /// Column and row.
    pub at: [i32; 2],
    /// Lines that cross it.
    pub met: L::M,
    /// Position mu at which they enter.
    pub from: L::F,
    /// Position mu at which they leave.
    pub to: L::F,
}

/// The first tile along one axis, and the number of tiles, between `lo` and `hi`, that parts of lines (from, to, lanes) cross.
#[inline(always)]
fn range<L: Lanes>(
    packet: &LinePacket<L>,
    heading: Heading,
    axis: usize,
    shift: u32,
    stretch: (L::F, L::F, L::M),
    [lo, hi]: [i32; 2],
) -> (i32, i32) {
    let (a, b) = (packet.place(axis, stretch.0), packet.place(axis, stretch.1));
    let (low, high) = if heading.forward[axis] { (a, b) } else { (b, a) };
    let [low, high] = L::F::range_where(low - packet.pixel_margin, high + packet.pixel_margin, stretch.2);
    let (low, high) = ((low >> shift).max(lo).min(hi), (high >> shift).max(lo).min(hi));
    (if heading.forward[axis] { low } else { high }, high - low + 1)
}

impl<L: Lanes> TileWalk<L> {
    /// A walk over the tiles between `lo` and `hi` that the parts of lines in `tile` may cross.
    #[inline(always)]
    pub(super) fn new(
        packet: &LinePacket<L>,
        heading: Heading,
        shift: u32,
        tile: &CrossedTile<L>,
        lo: [i32; 2],
        hi: [i32; 2],
    ) -> Self {
        let (along, across) = (heading.along, 1 - heading.along);
        let stretch = (tile.from, tile.to, tile.met);
        let (row, rows_left) = range(packet, heading, across, shift, stretch, [lo[across], hi[across]]);
        Self {
            heading,
            shift,
            within: [lo[along], hi[along]],
            from: tile.from,
            to: tile.to,
            row: row - heading.step(across),
            rows_left,
            row_from: tile.from,
            row_to: tile.from,
            ahead: 0,
            ahead_left: 0,
        }
    }

    /// The next tile that any line crosses.
    #[inline(always)]
    pub(super) fn next(&mut self, packet: &LinePacket<L>) -> Option<CrossedTile<L>> {
        let (along, across) = (self.heading.along, 1 - self.heading.along);
        loop {
            while self.ahead_left > 0 {
                let from = self.row_from;
                let at = if along == 0 { [self.ahead, self.row] } else { [self.row, self.ahead] };
                let behind = packet.boundary(along, (self.ahead + self.heading.far_side(along)) << self.shift);
                let to = behind.min(self.row_to);
                self.row_from = behind.max(from);
                self.ahead += self.heading.step(along);
                self.ahead_left -= 1;
                let met = from.lt(to);
                if met.any() {
                    return Some(CrossedTile { at, met, from, to });
                }
            }
            if self.rows_left == 0 {
                return None;
            }
            self.rows_left -= 1;
            self.row += self.heading.step(across);
            let behind = packet.boundary(across, (self.row + self.heading.far_side(across)) << self.shift);
            self.row_from = self.from;
            self.row_to = behind.min(self.to);
            self.from = behind.max(self.from);
            let met = self.row_from.lt(self.row_to);
            if met.any() {
                let stretch = (self.row_from, self.row_to, met);
                (self.ahead, self.ahead_left) = range(packet, self.heading, along, self.shift, stretch, self.within);
            }
        }
    }
}
