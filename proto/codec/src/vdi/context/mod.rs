//! Context-mixing coder of a VDI's rays, lossless: codes each supersegment in the context of those at the same depth on
//! three neighboring rays (left, above, upper right).
//!
//! Colors lie on the curve of the transfer function, so few differ; colors and opacities are coded as indices into sorted
//! palettes. Neighboring rays meet the same structures, which bzip2 cannot see because it models the byte sequence only: the
//! result takes half to two thirds of bzip2's bytes. Geometry (start, end, opacity) does not depend on colors, so both are
//! coded in parallel.
mod colors;
mod geometry;
mod mixer;
mod neighbors;
mod palette;
mod segment;
mod stages;
mod symbols;
#[cfg(test)]
mod tests;

use crate::entropy::EntropyError;
use crate::vdi::band::VdiBand;
use neighbors::RayRow;
pub(super) use palette::Palette;
use rayon::prelude::*;
pub(super) use segment::QuantizedSegment;
pub(super) use stages::damaged;
pub use stages::{ColorDecoder, GeometryDecoder};
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::channel;

/// The largest `end` of a supersegment, steps.
pub(super) const MAX_DEPTH: u32 = 1 << 24;

/// Approximate number of supersegments of a band; bands are coded independently, on all cores.
const BAND: usize = 1 << 17;
/// Fewest rows of a band.
const BAND_ROWS: usize = 16;

/// The rows of each band of a `resolution` x `resolution` image with `segments` supersegments.
pub(super) fn bands(resolution: usize, segments: usize) -> Vec<Range<usize>> {
    let count = (segments / BAND).min(resolution / BAND_ROWS).max(1);
    (0..count).map(|k| k * resolution / count..(k + 1) * resolution / count).collect()
}

/// Approximate number of supersegments of a band.
fn per_band(resolution: usize, segments: usize) -> usize {
    segments / bands(resolution, segments).len()
}

/// Encodes the rays of a square image of `resolution` rays a side, row by row. Ray k has the supersegments from `offsets[k]`
/// up to `offsets[k + 1]`, in order of depth, not overlapping, not empty, and none beyond [`MAX_DEPTH`].
///
/// # Panics
/// If there are not `resolution`^2 + 1 offsets, or a ray violates the above.
pub(super) fn encode(
    resolution: usize,
    offsets: &[u32],
    segment: impl Fn(usize) -> QuantizedSegment + Sync,
) -> Vec<u8> {
    assert_eq!(offsets.len(), resolution * resolution + 1, "one offset a ray and one more");
    let segments = offsets[resolution * resolution] as usize;
    let palette = Palette::of((0..segments).map(|k| segment(k).code));
    let (bands, [colors, opacities]) = (bands(resolution, segments), palette.counts());
    let per_band = per_band(resolution, segments);
    let band = |rows: &Range<usize>| {
        let row = |y: usize| {
            let mut row = RayRow::new();
            for ray in offsets[y * resolution..=(y + 1) * resolution].windows(2) {
                row.push((ray[0]..ray[1]).map(|k| palette.entry(&segment(k as usize))));
            }
            row
        };
        let rows: Vec<RayRow> = rows.clone().map(row).collect();
        let write_shapes = || geometry::write(&rows, resolution, per_band, opacities);
        let write_colors = || colors::write(&rows, per_band, colors);
        rayon::join(write_shapes, write_colors).into()
    };
    let coded: Vec<[Vec<u8>; 2]> = bands.par_iter().map(band).collect();
    join(&palette, &coded)
}

/// The geometry of a band of an image as [`encode`] takes it with `segments` supersegments in all, whose colors are in the palette.
///
/// # Panics
/// If it is not of whole rows, a color is not in the palette, or as [`encode`].
pub(super) fn encode_geometry(band: &VdiBand, resolution: usize, segments: usize, palette: &Palette) -> Vec<u8> {
    let [_, opacities] = palette.counts();
    geometry::write(&rows(band, resolution, palette), resolution, per_band(resolution, segments), opacities)
}

/// Its colors.
///
/// # Panics
/// As [`encode_geometry`].
pub(super) fn encode_colors(band: &VdiBand, resolution: usize, segments: usize, palette: &Palette) -> Vec<u8> {
    let [colors, _] = palette.counts();
    colors::write(&rows(band, resolution, palette), per_band(resolution, segments), colors)
}

fn rows(band: &VdiBand, resolution: usize, palette: &Palette) -> Vec<RayRow> {
    let (mut rows, mut lists) = (Vec::new(), band.lists());
    for _ in 0..band.rays() / resolution {
        let mut row = RayRow::new();
        lists.by_ref().take(resolution).for_each(|list| row.push(list.iter().map(|s| palette.entry(s))));
        rows.push(row);
    }
    rows
}

/// The table of all parts, and the parts: the palette, then geometry and colors of each band.
pub(super) fn join(palette: &Palette, bands: &[[Vec<u8>; 2]]) -> Vec<u8> {
    let palette = palette.to_bytes();
    let parts: Vec<&Vec<u8>> = std::iter::once(&palette).chain(bands.iter().flatten()).collect();
    let lengths = parts.iter().flat_map(|p| (p.len() as u64).to_le_bytes());
    lengths.chain(parts.iter().copied().flatten().copied()).collect()
}

