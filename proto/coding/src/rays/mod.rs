//! The rays of a Volumetric Depth Image without loss: each ray's supersegments in the context of those beside them, on the
//! ray before, on the one above, and on the one to the upper right.
//!
//! Colours come from a curve, the transfer function, so few differ; they and the opacities are coded as places in sorted lists
//! of all that occur. What bzip2 cannot see, because it looks along the bytes only, is that neighbouring rays meet the same
//! things: this takes about two thirds of its bytes.
mod model;
mod palette;
mod symbols;
#[cfg(test)]
mod tests;

use crate::Error;
use crate::coder::{Coder, Decoder, Encoder};
use model::{Entry, Model};
use palette::Palette;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// A supersegment as it is coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment {
    /// First step inside.
    pub start: u32,
    /// First step beyond.
    pub end: u32,
    /// Red, green, blue, opacity.
    pub code: [u8; 4],
}

/// The deepest end of a supersegment.
pub const MAX_DEPTH: u32 = 1 << 24;

/// Supersegments of a band, about: bands are coded by themselves, on all cores.
const BAND: usize = 1 << 17;
/// Fewest rows of a band.
const BAND_ROWS: usize = 16;

/// Rows of each band of a square image with so many `segments`.
fn bands(resolution: usize, segments: usize) -> Vec<Range<usize>> {
    let count = (segments / BAND).min(resolution / BAND_ROWS).max(1);
    (0..count).map(|k| k * resolution / count..(k + 1) * resolution / count).collect()
}

/// Codes the rays of a square image of `resolution` rays a side, row by row: ray k has the supersegments from `offsets[k]` up
/// to `offsets[k + 1]`, in order of depth and without overlap, none empty, none deeper than [`MAX_DEPTH`].
///
/// # Panics
/// If there are not as many offsets as rays and one more, or supersegments are not as said.
pub fn encode(resolution: usize, offsets: &[u32], segment: impl Fn(usize) -> Segment + Sync) -> Vec<u8> {
    assert_eq!(offsets.len(), resolution * resolution + 1, "one offset a ray and one more");
    let segments = offsets[resolution * resolution] as usize;
    let palette = Palette::of((0..segments).map(|k| segment(k).code));
    let bands = bands(resolution, segments);
    let band = |rows: &Range<usize>| {
        let offsets = &offsets[rows.start * resolution..=rows.end * resolution];
        let (first, end) = (offsets[0], offsets[offsets.len() - 1]);
        let entries: Vec<Entry> = (first..end).map(|k| palette.entry(&segment(k as usize))).collect();
        let wanted = |ray: usize| &entries[(offsets[ray] - first) as usize..(offsets[ray + 1] - first) as usize];
        let (mut encoder, mut model) = (Encoder::default(), Model::new(&palette, segments / bands.len()));
        let coded = code(&mut encoder, &mut model, [resolution, rows.len()], || true, wanted);
        coded.expect("supersegments come in order of depth");
        encoder.finish()
    };
    let mut list = Encoder::default();
    palette.code(&mut list);
    let mut parts = vec![list.finish()];
    parts.par_extend(bands.par_iter().map(band));
    let lengths = parts.iter().flat_map(|p| (p.len() as u64).to_le_bytes());
    lengths.chain(parts.iter().flatten().copied()).collect()
}

/// The offsets of rays, and what `make` makes of their supersegments, of which there are so many.
///
/// # Errors
/// If the bytes are not as many as they claim, or what is in them cannot be, or is not so many supersegments.
pub fn decode<T: Send>(
    bytes: &[u8],
    resolution: usize,
    segments: usize,
    make: impl Fn(Segment) -> T + Sync,
) -> Result<(Vec<u32>, Vec<T>), Error> {
    let rays = resolution.checked_mul(resolution).ok_or(Error::Sizes)?;
    let bands = bands(resolution, segments);
    let (lengths, mut rest) = bytes.split_at_checked(8 * (bands.len() + 1)).ok_or(Error::Short)?;
    let mut parts = Vec::with_capacity(bands.len() + 1);
    for length in lengths.as_chunks::<8>().0 {
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| Error::Short)?;
        let (part, after) = rest.split_at_checked(length).ok_or(Error::Short)?;
        parts.push(part);
        rest = after;
    }
    if !rest.is_empty() {
        return Err(Error::Short);
    }
    let palette = Palette::read(&mut Decoder::new(parts[0]), segments)?;
    // Of all bands together, so that none takes memory for more than there may be.
    let left = AtomicUsize::new(segments);
    let room = || left.fetch_update(Relaxed, Relaxed, |n| n.checked_sub(1)).is_ok();
    let band = |(rows, part): (&Range<usize>, &&[u8])| {
        let (mut decoder, mut model) = (Decoder::new(part), Model::new(&palette, segments / bands.len()));
        let (ends, entries) = code(&mut decoder, &mut model, [resolution, rows.len()], room, |_| &[])?;
        let made = entries.iter().map(|entry| palette.segment(entry).map(&make)).collect::<Result<Vec<T>, Error>>()?;
        Ok((ends, made))
    };
    let decoded: Vec<(Vec<u32>, Vec<T>)> = bands.par_iter().zip(&parts[1..]).map(band).collect::<Result<_, Error>>()?;
    if left.into_inner() > 0 {
        return Err(Error::Value);
    }
    let (mut offsets, mut all) = (Vec::with_capacity(rays + 1), Vec::new());
    offsets.push(0);
    for (ends, made) in decoded {
        let first = all.len() as u32;
        offsets.extend(ends[1..].iter().map(|end| first + end));
        if all.is_empty() { all = made } else { all.extend(made) }
    }
    Ok((offsets, all))
}

/// Codes `rows` rows of `resolution` rays, each of which is as `wanted`, or reads them, while there is `room` for a
/// supersegment: where each ray ends, after a 0, and the supersegments.
fn code<'a, C: Coder>(
    coder: &mut C,
    model: &mut Model,
    [resolution, rows]: [usize; 2],
    room: impl Fn() -> bool,
    wanted: impl Fn(usize) -> &'a [Entry],
) -> Result<(Vec<u32>, Vec<Entry>), Error> {
    let (mut ends, mut entries, mut ray) = (vec![0], Vec::new(), Vec::new());
    for k in 0..resolution * rows {
        let x = k % resolution;
        let at = |k: usize| &entries[ends[k] as usize..ends[k + 1] as usize];
        let left = if x > 0 { at(k - 1) } else { &[] };
        let up = if k >= resolution { at(k - resolution) } else { &[] };
        let right = if k >= resolution && x + 1 < resolution { at(k - resolution + 1) } else { &[] };
        ray.clear();
        model.ray(coder, wanted(k), [left, up, right], &room, &mut ray)?;
        entries.extend_from_slice(&ray);
        ends.push(entries.len() as u32);
    }
    Ok((ends, entries))
}
