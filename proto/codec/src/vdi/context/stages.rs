//! A band decoded in two stages that share no memory: the geometry, slice by slice, and the colors of each slice once its geometry is
//! known. Two workers together take half as long as one.

use super::colors::ColorCoder;
use super::geometry::GeometryCoder;
use super::neighbors::{PaletteSegment, RayRow};
use super::palette::Palette;
use super::{CodedRays, QuantizedSegment};
use crate::entropy::EntropyError;
use crate::entropy::range_coder::{Decoder, Position};
use crate::error::{CodecError, invalid};
use crate::vdi::band::VdiBand;
use std::cell::Cell;
use std::fmt;

/// Supersegments from which on a slice ends with its row.
const SLICE: usize = 1 << 12;

/// Bytes of a part and where their decoder is.
#[derive(Debug)]
struct Coded {
    bytes: Vec<u8>,
    position: Position,
}

impl Coded {
    fn new(bytes: &[u8]) -> Self {
        Self { bytes: bytes.to_vec(), position: Decoder::new(bytes).position() }
    }

    /// What `read` reads next.
    fn next<T>(&mut self, read: impl FnOnce(&mut Decoder<'_>) -> T) -> T {
        let mut decoder = Decoder::at(self.position, &self.bytes);
        let found = read(&mut decoder);
        self.position = decoder.position();
        found
    }
}

/// Decodes the geometry of a band.
pub struct GeometryDecoder {
    coded: Coded,
    coder: GeometryCoder,
    above: RayRow,
    resolution: usize,
    rows_left: usize,
    /// Supersegments that there may still be.
    segments_left: usize,
}

impl fmt::Debug for GeometryDecoder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GeometryDecoder").field("position", &self.coded.position).finish_non_exhaustive()
    }
}

impl GeometryDecoder {
    /// The decoder of band `k` of `parts`, of at most `segments` supersegments.
    pub(super) fn of(parts: &CodedRays<'_>, k: usize, segments: usize) -> Self {
        let [_, opacities] = parts.palette.counts();
        Self {
            coded: Coded::new(parts.coded[k][0]),
            coder: GeometryCoder::new(parts.per_band, opacities),
            above: RayRow::new(),
            resolution: parts.resolution,
            rows_left: parts.bands[k].len(),
            segments_left: segments,
        }
    }

    /// The next rows, for [`ColorDecoder::take`]: without colors, and with places in the palette instead of opacities. `None` behind the last.
    ///
    /// # Errors
    /// If the bytes are damaged.
    pub fn slice(&mut self) -> Result<Option<VdiBand>, CodecError> {
        let mut slice = VdiBand::default();
        while self.rows_left > 0 && slice.segments().len() < SLICE {
            self.row(&mut slice).map_err(damaged)?;
        }
        Ok(if slice.ends().is_empty() { None } else { Some(slice) })
    }

    fn row(&mut self, slice: &mut VdiBand) -> Result<(), EntropyError> {
        let Self { coded, coder, above, resolution, segments_left, .. } = self;
        let left = Cell::new(*segments_left);
        let room = || left.get().checked_sub(1).map(|less| left.set(less)).is_some();
        *above = coded.next(|decoder| coder.row(decoder, *resolution, None, above, room))?;
        *segments_left = left.get();
        self.rows_left -= 1;
        (0..*resolution).try_for_each(|x| slice.push(above.ray(x).iter().map(without_color)))
    }
}

fn without_color(
    &PaletteSegment { start, end, opacity, .. }: &PaletteSegment,
) -> Result<QuantizedSegment, EntropyError> {
    let place = u8::try_from(opacity).map_err(|_| EntropyError::InvalidValue)?;
    Ok(QuantizedSegment { start, end, code: [0, 0, 0, place] })
}

/// Decodes the colors of a band.
pub struct ColorDecoder {
    coded: Coded,
    coder: ColorCoder,
    palette: Palette,
    above: RayRow,
    resolution: usize,
    band: VdiBand,
}

impl fmt::Debug for ColorDecoder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ColorDecoder").field("position", &self.coded.position).finish_non_exhaustive()
    }
}

impl ColorDecoder {
    /// The decoder of band `k` of `parts`.
    pub(super) fn of(parts: CodedRays<'_>, k: usize) -> Self {
        let [colors, _] = parts.palette.counts();
        Self {
            coded: Coded::new(parts.coded[k][1]),
            coder: ColorCoder::new(parts.per_band, colors),
            palette: parts.palette,
            above: RayRow::new(),
            resolution: parts.resolution,
            band: VdiBand::default(),
        }
    }

    /// Takes what [`GeometryDecoder::slice`] gave.
    ///
    /// # Errors
    /// If the bytes are damaged, or the slice has no whole rows.
    pub fn take(&mut self, slice: &VdiBand) -> Result<(), CodecError> {
        let rays: Vec<&[QuantizedSegment]> = slice.lists().collect();
        let rows = rays.chunks_exact(self.resolution);
        if !rows.remainder().is_empty() {
            return Err(damaged(EntropyError::LengthMismatch));
        }
        rows.into_iter().try_for_each(|rays| self.row(rays)).map_err(damaged)
    }

    fn row(&mut self, rays: &[&[QuantizedSegment]]) -> Result<(), EntropyError> {
        let mut row = RayRow::new();
        for ray in rays {
            row.push(ray.iter().map(|&QuantizedSegment { start, end, code: [.., place] }| PaletteSegment {
                start,
                end,
                opacity: place.into(),
                color: 0,
            }));
        }
        self.coded.next(|decoder| self.coder.row(decoder, &mut row, &self.above));
        for x in 0..rays.len() {
            self.band.push(row.ray(x).iter().map(|s| self.palette.segment(s)))?;
        }
        self.above = row;
        Ok(())
    }

    /// The band, once all slices are taken.
    pub fn finish(self) -> VdiBand {
        self.band
    }
}

/// What is wrong, as the codec says it.
pub(in crate::vdi) fn damaged(error: EntropyError) -> CodecError {
    invalid(error.to_string())
}
