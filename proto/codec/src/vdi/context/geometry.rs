//! Geometry coder: codes start, length and opacity of each supersegment in the context of three neighboring rays.
use super::MAX_DEPTH;
use super::neighbors::{NO_NEIGHBOR, NeighborCursor, PaletteSegment, RayRow, SegmentContext, bits_for, log_bin};
use super::symbols::{SymbolCoder, fold, hash, unfold};
use crate::entropy::EntropyError;
use crate::entropy::logistic::{BitModel, code_bit};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use std::sync::mpsc::Sender;

/// Encodes the geometry of the `rows` of a band, `resolution` rays each. `segments` is the approximate number of
/// supersegments of the band, `opacities` the size of the opacity palette; both set the sizes of tables.
///
/// # Panics
/// If the supersegments of a ray are not in order of depth.
pub(super) fn write(rows: &[RayRow], resolution: usize, segments: usize, opacities: usize) -> Vec<u8> {
    let (mut encoder, mut shapes, mut above) =
        (Encoder::default(), GeometryCoder::new(segments, opacities), RayRow::new());
    for row in rows {
        let coded = shapes.row(&mut encoder, resolution, Some(row), &above, || true);
        above = coded.expect("supersegments come in order of depth");
    }
    encoder.finish()
}

/// Decodes `rows` rows of `resolution` rays and sends each to `known` as soon as it is decoded; ends early if the receiver
/// is gone. `room` is asked before each supersegment whether one more is allowed.
///
/// # Errors
/// If `room` refuses, or a supersegment would end beyond [`MAX_DEPTH`].
pub(super) fn read(
    bytes: &[u8],
    [resolution, rows]: [usize; 2],
    segments: usize,
    opacities: usize,
    room: impl Fn() -> bool,
    known: Sender<RayRow>,
) -> Result<(), EntropyError> {
    let (mut decoder, mut shapes, mut above) =
        (Decoder::new(bytes), GeometryCoder::new(segments, opacities), RayRow::new());
    for _ in 0..rows {
        above = shapes.row(&mut decoder, resolution, None, &above, &room)?;
        if known.send(above.clone()).is_err() {
            break;
        }
    }
    Ok(())
}

/// The adaptive state of one band.
pub(super) struct GeometryCoder {
    opacity_bits: u32,
    /// Whether a ray has any supersegment, where all neighboring rays are empty.
    any: BitModel,
    more: SymbolCoder,
    gaps: SymbolCoder,
    lengths: SymbolCoder,
    opacities: SymbolCoder,
}

/// From this expected gap on, a gap is coded as its difference to the expected one.
const MIN_PREDICTED_GAP: u32 = 12;
/// Shorter expected gaps: largest neighboring gap that the contexts distinguish, in steps.
const MAX_NEAR_GAP: u32 = 40;

/// The logarithmic bin of a gap, 99 for [`NO_NEIGHBOR`].
fn gap_bin(gap: u32) -> u32 {
    if gap == NO_NEIGHBOR { 99 } else { log_bin(gap) }
}

/// The logarithmic bin of the difference between two gaps, 99 if either is [`NO_NEIGHBOR`].
fn difference_bin(a: u32, b: u32) -> u32 {
    if a == NO_NEIGHBOR || b == NO_NEIGHBOR { 99 } else { log_bin(a.abs_diff(b)) }
}

impl GeometryCoder {
    /// Untrained models for a band of about `segments` supersegments with `opacities` distinct opacities.
    pub(super) fn new(segments: usize, opacities: usize) -> Self {
        let lines = |less: u32, most: u32| bits_for(segments).saturating_sub(less).clamp(5, most);
        Self {
            opacity_bits: bits_for(opacities),
            any: BitModel::default(),
            more: SymbolCoder::new(lines(6, 10), 4),
            gaps: SymbolCoder::new(lines(6, 14), 12),
            lengths: SymbolCoder::new(lines(4, 14), 8),
            opacities: SymbolCoder::new(lines(4, 14), 64),
        }
    }

