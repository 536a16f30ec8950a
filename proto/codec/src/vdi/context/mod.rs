//! The rays of a Volumetric Depth Image without loss: each ray's supersegments in the context of those beside them, on the
//! ray before, on the one above, and on the one to the upper right.
//!
//! Colours come from a curve, the transfer function, so few differ; they and the opacities are coded as places in sorted lists
//! of all that occur. What bzip2 cannot see, because it looks along the bytes only, is that neighbouring rays meet the same
//! things: this takes half to two thirds of its bytes. Shapes (start, end and opacity) do not depend on colours, so both are coded
//! at once.
mod colors;
mod geometry;
mod mixer;
mod neighbors;
mod palette;
mod symbols;
#[cfg(test)]
mod tests;

use crate::entropy::Error;
use crate::entropy::range_coder::{Decoder, Encoder};
use neighbors::Row;
use palette::Palette;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::channel;

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
    let (per_band, [colours, opacities]) = (segments / bands.len(), palette.counts());
    let parts = bands.par_iter().flat_map(|rows| {
        let row = |y: usize| {
            let mut row = Row::new();
            for ray in offsets[y * resolution..=(y + 1) * resolution].windows(2) {
                row.push((ray[0]..ray[1]).map(|k| palette.entry(&segment(k as usize))));
            }
            row
        };
        let rows: Vec<Row> = rows.clone().map(row).collect();
        let write_shapes = || geometry::write(&rows, resolution, per_band, opacities);
        let write_colours = || colors::write(&rows, per_band, colours);
        <[Vec<u8>; 2]>::from(rayon::join(write_shapes, write_colours))
    });
    let mut list = Encoder::default();
    palette.code(&mut list);
    let parts: Vec<Vec<u8>> = rayon::iter::once(list.finish()).chain(parts).collect();
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
    let count = 2 * bands.len() + 1;
    let (lengths, mut rest) = bytes.split_at_checked(8 * count).ok_or(Error::Short)?;
    let mut parts = Vec::with_capacity(count);
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
    let (per_band, [colours, opacities]) = (segments / bands.len(), palette.counts());
    // Of all bands together, so that none takes memory for more than there may be.
    let left = AtomicUsize::new(segments);
    let room = || left.fetch_update(Relaxed, Relaxed, |n| n.checked_sub(1)).is_ok();
    let band = |(rows, parts): (&Range<usize>, &[&[u8]])| {
        // Colours follow as soon as a row's shapes are known, on another core if there is one.
        // Without a bound: on a single thread all rows wait until the last is known.
        let (known, next) = channel();
        let read_shapes = || geometry::read(parts[0], [resolution, rows.len()], per_band, opacities, room, known);
        let (mut ends, mut made) = (vec![0], Vec::new());
        let done = |row: &Row| {
            let first = made.len() as u32;
            ends.extend(row.ends[1..].iter().map(|end| first + end));
            for entry in &row.entries {
                made.push(make(palette.segment(entry)?));
            }
            Ok(())
        };
        let read_colours = || colors::read(parts[1], next, per_band, colours, done);
        let (shapes_read, colours_read) = rayon::join(read_shapes, read_colours);
        shapes_read.and(colours_read).map(|()| (ends, made))
    };
    let decoded: Vec<(Vec<u32>, Vec<T>)> =
        bands.par_iter().zip(parts[1..].par_chunks(2)).map(band).collect::<Result<_, Error>>()?;
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
