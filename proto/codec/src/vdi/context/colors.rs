//! Color coder: codes the palette index of each supersegment's color in the context of its own geometry and of the
//! neighboring rays. Geometry (start, end, opacity) is already known.
use super::neighbors::{NeighborCursor, PaletteSegment, RayRow, SegmentContext, bits_for, log_bin};
use super::symbols::{SymbolCoder, hash};
use crate::entropy::EntropyError;
use crate::entropy::range_coder::{Coder, Decoder, Encoder};

/// Encodes the colors of the `rows` of a band. `segments` is the approximate number of supersegments of the band, `colors`
/// the size of the palette; both set the sizes of tables.
pub(super) fn write(rows: &[RayRow], segments: usize, colors: usize) -> Vec<u8> {
    let (mut encoder, mut colors, mut above) = (Encoder::default(), ColorCoder::new(segments, colors), RayRow::new());
    for row in rows {
        let mut row = row.clone();
        colors.row(&mut encoder, &mut row, &above);
        above = row;
    }
    encoder.finish()
}

/// Decodes the colors of `rows` into them and passes each row to `done`.
///
/// # Errors
/// If `done` returns one.
pub(super) fn read(
    bytes: &[u8],
    rows: impl IntoIterator<Item = RayRow>,
    segments: usize,
    colors: usize,
    mut done: impl FnMut(&RayRow) -> Result<(), EntropyError>,
) -> Result<(), EntropyError> {
    let (mut decoder, mut colors, mut above) = (Decoder::new(bytes), ColorCoder::new(segments, colors), RayRow::new());
    for mut row in rows {
        colors.row(&mut decoder, &mut row, &above);
        done(&row)?;
        above = row;
    }
    Ok(())
}

/// The adaptive state of one band.
pub(super) struct ColorCoder {
    color_bits: u32,
    colors: SymbolCoder,
}

impl ColorCoder {
    /// Untrained models for a band of about `segments` supersegments and a palette of `colors` colors.
    pub(super) fn new(segments: usize, colors: usize) -> Self {
        let lines = bits_for(segments).saturating_sub(3).clamp(5, 15);
        Self { color_bits: bits_for(colors), colors: SymbolCoder::new(lines, 8) }
    }

    /// Codes the colors of a `row`, or reads them into it. `above` is the previous row, or an empty one.
    pub(super) fn row<C: Coder>(&mut self, coder: &mut C, row: &mut RayRow, above: &RayRow) {
        for x in 0..row.ends.len() - 1 {
            let left = if x > 0 { row.range(x - 1) } else { 0..0 };
            let this = row.range(x);
            let (known, rest) = row.entries.split_at_mut(this.start);
            self.ray(coder, &mut rest[..this.len()], [&known[left], above.ray(x)]);
        }
    }

    fn ray<C: Coder>(&mut self, coder: &mut C, ray: &mut [PaletteSegment], around: [&[PaletteSegment]; 2]) {
        let mut around = around.map(NeighborCursor);
        let mut previous = SegmentContext::default();
        for entry in ray {
            let length = entry.end - entry.start;
            around.iter_mut().for_each(|cursor| cursor.advance_past(entry.start + length / 2));
            let [left, up] = around.each_ref().map(NeighborCursor::context);
            let (length, opacity) = (log_bin(length), entry.opacity + 1);
            let contexts = [
                hash(previous.color, length, 0),
                hash(left.color, opacity, length),
                hash(up.color, opacity, 0),
                hash(opacity, length, 0),
            ];
            let same = |context: SegmentContext| usize::from(context.opacity == opacity);
            let mixer = usize::from(left.color == up.color) * 4 + same(left) * 2 + same(up);
            entry.color = self.colors.code_tree(coder, &contexts, self.color_bits, mixer, entry.color);
            previous = SegmentContext::of(Some(entry));
        }
    }
}
