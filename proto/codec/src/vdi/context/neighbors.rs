//! Neighbor context: rays as coded, and cursors that find the supersegment of a neighboring ray at a depth.

/// A supersegment with its color and opacity as palette indices.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct PaletteSegment {
    pub start: u32,
    pub end: u32,
    pub opacity: u32,
    pub color: u32,
}

/// One row of the image's rays.
#[derive(Debug, Clone)]
pub(super) struct RayRow {
    /// Offsets of rays in `entries`: 0, then the end of each ray.
    pub ends: Vec<u32>,
    /// The supersegments of all rays, one ray after the other.
    pub entries: Vec<PaletteSegment>,
}

impl RayRow {
    /// A row without rays.
    pub(super) fn new() -> Self {
        Self { ends: vec![0], entries: Vec::new() }
    }

    /// Appends a ray.
    pub(super) fn push(&mut self, ray: impl IntoIterator<Item = PaletteSegment>) {
        self.entries.extend(ray);
        self.ends.push(self.entries.len() as u32);
    }

    /// Range of ray `x` in `entries`; empty if there is no such ray.
    pub(super) fn range(&self, x: usize) -> std::ops::Range<usize> {
        match self.ends.get(x..x + 2) {
            Some(&[start, end]) => start as usize..end as usize,
            _ => 0..0,
        }
    }

    /// Supersegments of ray `x`; empty if there is no such ray.
    pub(super) fn ray(&self, x: usize) -> &[PaletteSegment] {
        &self.entries[self.range(x)]
    }
}

/// Largest remaining length that contexts distinguish, steps.
const MAX_REMAINING: u32 = 4000;
/// Value of a gap where a neighboring ray has no further supersegment.
pub(super) const NO_NEIGHBOR: u32 = u32::MAX;

/// The supersegments of a neighboring ray that the cursor has not passed yet.
pub(super) struct NeighborCursor<'a>(pub &'a [PaletteSegment]);

impl NeighborCursor<'_> {
    /// Passes all supersegments that end at `depth` or before.
    #[inline(always)]
    pub(super) fn advance_past(&mut self, depth: u32) {
        while let Some((first, rest)) = self.0.split_first()
            && first.end <= depth
        {
            self.0 = rest;
        }
    }

    /// Number of supersegments not passed, at most 7.
    pub(super) fn remaining(&self) -> u32 {
        self.0.len().min(7) as u32
    }

    /// Steps from `depth` to the start of the next supersegment; 0 if it has begun, [`NO_NEIGHBOR`] if there is none.
    pub(super) fn gap(&self, depth: u32) -> u32 {
        self.0.first().map_or(NO_NEIGHBOR, |next| next.start.saturating_sub(depth))
    }

    /// Steps from `depth` to the end of the supersegment that covers it, at most [`MAX_REMAINING`]; 0 if none covers it.
    pub(super) fn remaining_steps(&self, depth: u32) -> u32 {
        self.0.first().map_or(0, |s| if s.start <= depth { (s.end - depth).min(MAX_REMAINING) } else { 0 })
    }

    /// Where the next supersegment starts relative to `depth`: 0 before, 1 at it, 2 behind; 3 if there is none.
    pub(super) fn start_order(&self, depth: u32) -> u32 {
        self.0.first().map_or(3, |s| 1 + u32::from(s.start > depth) - u32::from(s.start < depth))
    }

    /// Context that the next supersegment gives.
    pub(super) fn context(&self) -> SegmentContext {
        SegmentContext::of(self.0.first())
    }
}

/// Context that one supersegment gives to others: palette indices plus one and the length's bin, all 0 if there is none.
#[derive(Default, Clone, Copy)]
pub(super) struct SegmentContext {
    pub color: u32,
    pub opacity: u32,
    /// Logarithmic bin of the length in steps.
    pub length: u32,
}

impl SegmentContext {
    pub(super) fn of(entry: Option<&PaletteSegment>) -> Self {
        let context =
            |s: &PaletteSegment| Self { color: s.color + 1, opacity: s.opacity + 1, length: log_bin(s.end - s.start) };
        entry.map_or(Self::default(), context)
    }
}

/// Logarithmic bins of half an octave: 0 to 7 as they are, 8 to 11 as 8, 12 to 15 as 9, and so on.
pub(super) fn log_bin(n: u32) -> u32 {
    if n < 8 {
        return n;
    }
    let octave = n.ilog2();
    2 * octave + (n >> (octave - 1) & 1) + 2
}

/// Bits that an index below `n` needs.
pub(super) fn bits_for(n: usize) -> u32 {
    n.max(1).next_power_of_two().ilog2()
}
