//! Assignment of pixels to packets: tiles of four by two, so that the eight rays stay close to each other.

use lamina_compute::simd::WIDTH;

/// The pixels (column, row) of one packet.
pub(super) struct Tile {
    pixels: [(u32, u32); WIDTH],
    count: usize,
}

impl Tile {
    /// Columns of a tile.
    pub(super) const COLUMNS: u32 = 4;
    /// Rows of a tile.
    pub(super) const ROWS: u32 = 2;

    /// Tiles that cover `rows` (one or two) rows of a picture `width` pixels wide, from row `first_row` on.
    #[inline(always)]
    pub(super) fn across(width: u32, first_row: u32, rows: u32) -> impl Iterator<Item = Self> {
        (0..width.div_ceil(Self::COLUMNS)).map(move |t| {
            let mut tile = Self { pixels: [(0, 0); WIDTH], count: 0 };
            for j in 0..rows {
                for i in t * Self::COLUMNS..width.min((t + 1) * Self::COLUMNS) {
                    tile.pixels[tile.count] = (i, first_row + j);
                    tile.count += 1;
                }
            }
            tile
        })
    }

    /// The pixels, row by row.
    #[inline(always)]
    pub(super) fn pixels(&self) -> &[(u32, u32)] {
        &self.pixels[..self.count]
    }
}
