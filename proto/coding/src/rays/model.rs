//! What of a supersegment's surroundings its decisions depend on.
use super::MAX_DEPTH;
use super::palette::Palette;
use super::symbols::{Contexts, Symbols, fold, hash, unfold};
use crate::Error;
use crate::coder::Coder;
use crate::mix::{Chance, single};

/// A supersegment with its colour and opacity as places in the palette.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Entry {
    pub start: u32,
    pub end: u32,
    pub colour: u32,
    pub opacity: u32,
}

/// All that is learnt of a band on the way.
pub struct Model {
    colour_bits: u32,
    opacity_bits: u32,
    /// Whether a ray has any, where those around have none.
    any: Chance,
    more: Symbols,
    gaps: Symbols,
    lengths: Symbols,
    opacities: Symbols,
    colours: Symbols,
}

/// Where a gap ends is taken from the rays around if that is so far.
const FAR: u32 = 12;
/// The furthest that a near gap's contexts tell apart.
const NEAR: u32 = 40;
/// The longest that lengths' contexts tell apart.
const LONG: u32 = 4000;
/// No ray around says where.
const NOWHERE: u32 = u32::MAX;

/// A ray beside the one that is coded, and the first of its supersegments that is not passed yet.
struct Beside<'a> {
    ray: &'a [Entry],
}

impl<'a> Beside<'a> {
    /// Passes all that end at `depth` or before.
    #[inline(always)]
    fn pass(&mut self, depth: u32) {
        while let Some((first, rest)) = self.ray.split_first()
            && first.end <= depth
        {
            self.ray = rest;
        }
    }

    /// How many are left, up to 7.
    fn left(&self) -> u32 {
        self.ray.len().min(7) as u32
    }

    /// How far it is from `depth` to the next.
    fn gap(&self, depth: u32) -> u32 {
        self.ray.first().map_or(NOWHERE, |next| next.start.saturating_sub(depth))
    }

    /// What of the one at `depth` is left, if there is one.
    fn rest(&self, depth: u32) -> u32 {
        self.ray.first().map_or(0, |s| if s.start <= depth { (s.end - depth).min(LONG) } else { 0 })
    }

    /// Whether one is entered at `depth` (1), before (0) or behind (2); 3 if there is none.
    fn entered(&self, depth: u32) -> u32 {
        self.ray.first().map_or(3, |s| 1 + u32::from(s.start > depth) - u32::from(s.start < depth))
    }

    /// The next one's look: colour and opacity as one number, and its length's bin; 0 for none.
    fn look(&self) -> Look {
        self.ray.first().map_or(Look::default(), Look::of)
    }
}

/// How a supersegment looks; numbers from 1 on, 0 if there is none.
#[derive(Default, Clone, Copy)]
struct Look {
    colour: u32,
    opacity: u32,
    /// Both.
    both: u32,
    length: u32,
}

impl Look {
    fn of(s: &Entry) -> Self {
        let (colour, opacity) = (s.colour + 1, s.opacity + 1);
        Self { colour, opacity, both: colour << 8 ^ opacity, length: bin(s.end - s.start) }
    }
}

/// Half octaves: 0 to 7 as they are, 8 to 11 as 8, 12 to 15 as 9, and so on.
fn bin(n: u32) -> u32 {
    if n < 8 {
        return n;
    }
    let octave = n.ilog2();
    2 * octave + (n >> (octave - 1) & 1) + 2
}

/// The bin of how far two gaps differ, 99 if one leads nowhere.
fn apart(a: u32, b: u32) -> u32 {
    if a == NOWHERE || b == NOWHERE { 99 } else { bin(a.abs_diff(b)) }
}

/// Bits of `n` places.
fn bits(n: usize) -> u32 {
    n.max(1).next_power_of_two().ilog2()
}