    /// Encodes the geometry of `wanted`, a row of `resolution` rays, or decodes one if `wanted` is `None`. Returns the row,
    /// without colors. `above` is the previous row, or an empty one.
    ///
    /// # Errors
    /// If `room` refuses a supersegment, or one would end beyond [`MAX_DEPTH`].
    pub(super) fn row<C: Coder>(
        &mut self,
        coder: &mut C,
        resolution: usize,
        wanted: Option<&RayRow>,
        above: &RayRow,
        room: impl Fn() -> bool,
    ) -> Result<RayRow, EntropyError> {
        let (mut row, mut ray) = (RayRow::new(), Vec::new());
        for x in 0..resolution {
            let left = if x > 0 { row.ray(x - 1) } else { &[] };
            let wanted = wanted.map_or(&[][..], |row| row.ray(x));
            ray.clear();
            self.ray(coder, wanted, [left, above.ray(x), above.ray(x + 1)], &room, &mut ray)?;
            row.push(ray.iter().copied());
        }
        Ok(row)
    }

    /// Encodes the ray `wanted`, or decodes one; appends its supersegments to `ray`. `around` are the rays to the left, above,
    /// and to the upper right.
    fn ray<C: Coder>(
        &mut self,
        coder: &mut C,
        wanted: &[PaletteSegment],
        around: [&[PaletteSegment]; 3],
        room: impl Fn() -> bool,
        ray: &mut Vec<PaletteSegment>,
    ) -> Result<(), EntropyError> {
        if around.iter().all(|ray| ray.is_empty()) && !code_bit(coder, &mut self.any, !wanted.is_empty()) {
            return Ok(());
        }
        let mut around = around.map(NeighborCursor);
        let (mut end, mut before, mut previous, mut older) =
            (0, 0, SegmentContext::default(), SegmentContext::default());
        loop {
            let next = wanted.get(ray.len());
            around.iter_mut().for_each(|cursor| cursor.advance_past(end));
            let gaps = around.each_ref().map(|cursor| cursor.gap(end));
            if !self.more(coder, &around, gaps, ray.len(), previous, next.is_some()) {
                return Ok(());
            }
            if !room() {
                return Err(EntropyError::InvalidValue);
            }
            let next = next.copied().unwrap_or_default();
            let gap = self.gap(coder, gaps, ray.is_empty(), previous, before, next.start.wrapping_sub(end));
            let start = u64::from(end) + u64::from(gap);
            if start >= MAX_DEPTH.into() {
                return Err(EntropyError::InvalidValue);
            }
            let start = start as u32;
            around.iter_mut().for_each(|cursor| cursor.advance_past(start));
            let length = self.length(coder, &around, start, previous, gap, next.end.wrapping_sub(start));
            let last = u64::from(start) + u64::from(length);
            if last > MAX_DEPTH.into() {
                return Err(EntropyError::InvalidValue);
            }
            end = last as u32;
            around.iter_mut().for_each(|cursor| cursor.advance_past(start + length / 2));
            let [left, up, _] = around.each_ref().map(NeighborCursor::context);
            let opacity = self.opacity(coder, [left, up, previous, older], log_bin(length), next.opacity);
            ray.push(PaletteSegment { start, end, opacity, color: 0 });
            (before, older, previous) = (gap, previous, SegmentContext::of(ray.last()));
        }
    }

