//! All colours and opacities that occur, sorted: a supersegment names their places.
use super::Segment;
use super::neighbors::Entry;
use super::symbols::{fold, unfold};
use crate::entropy::Error;
use crate::entropy::logistic::{Chance, single};
use crate::entropy::range_coder::{Coder, Decoder};

/// Colours and opacities.
pub struct Palette {
    /// Red in the highest byte in use, blue in the lowest; rising.
    colours: Vec<u32>,
    opacities: Vec<u8>,
    /// Place of each opacity among them.
    opacity_places: [u8; 256],
}

impl Palette {
    /// All in `codes`.
    pub fn of(codes: impl Iterator<Item = [u8; 4]>) -> Self {
        let (mut seen, mut colours, mut last) = ([false; 256], Vec::new(), None);
        for code in codes {
            seen[usize::from(code[3])] = true;
            let colour = number(code);
            if last != Some(colour) {
                colours.push(colour);
                last = Some(colour);
            }
        }
        colours.sort_unstable();
        colours.dedup();
        Self::new(colours, &seen)
    }

    fn new(colours: Vec<u32>, seen: &[bool; 256]) -> Self {
        let opacities: Vec<u8> = (0..=255).filter(|&o| seen[usize::from(o)]).collect();
        let mut opacity_places = [0; 256];
        opacities.iter().enumerate().for_each(|(place, &o)| opacity_places[usize::from(o)] = place as u8);
        Self { colours, opacities, opacity_places }
    }

    /// Numbers of colours and of opacities.
    pub fn counts(&self) -> [usize; 2] {
        [self.colours.len(), self.opacities.len()]
    }

    /// A supersegment whose code is among those.
    pub fn entry(&self, segment: &Segment) -> Entry {
        let colour = self.colours.partition_point(|&c| c < number(segment.code)) as u32;
        let opacity = self.opacity_places[usize::from(segment.code[3])].into();
        Entry { start: segment.start, end: segment.end, colour, opacity }
    }

    /// What `entry` stands for.
    pub fn segment(&self, entry: &Entry) -> Result<Segment, Error> {
        let colour = self.colours.get(entry.colour as usize).ok_or(Error::Value)?;
        let opacity = self.opacities.get(entry.opacity as usize).ok_or(Error::Value)?;
        let [blue, green, red, _] = colour.to_le_bytes();
        Ok(Segment { start: entry.start, end: entry.end, code: [red, green, blue, *opacity] })
    }

    /// Codes it.
    pub fn code(&self, coder: &mut impl Coder) {
        let mut seen = [false; 256];
        self.opacities.iter().for_each(|&o| seen[usize::from(o)] = true);
        let coded = code(coder, &mut seen, self.colours.len(), |k| self.colours[k], |_| Ok(()));
        coded.expect("colours are of 24 bits");
    }

    /// Reads one of at most so many colours.
    pub fn read(decoder: &mut Decoder, most: usize) -> Result<Self, Error> {
        let (mut seen, mut colours) = ([false; 256], Vec::new());
        let most = most.min(1 << 24);
        code(
            decoder,
            &mut seen,
            most,
            |_| 0,
            |colour| {
                let after = colours.last().is_none_or(|&last| last < colour);
                colours.push(colour);
                if after { Ok(()) } else { Err(Error::Value) }
            },
        )?;
        Ok(Self::new(colours, &seen))
    }
}

fn number([red, green, blue, _]: [u8; 4]) -> u32 {
    u32::from_be_bytes([0, red, green, blue])
}

/// Chances of a number's digits: how long it is, by what it is of.
type Lengths = [[Chance; 10]; 4];

/// Codes which opacities occur, the number of colours, at most `most`, and `colour` by number; or reads them, for `found`.
///
/// # Errors
/// If there are more, or one is none, or `found` fails.
fn code<C: Coder>(
    coder: &mut C,
    seen: &mut [bool; 256],
    most: usize,
    colour: impl Fn(usize) -> u32,
    mut found: impl FnMut(u32) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut same = [Chance::default(); 2];
    let mut last = false;
    for seen in seen {
        *seen = single(coder, &mut same[usize::from(last)], *seen);
        last = *seen;
    }
    let high = coder.even(16, (most >> 16) as u32);
    let count = (high << 16 | coder.even(16, most as u32 & 0xffff)) as usize;
    if count > most {
        return Err(Error::Value);
    }
    let mut lengths = Lengths::default();
    let [mut red, mut green, mut blue] = [0_i32; 3];
    for k in 0..count {
        let [b, g, r, _] = colour(k).to_le_bytes().map(i32::from);
        let step = exp_golomb(coder, &mut lengths[0], (r - red) as u32) as i32;
        red += step;
        // Along the curve all three change by little; a new red says that they do.
        let green_of = if step > 0 { 1 } else { 2 };
        green += unfold(exp_golomb(coder, &mut lengths[green_of], fold(g - green)));
        blue += unfold(exp_golomb(coder, &mut lengths[3], fold(b - blue)));
        let [Ok(r), Ok(g), Ok(b)] = [red, green, blue].map(u8::try_from) else { return Err(Error::Value) };
        found(number([r, g, b, 0]))?;
    }
    Ok(())
}

/// A number below 1023: by the length of its successor in binary, then its digits.
fn exp_golomb(coder: &mut impl Coder, lengths: &mut [Chance; 10], number: u32) -> u32 {
    let wanted = number.wrapping_add(1).clamp(1, 1023);
    let length = 31 - wanted.leading_zeros();
    let mut n = 0;
    while n < 9 && single(coder, &mut lengths[n as usize], length > n) {
        n += 1;
    }
    (1 << n | coder.even(n, wanted)) - 1
}