impl Model {
    /// Of a band of about so many `segments`.
    pub fn new(palette: &Palette, segments: usize) -> Self {
        let [colours, opacities] = palette.counts();
        let size = |less: u32, most: u32| (bits(segments) + 1).saturating_sub(less).clamp(10, most);
        Self {
            colour_bits: bits(colours),
            opacity_bits: bits(opacities),
            any: Chance::default(),
            more: Symbols::of_trees(size(3, 14), 4),
            gaps: Symbols::of_numbers(size(3, 18), 12),
            lengths: Symbols::of_numbers(size(1, 18), 8),
            opacities: Symbols::of_trees(size(1, 18), 4),
            colours: Symbols::of_trees(size(0, 19), 8),
        }
    }

    /// Codes a ray that is as `wanted`, or reads it, into `ray`; `around` are those to the left, above and to the upper right.
    ///
    /// # Errors
    /// If there is no `room` for a supersegment, or it would be deeper than any.
    pub fn ray<C: Coder>(
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
        let mut around = around.map(|ray| Beside { ray });
        let (mut last, mut before, mut older) = (Entry::default(), 0, Look::default());
        loop {
            let next = wanted.get(ray.len());
            around.iter_mut().for_each(|beside| beside.pass(last.end));
            let gaps = around.each_ref().map(|beside| beside.gap(last.end));
            if !self.more(coder, &around, gaps, ray, next.is_some()) {
                return Ok(());
            }
            if !room() {
                return Err(Error::Value);
            }
            let next = next.copied().unwrap_or_default();
            let gap = self.gap(coder, gaps, ray.last(), before, next.start.wrapping_sub(last.end));
            let start = u64::from(last.end) + u64::from(gap);
            if start >= MAX_DEPTH.into() {
                return Err(Error::Value);
            }
            let start = start as u32;
            around.iter_mut().for_each(|beside| beside.pass(start));
            let length = self.length(coder, &around, start, ray.last(), gap, next.end.wrapping_sub(start));
            let end = u64::from(start) + u64::from(length);
            if end > MAX_DEPTH.into() {
                return Err(Error::Value);
            }
            around.iter_mut().for_each(|beside| beside.pass(start + length / 2));
            let [left, up, _] = around.each_ref().map(Beside::look);
            let previous = ray.last().map_or(Look::default(), Look::of);
            let opacity = self.opacity(coder, [left, up, previous, older], bin(length), next.opacity);
            let colour = self.colour(coder, [left, up, previous], bin(length), opacity + 1, next.colour);
            (before, older) = (gap, previous);
            last = Entry { start, end: end as u32, colour, opacity };
            ray.push(last);
        }
    }

