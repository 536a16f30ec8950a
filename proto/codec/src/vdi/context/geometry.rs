//! Where supersegments lie and how opaque they are, by what is known of the rays around.
use super::MAX_DEPTH;
use super::neighbors::{Beside, Entry, Look, NOWHERE, Row, bin, bits};
use super::symbols::{Symbols, fold, hash, unfold};
use crate::entropy::Error;
use crate::entropy::logistic::{Chance, single};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use std::sync::mpsc::Sender;

/// Codes the `rows` of a band, of so many rays each: of about so many supersegments, with so many opacities.
///
/// # Panics
/// If supersegments do not come in order of depth.
pub fn write(rows: &[Row], resolution: usize, segments: usize, opacities: usize) -> Vec<u8> {
    let (mut encoder, mut shapes, mut above) = (Encoder::default(), Shapes::new(segments, opacities), Row::new());
    for row in rows {
        let coded = shapes.row(&mut encoder, resolution, Some(row), &above, || true);
        above = coded.expect("supersegments come in order of depth");
    }
    encoder.finish()
}

/// Reads so many rows, while there is `room` for a supersegment, and hands each to `known`, until nobody listens.
///
/// # Errors
/// If there is no room, or a supersegment would be deeper than any.
pub fn read(
    bytes: &[u8],
    [resolution, rows]: [usize; 2],
    segments: usize,
    opacities: usize,
    room: impl Fn() -> bool,
    known: Sender<Row>,
) -> Result<(), Error> {
    let (mut decoder, mut shapes, mut above) = (Decoder::new(bytes), Shapes::new(segments, opacities), Row::new());
    for _ in 0..rows {
        above = shapes.row(&mut decoder, resolution, None, &above, &room)?;
        if known.send(above.clone()).is_err() {
            break;
        }
    }
    Ok(())
}

/// All that is learnt of a band on the way.
struct Shapes {
    opacity_bits: u32,
    /// Whether a ray has any, where those around have none.
    any: Chance,
    more: Symbols,
    gaps: Symbols,
    lengths: Symbols,
    opacities: Symbols,
}

/// Where a gap ends is taken from the rays around if that is so far.
const FAR: u32 = 12;
/// The furthest that a near gap's contexts tell apart.
const NEAR: u32 = 40;

/// The bin of a gap, 99 if it leads nowhere.
fn bin_of(gap: u32) -> u32 {
    if gap == NOWHERE { 99 } else { bin(gap) }
}

/// The bin of how far two gaps differ, 99 if one leads nowhere.
fn apart(a: u32, b: u32) -> u32 {
    if a == NOWHERE || b == NOWHERE { 99 } else { bin(a.abs_diff(b)) }
}

impl Shapes {
    /// Of a band of about so many supersegments, with so many opacities.
    fn new(segments: usize, opacities: usize) -> Self {
        let lines = |less: u32, most: u32| bits(segments).saturating_sub(less).clamp(5, most);
        Self {
            opacity_bits: bits(opacities),
            any: Chance::default(),
            more: Symbols::new(lines(6, 10), 4),
            gaps: Symbols::new(lines(6, 14), 12),
            lengths: Symbols::new(lines(4, 14), 8),
            opacities: Symbols::new(lines(4, 14), 64),
        }
    }

    /// Codes a row of so many rays as `wanted` has it, or reads it while there is `room` for a supersegment, but for the
    /// colours; `above` is the one before, of as many rays or none.
    ///
    /// # Errors
    /// If there is no room for a supersegment, or it would be deeper than any.
    fn row<C: Coder>(
        &mut self,
        coder: &mut C,
        resolution: usize,
        wanted: Option<&Row>,
        above: &Row,
        room: impl Fn() -> bool,
    ) -> Result<Row, Error> {
        let (mut row, mut ray) = (Row::new(), Vec::new());
        for x in 0..resolution {
            let left = if x > 0 { row.ray(x - 1) } else { &[] };
            let wanted = wanted.map_or(&[][..], |row| row.ray(x));
            ray.clear();
            self.ray(coder, wanted, [left, above.ray(x), above.ray(x + 1)], &room, &mut ray)?;
            row.push(ray.iter().copied());
        }
        Ok(row)
    }