/// Decodes all bands of `segments` supersegments, on all cores.
///
/// # Errors
/// If the lengths of parts do not fit the bytes, a value is impossible, or the number of supersegments differs.
pub(super) fn decode(bytes: &[u8], resolution: usize, segments: usize) -> Result<Vec<VdiBand>, EntropyError> {
    let parts = CodedRays::read(bytes, resolution, segments)?;
    // Supersegments left for all bands together, so that corrupt bands cannot allocate more than the header states.
    let left = AtomicUsize::new(segments);
    let decoded = (0..parts.bands.len()).into_par_iter().map(|k| parts.band(k, &left)).collect::<Result<_, _>>()?;
    if left.into_inner() > 0 { Err(EntropyError::InvalidValue) } else { Ok(decoded) }
}

/// The number of bytes that each band is coded in.
///
/// # Errors
/// If the lengths of parts do not fit the bytes, or the palette is damaged.
pub(super) fn coded_bytes(bytes: &[u8], resolution: usize, segments: usize) -> Result<Vec<usize>, EntropyError> {
    let parts = CodedRays::read(bytes, resolution, segments)?;
    Ok(parts.coded.iter().map(|[shapes, colors]| shapes.len() + colors.len()).collect())
}

/// The decoder of the geometry of band `k`.
///
/// # Errors
/// As [`coded_bytes`], or if there is no such band.
pub(super) fn geometry_decoder(
    bytes: &[u8],
    resolution: usize,
    segments: usize,
    k: usize,
) -> Result<GeometryDecoder, EntropyError> {
    let parts = CodedRays::with_band(bytes, resolution, segments, k)?;
    Ok(GeometryDecoder::of(&parts, k, segments))
}

/// The decoder of its colors.
///
/// # Errors
/// As [`geometry_decoder`].
pub(super) fn color_decoder(
    bytes: &[u8],
    resolution: usize,
    segments: usize,
    k: usize,
) -> Result<ColorDecoder, EntropyError> {
    Ok(ColorDecoder::of(CodedRays::with_band(bytes, resolution, segments, k)?, k))
}

/// What the rays of a VDI are coded as.
struct CodedRays<'a> {
    resolution: usize,
    palette: Palette,
    /// The rows of each band.
    bands: Vec<Range<usize>>,
    /// Of each band: geometry, colors.
    coded: Vec<[&'a [u8]; 2]>,
    /// Approximate number of supersegments of a band.
    per_band: usize,
}

impl<'a> CodedRays<'a> {
    fn read(bytes: &'a [u8], resolution: usize, segments: usize) -> Result<Self, EntropyError> {
        let bands = bands(resolution, segments);
        let count = 2 * bands.len() + 1;
        let (lengths, mut rest) = bytes.split_at_checked(8 * count).ok_or(EntropyError::LengthMismatch)?;
        let mut parts = Vec::with_capacity(count);
        for length in lengths.as_chunks::<8>().0 {
            let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| EntropyError::LengthMismatch)?;
            let (part, after) = rest.split_at_checked(length).ok_or(EntropyError::LengthMismatch)?;
            parts.push(part);
            rest = after;
        }
        if !rest.is_empty() {
            return Err(EntropyError::LengthMismatch);
        }
        let palette = Palette::read(parts[0], segments)?;
        let per_band = per_band(resolution, segments);
        let coded = parts[1..].as_chunks::<2>().0.to_vec();
        Ok(Self { resolution, palette, bands, coded, per_band })
    }

    fn with_band(bytes: &'a [u8], resolution: usize, segments: usize, k: usize) -> Result<Self, EntropyError> {
        let parts = Self::read(bytes, resolution, segments)?;
        if k < parts.bands.len() { Ok(parts) } else { Err(EntropyError::InvalidValue) }
    }

    /// Decodes band `k`, of at most as many supersegments as are `left`.
    fn band(&self, k: usize, left: &AtomicUsize) -> Result<VdiBand, EntropyError> {
        let (rows, [shapes, colors], per_band) = (self.bands[k].len(), self.coded[k], self.per_band);
        let [color_count, opacity_count] = self.palette.counts();
        let room = || left.fetch_update(Relaxed, Relaxed, |n| n.checked_sub(1)).is_ok();
        // Colors follow as soon as a row's geometry is known, on another core if there is one. The channel is unbounded:
        // on a single thread all rows wait until the last one's geometry is known.
        let (known, next) = channel();
        let read_shapes = || geometry::read(shapes, [self.resolution, rows], per_band, opacity_count, room, known);
        let mut band = VdiBand::default();
        let done = |row: &RayRow| {
            (0..row.ends.len() - 1).try_for_each(|x| band.push(row.ray(x).iter().map(|s| self.palette.segment(s))))
        };
        let read_colors = || colors::read(colors, next, per_band, color_count, done);
        let (shapes_read, colors_read) = rayon::join(read_shapes, read_colors);
        shapes_read.and(colors_read).map(|()| band)
    }
}