    /// Whether another supersegment follows.
    fn more<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[Beside; 3],
        gaps: [u32; 3],
        ray: &[Entry],
        more: bool,
    ) -> bool {
        let [left, up, right] = around.each_ref().map(Beside::left);
        let [gap_left, gap_up, gap_right] = gaps.map(|gap| if gap == NOWHERE { 99 } else { bin(gap) });
        let previous = ray.last().map_or(Look::default(), Look::of);
        let (first, both) = (u32::from(ray.is_empty()), left.min(1) * 2 + up.min(1));
        let contexts = [
            hash(left, up, first),
            hash(gap_left, gap_up, first),
            hash(right, gap_right, gap_up),
            hash(previous.both, both, 0),
            hash(ray.len().min(63) as u32, left, up),
            hash(previous.length, gap_left, right),
        ];
        self.more.bit(coder, &contexts, both as usize, more)
    }

    /// Steps to the next supersegment; `before` is the gap before the last one.
    fn gap<C: Coder>(&mut self, coder: &mut C, gaps: [u32; 3], last: Option<&Entry>, before: u32, gap: u32) -> u32 {
        let [left, up, right] = gaps;
        let nearest = left.min(up).min(right);
        // Between the left one's and the upper one's, if both say where.
        let middle = if left == NOWHERE || up == NOWHERE { 0 } else { left.midpoint(up) };
        let expected = if nearest == NOWHERE { 0 } else { nearest.max(middle) };
        let far = expected >= FAR;
        let previous = last.map_or(Look::default(), Look::of);
        let kind = u32::from(last.is_none()) * 2 + u32::from(far);
        let at_once = u32::from(left == 0) + u32::from(up == 0);
        let mixer = (kind * 3 + at_once) as usize;
        if far {
            let [bin_left, bin_up] = [left, up].map(|gap| if gap == NOWHERE { 99 } else { bin(gap) });
            let contexts = [
                hash(apart(left, up), kind, 0),
                hash(bin_left, bin_up, kind),
                hash(apart(right, expected), kind, 0),
                hash(kind, 0, 0),
                hash(apart(left, up), apart(right, left), 0),
                hash(previous.both, kind, 0),
            ];
            let folded = self.gaps.number(coder, &contexts, mixer, fold(gap.wrapping_sub(expected) as i32));
            return expected.wrapping_add_signed(unfold(folded));
        }
        let [left, up, right] = gaps.map(|gap| gap.min(NEAR));
        let zeros = u32::from(left == 0) * 2 + u32::from(up == 0);
        let contexts = [
            hash(left, up, 0),
            hash(left, previous.both, 0),
            hash(up, right, 0),
            hash(previous.both, zeros, 0),
            hash(previous.length, before.min(NEAR), 0),
            hash(left << 8 | up, right, kind),
        ];
        self.gaps.number(coder, &contexts, mixer, gap)
    }

    /// Steps of the supersegment that begins at `start`.
    fn length<C: Coder>(
        &mut self,
        coder: &mut C,
        around: &[Beside; 3],
        start: u32,
        last: Option<&Entry>,
        gap: u32,
        length: u32,
    ) -> u32 {
        let [left, up, right] = around.each_ref().map(|beside| beside.rest(start));
        let [look_left, look_up, _] = around.each_ref().map(Beside::look);
        let previous = last.map_or(Look::default(), Look::of);
        let entered = around[0].entered(start) + 4 * around[1].entered(start);
        let contexts = [
            hash(left, up, 0),
            hash(left, entered, bin(up)),
            hash(up, right, 0),
            hash(look_left.opacity, left, 0),
            hash(look_up.opacity, up, 0),
            hash(previous.both, previous.length, bin(gap)),
        ];
        let mixer = usize::from(left == up) + 2 * usize::from(left > 0) + 4 * usize::from(up > 0);
        self.lengths.number(coder, &contexts, mixer, length.wrapping_sub(1)).wrapping_add(1)
    }

    fn opacity<C: Coder>(&mut self, coder: &mut C, looks: [Look; 4], length: u32, opacity: u32) -> u32 {
        let [left, up, previous, older] = looks;
        let contexts = [
            hash(left.opacity, up.opacity, 0),
            hash(left.opacity, left.length, length),
            hash(up.opacity, up.length, length),
            hash(previous.opacity, previous.length, length),
            hash(previous.both, older.both, length),
            hash(left.both, up.both, length),
        ];
        let mixer = usize::from(left.opacity == up.opacity) * 2 + usize::from(previous.opacity == left.opacity);
        self.opacities.tree(coder, &contexts, self.opacity_bits, mixer, opacity)
    }

    fn colour<C: Coder>(&mut self, coder: &mut C, looks: [Look; 3], length: u32, opacity: u32, colour: u32) -> u32 {
        let [left, up, previous] = looks;
        let contexts: Contexts = [
            hash(previous.colour, length, 0),
            hash(left.colour, opacity, length),
            hash(up.colour, opacity, 0),
            hash(previous.colour, left.colour, 0),
            hash(opacity, length, 0),
            hash(left.colour, up.colour, 0),
        ];
        let same = |look: Look| usize::from(look.opacity == opacity);
        let mixer = usize::from(left.both == up.both) * 4 + same(left) * 2 + same(up);
        self.colours.tree(coder, &contexts, self.colour_bits, mixer, colour)
    }
}
