//! Colours of supersegments whose shape is known, by what is known of the rays around.
use super::neighbors::{Beside, Entry, Look, Row, bin, bits};
use super::symbols::{Symbols, hash};
use crate::entropy::Error;
use crate::entropy::range_coder::{Coder, Decoder, Encoder};

/// Codes the colours of the `rows` of a band of about so many supersegments, with so many colours.
pub fn write(rows: &[Row], segments: usize, colours: usize) -> Vec<u8> {
    let (mut encoder, mut colours, mut above) = (Encoder::default(), Colours::new(segments, colours), Row::new());
    for row in rows {
        let mut row = row.clone();
        colours.row(&mut encoder, &mut row, &above);
        above = row;
    }
    encoder.finish()
}

/// Reads the colours of `rows` and hands each row to `done`.
///
/// # Errors
/// If `done` fails.
pub fn read(
    bytes: &[u8],
    rows: impl IntoIterator<Item = Row>,
    segments: usize,
    colours: usize,
    mut done: impl FnMut(&Row) -> Result<(), Error>,
) -> Result<(), Error> {
    let (mut decoder, mut colours, mut above) = (Decoder::new(bytes), Colours::new(segments, colours), Row::new());
    for mut row in rows {
        colours.row(&mut decoder, &mut row, &above);
        done(&row)?;
        above = row;
    }
    Ok(())
}

/// All that is learnt of a band on the way.
struct Colours {
    bits: u32,
    colours: Symbols,
}

impl Colours {
    /// Of a band of about so many supersegments, with so many colours.
    fn new(segments: usize, colours: usize) -> Self {
        let lines = bits(segments).saturating_sub(3).clamp(5, 15);
        Self { bits: bits(colours), colours: Symbols::new(lines, 8) }
    }

    /// Codes the colours of a `row`, or reads them into it; `above` is the one before, of as many rays or none.
    fn row<C: Coder>(&mut self, coder: &mut C, row: &mut Row, above: &Row) {
        for x in 0..row.ends.len() - 1 {
            let left = if x > 0 { row.range(x - 1) } else { 0..0 };
            let this = row.range(x);
            let (known, rest) = row.entries.split_at_mut(this.start);
            self.ray(coder, &mut rest[..this.len()], [&known[left], above.ray(x)]);
        }
    }

    fn ray<C: Coder>(&mut self, coder: &mut C, ray: &mut [Entry], around: [&[Entry]; 2]) {
        let mut around = around.map(Beside);
        let mut previous = Look::default();
        for entry in ray {
            let length = entry.end - entry.start;
            around.iter_mut().for_each(|beside| beside.pass(entry.start + length / 2));
            let [left, up] = around.each_ref().map(Beside::look);
            let (length, opacity) = (bin(length), entry.opacity + 1);
            let contexts = [
                hash(previous.colour, length, 0),
                hash(left.colour, opacity, length),
                hash(up.colour, opacity, 0),
                hash(opacity, length, 0),
            ];
            let same = |look: Look| usize::from(look.opacity == opacity);
            let mixer = usize::from(left.colour == up.colour) * 4 + same(left) * 2 + same(up);
            entry.colour = self.colours.tree(coder, &contexts, self.bits, mixer, entry.colour);
            previous = Look::of(Some(entry));
        }
    }
}
