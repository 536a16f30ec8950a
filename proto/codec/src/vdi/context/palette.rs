//! Palettes of a VDI: all colors and all opacities that occur, sorted; supersegments refer to them by index.
use super::neighbors::PaletteSegment;
use super::segment::QuantizedSegment;
use super::symbols::{fold, unfold};
use crate::entropy::EntropyError;
use crate::entropy::logistic::{BitModel, code_bit};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};

/// The sorted colors and opacities of a VDI.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::vdi) struct Palette {
    /// 0xRRGGBB, strictly rising.
    colors: Vec<u32>,
    opacities: Vec<u8>,
    /// Index of each opacity code in `opacities`.
    opacity_places: [u8; 256],
}

impl Palette {
    /// The palette of all `codes` (red, green, blue, opacity).
    pub(in crate::vdi) fn of(codes: impl Iterator<Item = [u8; 4]>) -> Self {
        let (mut used, mut colors, mut last) = ([false; 256], Vec::new(), None);
        for code in codes {
            used[usize::from(code[3])] = true;
            let color = packed_rgb(code);
            if last != Some(color) {
                colors.push(color);
                last = Some(color);
            }
        }
        Self::sorted(colors, &used)
    }

    fn sorted(mut colors: Vec<u32>, used: &[bool; 256]) -> Self {
        colors.sort_unstable();
        colors.dedup();
        Self::new(colors, used)
    }

    /// All colors and opacities of `palettes`.
    pub(in crate::vdi) fn union<'a>(palettes: impl IntoIterator<Item = &'a Self>) -> Self {
        let (mut used, mut colors) = ([false; 256], Vec::new());
        for palette in palettes {
            palette.opacities.iter().for_each(|&o| used[usize::from(o)] = true);
            colors.extend_from_slice(&palette.colors);
        }
        Self::sorted(colors, &used)
    }

    fn new(colors: Vec<u32>, used: &[bool; 256]) -> Self {
        let opacities: Vec<u8> = (0..=255).filter(|&o| used[usize::from(o)]).collect();
        let mut opacity_places = [0; 256];
        opacities.iter().enumerate().for_each(|(place, &o)| opacity_places[usize::from(o)] = place as u8);
        Self { colors, opacities, opacity_places }
    }

    /// Number of colors and number of opacities.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.colors.len(), self.opacities.len()]
    }

    /// `segment`, whose code is in the palette, by indices.
    pub(super) fn entry(&self, segment: &QuantizedSegment) -> PaletteSegment {
        let color = self.colors.partition_point(|&c| c < packed_rgb(segment.code)) as u32;
        let opacity = self.opacity_places[usize::from(segment.code[3])].into();
        PaletteSegment { start: segment.start, end: segment.end, color, opacity }
    }

    /// The supersegment of `entry`.
    pub(super) fn segment(&self, entry: &PaletteSegment) -> Result<QuantizedSegment, EntropyError> {
        let color = self.colors.get(entry.color as usize).ok_or(EntropyError::InvalidValue)?;
        let opacity = self.opacities.get(entry.opacity as usize).ok_or(EntropyError::InvalidValue)?;
        let [blue, green, red, _] = color.to_le_bytes();
        Ok(QuantizedSegment { start: entry.start, end: entry.end, code: [red, green, blue, *opacity] })
    }

    /// The palette coded, as [`Self::read`] takes it.
    pub(in crate::vdi) fn to_bytes(&self) -> Vec<u8> {
        let (mut encoder, mut used) = (Encoder::default(), [false; 256]);
        self.opacities.iter().for_each(|&o| used[usize::from(o)] = true);
        let coded = code(&mut encoder, &mut used, self.colors.len(), |k| self.colors[k], |_| Ok(()));
        coded.expect("colors are of 24 bits");
        encoder.finish()
    }

    /// Decodes a palette of at most `most` colors.
    ///
    /// # Errors
    /// If it has more, or its colors do not rise.
    pub(in crate::vdi) fn read(bytes: &[u8], most: usize) -> Result<Self, EntropyError> {
        let (mut used, mut colors) = ([false; 256], Vec::new());
        let most = most.min(1 << 24);
        code(
            &mut Decoder::new(bytes),
            &mut used,
            most,
            |_| 0,
            |color| {
                let after = colors.last().is_none_or(|&last| last < color);
                colors.push(color);
                if after { Ok(()) } else { Err(EntropyError::InvalidValue) }
            },
        )?;
        Ok(Self::new(colors, &used))
    }
}

fn packed_rgb([red, green, blue, _]: [u8; 4]) -> u32 {
    u32::from_be_bytes([0, red, green, blue])
}

/// Models of Exp-Golomb lengths, by kind of number: red, green after a change of red, other green, blue.
type LengthModels = [[BitModel; 10]; 4];

/// Codes which opacities occur, the number of colors (at most `most`) and each color, which `color` gives by index; or reads
/// them and passes each color to `found`.
///
/// # Errors
/// If there are more than `most` colors, a channel is out of range, or `found` returns one.
fn code<C: Coder>(
    coder: &mut C,
    used: &mut [bool; 256],
    most: usize,
    color: impl Fn(usize) -> u32,
    mut found: impl FnMut(u32) -> Result<(), EntropyError>,
) -> Result<(), EntropyError> {
    let mut same = [BitModel::default(); 2];
    let mut last = false;
    for used in used {
        *used = code_bit(coder, &mut same[usize::from(last)], *used);
        last = *used;
    }
    let high = coder.code_uniform(16, (most >> 16) as u32);
    let count = (high << 16 | coder.code_uniform(16, most as u32 & 0xffff)) as usize;
    if count > most {
        return Err(EntropyError::InvalidValue);
    }
    let mut lengths = LengthModels::default();
    let [mut red, mut green, mut blue] = [0_i32; 3];
    for k in 0..count {
        let [b, g, r, _] = color(k).to_le_bytes().map(i32::from);
        let step = exp_golomb(coder, &mut lengths[0], (r - red) as u32) as i32;
        red += step;
        // Along the curve of the transfer function channels change by little; a change of red predicts one of green.
        let green_of = if step > 0 { 1 } else { 2 };
        green += unfold(exp_golomb(coder, &mut lengths[green_of], fold(g - green)));
        blue += unfold(exp_golomb(coder, &mut lengths[3], fold(b - blue)));
        let [Ok(r), Ok(g), Ok(b)] = [red, green, blue].map(u8::try_from) else {
            return Err(EntropyError::InvalidValue);
        };
        found(packed_rgb([r, g, b, 0]))?;
    }
    Ok(())
}

/// Codes a number below 1023 in Exp-Golomb code: the length of its successor in binary, then the digits after the first.
fn exp_golomb(coder: &mut impl Coder, lengths: &mut [BitModel; 10], number: u32) -> u32 {
    let wanted = number.wrapping_add(1).clamp(1, 1023);
    let length = 31 - wanted.leading_zeros();
    let mut n = 0;
    while n < 9 && code_bit(coder, &mut lengths[n as usize], length > n) {
        n += 1;
    }
    (1 << n | coder.code_uniform(n, wanted)) - 1
}