    /// Codes whether another supersegment follows.
    fn more<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[NeighborCursor; 3],
        gaps: [u32; 3],
        count: usize,
        previous: SegmentContext,
        more: bool,
    ) -> bool {
        let [left, up, right] = around.each_ref().map(NeighborCursor::remaining);
        let [gap_left, gap_up, gap_right] = gaps.map(gap_bin);
        let both = left.min(1) * 2 + up.min(1);
        let contexts = [
            hash(gap_left, gap_up, u32::from(count == 0)),
            hash(right, gap_right, gap_up),
            hash(previous.opacity, both, 0),
            hash(count.min(63) as u32, left, up),
        ];
        self.more.code_flag(coder, &contexts, both as usize, more)
    }

    /// Codes the gap, in steps, to the next supersegment. `before` is the gap in front of the `previous` supersegment.
    fn gap<C: Coder>(
        &mut self,
        coder: &mut C,
        gaps: [u32; 3],
        first: bool,
        previous: SegmentContext,
        before: u32,
        gap: u32,
    ) -> u32 {
        let [left, up, right] = gaps;
        let nearest = left.min(up).min(right);
        // The mean of the left and the upper ray's gap, if both have a next supersegment.
        let middle = if left == NO_NEIGHBOR || up == NO_NEIGHBOR { 0 } else { left.midpoint(up) };
        let expected = if nearest == NO_NEIGHBOR { 0 } else { nearest.max(middle) };
        let far = expected >= MIN_PREDICTED_GAP;
        let kind = u32::from(first) * 2 + u32::from(far);
        let at_once = u32::from(left == 0) + u32::from(up == 0);
        let mixer = (kind * 3 + at_once) as usize;
        if far {
            let contexts = [
                hash(difference_bin(left, up), kind, 0),
                hash(gap_bin(left), gap_bin(up), kind),
                hash(difference_bin(right, expected), kind, 0),
                hash(previous.opacity, kind, 0),
            ];
            let folded = self.gaps.code_number(coder, &contexts, mixer, fold(gap.wrapping_sub(expected) as i32));
            return expected.wrapping_add_signed(unfold(folded));
        }
        let [left, up, right] = gaps.map(|gap| gap.min(MAX_NEAR_GAP));
        let zeros = u32::from(left == 0) * 2 + u32::from(up == 0);
        let contexts = [
            hash(left << 8 | up, right, kind),
            hash(previous.opacity, zeros, 0),
            hash(up, right, 0),
            hash(previous.length, before.min(MAX_NEAR_GAP), 0),
        ];
        self.gaps.code_number(coder, &contexts, mixer, gap)
    }

    /// Codes the length, in steps, of the supersegment that begins at `start`.
    fn length<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[NeighborCursor; 3],
        start: u32,
        previous: SegmentContext,
        gap: u32,
        length: u32,
    ) -> u32 {
        let [left, up, right] = around.each_ref().map(|cursor| cursor.remaining_steps(start));
        let start_order = around[0].start_order(start) + 4 * around[1].start_order(start);
        let contexts = [
            hash(left, start_order, log_bin(up)),
            hash(up, right, 0),
            hash(around[1].context().opacity, up, 0),
            hash(previous.opacity, previous.length, log_bin(gap)),
        ];
        let mixer = usize::from(left == up) + 2 * usize::from(left > 0) + 4 * usize::from(up > 0);
        self.lengths.code_number(coder, &contexts, mixer, length.wrapping_sub(1)).wrapping_add(1)
    }

    /// Codes the palette index of the opacity of a supersegment whose length is in bin `length`.
    fn opacity<C: Coder>(&mut self, coder: &mut C, contexts: [SegmentContext; 4], length: u32, opacity: u32) -> u32 {
        let [left, up, previous, older] = contexts;
        let contexts = [
            hash(left.opacity, left.length, length),
            hash(up.opacity, up.length, length),
            hash(previous.opacity, previous.length, length),
            hash(previous.opacity, older.opacity, length),
        ];
        let alike = usize::from(left.opacity == up.opacity) * 2 + usize::from(previous.opacity == left.opacity);
        let mixer = alike + 4 * length.min(15) as usize;
        self.opacities.code_tree(coder, &contexts, self.opacity_bits, mixer, opacity)
    }
}