    /// Codes a ray or reads it into `ray`; `around` are those to the left, above and to the upper right.
    fn ray<C: Coder>(
        &mut self,
        coder: &mut C,
        wanted: &[Entry],
        around: [&[Entry]; 3],
        room: impl Fn() -> bool,
        ray: &mut Vec<Entry>,
    ) -> Result<(), Error> {
        if around.iter().all(|ray| ray.is_empty()) && !single(coder, &mut self.any, !wanted.is_empty()) {
            return Ok(());
        }
        let mut around = around.map(Beside);
        let (mut end, mut before, mut previous, mut older) = (0, 0, Look::default(), Look::default());
        loop {
            let next = wanted.get(ray.len());
            around.iter_mut().for_each(|beside| beside.pass(end));
            let gaps = around.each_ref().map(|beside| beside.gap(end));
            if !self.more(coder, &around, gaps, ray.len(), previous, next.is_some()) {
                return Ok(());
            }
            if !room() {
                return Err(Error::Value);
            }
            let next = next.copied().unwrap_or_default();
            let gap = self.gap(coder, gaps, ray.is_empty(), previous, before, next.start.wrapping_sub(end));
            let start = u64::from(end) + u64::from(gap);
            if start >= MAX_DEPTH.into() {
                return Err(Error::Value);
            }
            let start = start as u32;
            around.iter_mut().for_each(|beside| beside.pass(start));
            let length = self.length(coder, &around, start, previous, gap, next.end.wrapping_sub(start));
            let last = u64::from(start) + u64::from(length);
            if last > MAX_DEPTH.into() {
                return Err(Error::Value);
            }
            end = last as u32;
            around.iter_mut().for_each(|beside| beside.pass(start + length / 2));
            let [left, up, _] = around.each_ref().map(Beside::look);
            let opacity = self.opacity(coder, [left, up, previous, older], bin(length), next.opacity);
            ray.push(Entry { start, end, opacity, colour: 0 });
            (before, older, previous) = (gap, previous, Look::of(ray.last()));
        }
    }

    /// Whether another supersegment follows.
    fn more<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[Beside; 3],
        gaps: [u32; 3],
        count: usize,
        previous: Look,
        more: bool,
    ) -> bool {
        let [left, up, right] = around.each_ref().map(Beside::left);
        let [gap_left, gap_up, gap_right] = gaps.map(bin_of);
        let both = left.min(1) * 2 + up.min(1);
        let contexts = [
            hash(gap_left, gap_up, u32::from(count == 0)),
            hash(right, gap_right, gap_up),
            hash(previous.opacity, both, 0),
            hash(count.min(63) as u32, left, up),
        ];
        self.more.bit(coder, &contexts, both as usize, more)
    }

    /// Steps to the next supersegment; `before` is the gap before the `previous` one.
    fn gap<C: Coder>(
        &mut self,
        coder: &mut C,
        gaps: [u32; 3],
        first: bool,
        previous: Look,
        before: u32,
        gap: u32,
    ) -> u32 {
        let [left, up, right] = gaps;
        let nearest = left.min(up).min(right);
        // Between the left one's and the upper one's, if both say where.
        let middle = if left == NOWHERE || up == NOWHERE { 0 } else { left.midpoint(up) };
        let expected = if nearest == NOWHERE { 0 } else { nearest.max(middle) };
        let far = expected >= FAR;
        let kind = u32::from(first) * 2 + u32::from(far);
        let at_once = u32::from(left == 0) + u32::from(up == 0);
        let mixer = (kind * 3 + at_once) as usize;
        if far {
            let contexts = [
                hash(apart(left, up), kind, 0),
                hash(bin_of(left), bin_of(up), kind),
                hash(apart(right, expected), kind, 0),
                hash(previous.opacity, kind, 0),
            ];
            let folded = self.gaps.number(coder, &contexts, mixer, fold(gap.wrapping_sub(expected) as i32));
            return expected.wrapping_add_signed(unfold(folded));
        }
        let [left, up, right] = gaps.map(|gap| gap.min(NEAR));
        let zeros = u32::from(left == 0) * 2 + u32::from(up == 0);
        let contexts = [
            hash(left << 8 | up, right, kind),
            hash(previous.opacity, zeros, 0),
            hash(up, right, 0),
            hash(previous.length, before.min(NEAR), 0),
        ];
        self.gaps.number(coder, &contexts, mixer, gap)
    }

    /// Steps of the supersegment that begins at `start`.
    fn length<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[Beside; 3],
        start: u32,
        previous: Look,
        gap: u32,
        length: u32,
    ) -> u32 {
        let [left, up, right] = around.each_ref().map(|beside| beside.rest(start));
        let entered = around[0].entered(start) + 4 * around[1].entered(start);
        let contexts = [
            hash(left, entered, bin(up)),
            hash(up, right, 0),
            hash(around[1].look().opacity, up, 0),
            hash(previous.opacity, previous.length, bin(gap)),
        ];
        let mixer = usize::from(left == up) + 2 * usize::from(left > 0) + 4 * usize::from(up > 0);
        self.lengths.number(coder, &contexts, mixer, length.wrapping_sub(1)).wrapping_add(1)
    }

    /// How opaque one of a bin of `length`s is.
    fn opacity<C: Coder>(&mut self, coder: &mut C, looks: [Look; 4], length: u32, opacity: u32) -> u32 {
        let [left, up, previous, older] = looks;
        let contexts = [
            hash(left.opacity, left.length, length),
            hash(up.opacity, up.length, length),
            hash(previous.opacity, previous.length, length),
            hash(previous.opacity, older.opacity, length),
        ];
        let alike = usize::from(left.opacity == up.opacity) * 2 + usize::from(previous.opacity == left.opacity);
        let mixer = alike + 4 * length.min(15) as usize;
        self.opacities.tree(coder, &contexts, self.opacity_bits, mixer, opacity)
    }
}
