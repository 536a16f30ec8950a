//! Rays, and what is beside a place on one.

/// A supersegment with its colour and opacity as places in the palette.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Entry {
    pub start: u32,
    pub end: u32,
    pub opacity: u32,
    pub colour: u32,
}

/// The rays of a row of the image.
#[derive(Debug, Clone)]
pub struct Row {
    /// Where each ray ends among the supersegments, after a 0.
    pub ends: Vec<u32>,
    /// Supersegments of one ray after the other.
    pub entries: Vec<Entry>,
}

impl Row {
    /// One that has no rays yet.
    pub fn new() -> Self {
        Self { ends: vec![0], entries: Vec::new() }
    }

    /// Adds a ray.
    pub fn push(&mut self, ray: impl IntoIterator<Item = Entry>) {
        self.entries.extend(ray);
        self.ends.push(self.entries.len() as u32);
    }

    /// Where ray `x` lies; empty if it is not there.
    pub fn range(&self, x: usize) -> std::ops::Range<usize> {
        match self.ends.get(x..x + 2) {
            Some(&[start, end]) => start as usize..end as usize,
            _ => 0..0,
        }
    }

    /// Ray `x`; empty if it is not there.
    pub fn ray(&self, x: usize) -> &[Entry] {
        &self.entries[self.range(x)]
    }
}

/// The longest that contexts tell apart of what is left of a supersegment.
const LONG: u32 = 4000;
/// No ray around says where.
pub const NOWHERE: u32 = u32::MAX;

/// A ray beside the one that is coded, from the first of its supersegments that is not passed yet.
pub struct Beside<'a>(pub &'a [Entry]);

impl Beside<'_> {
    /// Passes all that end at `depth` or before.
    #[inline(always)]
    pub fn pass(&mut self, depth: u32) {
        while let Some((first, rest)) = self.0.split_first()
            && first.end <= depth
        {
            self.0 = rest;
        }
    }

    /// How many are left, up to 7.
    pub fn left(&self) -> u32 {
        self.0.len().min(7) as u32
    }

    /// How far it is from `depth` to the next.
    pub fn gap(&self, depth: u32) -> u32 {
        self.0.first().map_or(NOWHERE, |next| next.start.saturating_sub(depth))
    }

    /// What of the one at `depth` is left, if there is one.
    pub fn rest(&self, depth: u32) -> u32 {
        self.0.first().map_or(0, |s| if s.start <= depth { (s.end - depth).min(LONG) } else { 0 })
    }

    /// Whether one is entered at `depth` (1), before (0) or behind (2); 3 if there is none.
    pub fn entered(&self, depth: u32) -> u32 {
        self.0.first().map_or(3, |s| 1 + u32::from(s.start > depth) - u32::from(s.start < depth))
    }

    /// The next one's look.
    pub fn look(&self) -> Look {
        Look::of(self.0.first())
    }
}

/// How a supersegment looks: numbers from 1 on, 0 if there is none.
#[derive(Default, Clone, Copy)]
pub struct Look {
    pub colour: u32,
    pub opacity: u32,
    /// The bin of its length.
    pub length: u32,
}

impl Look {
    pub fn of(entry: Option<&Entry>) -> Self {
        let look = |s: &Entry| Self { colour: s.colour + 1, opacity: s.opacity + 1, length: bin(s.end - s.start) };
        entry.map_or(Self::default(), look)
    }
}

/// Half octaves: 0 to 7 as they are, 8 to 11 as 8, 12 to 15 as 9, and so on.
pub fn bin(n: u32) -> u32 {
    if n < 8 {
        return n;
    }
    let octave = n.ilog2();
    2 * octave + (n >> (octave - 1) & 1) + 2
}

/// Bits of `n` places.
pub fn bits(n: usize) -> u32 {
    n.max(1).next_power_of_two().ilog2()
}
