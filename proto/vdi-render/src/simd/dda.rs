//! The way of eight lines through the VDI's pixels, together: row by row, and in a row column by column, or the other way
//! about where lines rather run up or down.
//!
//! The boundary at column k is met at mu = (k - column(0)) / change, and a line is in a pixel between the boundaries
//! before and behind it. These numbers are the line's own, whoever walks with it and whatever tiles are looked at, and
//! grow monotonely also as rounded: so a line is in every pixel that it crosses once, in order, and skipping tiles and
//! choosing neighbours changes no bit. Which pixels are looked at is all that lines share.

use super::packet::{Heading, Packet};
use lamina_compute::simd::{Floats, Lanes, Masks};

/// A walk over the tiles of 2^`shift` x 2^`shift` pixels inside a tile of a coarser level.
pub struct Walk<L: Lanes> {
    heading: Heading,
    shift: u32,
    /// Along rows: first and last tile that may be entered.
    within: [i32; 2],
    /// The stretch from the next row on.
    from: L::F,
    to: L::F,
    /// The row, and how many follow.
    row: i32,
    rows_left: i32,
    /// The stretch in the row, from the tile ahead on.
    row_from: L::F,
    row_to: L::F,
    /// The tile ahead, and how many there are of them.
    ahead: i32,
    ahead_left: i32,
}

/// A tile with the stretches that lines have in it.
#[derive(Clone, Copy)]
pub struct Tile<L: Lanes> {
    /// Column and row.
    pub at: [i32; 2],
    /// Which lines are in it.
    pub met: L::M,
    /// Where they enter.
    pub from: L::F,
    /// Where they leave.
    pub to: L::F,
}

/// The first tile on the way along one axis, and how many there are, between `lo` and `hi`, for stretches of lines.
#[inline(always)]
fn range<L: Lanes>(
    packet: &Packet<L>,
    heading: Heading,
    axis: usize,
    shift: u32,
    stretch: (L::F, L::F, L::M),
    [lo, hi]: [i32; 2],
) -> (i32, i32) {
    let (a, b) = (packet.place(axis, stretch.0), packet.place(axis, stretch.1));
    let (low, high) = if heading.forward[axis] { (a, b) } else { (b, a) };
    let [low, high] = L::F::ends(low - packet.pixel_margin, high + packet.pixel_margin, stretch.2);
    let (low, high) = ((low >> shift).max(lo).min(hi), (high >> shift).max(lo).min(hi));
    (if heading.forward[axis] { low } else { high }, high - low + 1)
}

impl<L: Lanes> Walk<L> {
    /// A walk over the tiles between `lo` and `hi` that the stretches in `tile` may meet.
    #[inline(always)]
    pub fn new(packet: &Packet<L>, heading: Heading, shift: u32, tile: &Tile<L>, lo: [i32; 2], hi: [i32; 2]) -> Self {
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

    /// The next tile that a line is in.
    #[inline(always)]
    pub fn next(&mut self, packet: &Packet<L>) -> Option<Tile<L>> {
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
                    return Some(Tile { at, met, from, to });
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
