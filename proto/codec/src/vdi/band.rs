//! Rows of a VDI's rays with quantized colors, to be handed on between workers which share no memory and decode or encode one VDI together.

use super::context::QuantizedSegment;
use super::quantize;
use crate::envelope::too_short;
use crate::error::{CodecError, invalid};
use lamina_model::Supersegment;
use std::ops::Range;

/// Some rows of rays, from left to right and from top to bottom, with quantized colors: a band, whose rows are coded independently of all others,
/// or a slice of one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VdiBand {
    /// Offsets in `segments`: 0, then the end of each ray.
    ends: Vec<u32>,
    segments: Vec<QuantizedSegment>,
}

/// Bytes of a supersegment as transferred.
const SEGMENT_BYTES: usize = 12;

impl Default for VdiBand {
    fn default() -> Self {
        Self { ends: vec![0], segments: Vec::new() }
    }
}

impl VdiBand {
    /// The rays of `lists`, of a VDI with this gamma, quantized as [`super::encode`] does.
    pub fn quantized<'a>(lists: impl IntoIterator<Item = &'a [Supersegment]>, gamma: f64) -> Self {
        let (quantize, mut band) = (quantize::of_rays(gamma), Self::default());
        for list in lists {
            let segments = list.iter().zip(quantize(list));
            let segments = segments.map(|(s, code)| QuantizedSegment { start: s.start, end: s.end, code });
            band.segments.extend(segments);
            band.ends.push(band.segments.len() as u32);
        }
        band
    }

    /// Some of its rays.
    ///
    /// # Panics
    /// If it has not all of them.
    #[must_use]
    pub fn slice(&self, rays: Range<usize>) -> Self {
        let ends = &self.ends[rays.start..=rays.end];
        let first = ends[0];
        let segments = self.segments[first as usize..ends[rays.len()] as usize].to_vec();
        Self { ends: ends.iter().map(|end| end - first).collect(), segments }
    }

    /// Appends the rays of `other`.
    pub fn append(&mut self, other: &Self) {
        let before = self.segments.len() as u32;
        self.segments.extend_from_slice(&other.segments);
        self.ends.extend(other.ends().iter().map(|end| before + end));
    }

    /// Appends one ray.
    ///
    /// # Errors
    /// If one of `ray` is an error.
    pub(super) fn push<E>(&mut self, ray: impl IntoIterator<Item = Result<QuantizedSegment, E>>) -> Result<(), E> {
        for segment in ray {
            self.segments.push(segment?);
        }
        self.ends.push(self.segments.len() as u32);
        Ok(())
    }

    /// Where each ray ends in [`Self::segments`].
    pub(super) fn ends(&self) -> &[u32] {
        &self.ends[1..]
    }

    /// The number of rays.
    pub fn rays(&self) -> usize {
        self.ends.len() - 1
    }

    /// The supersegments of each ray.
    pub(super) fn lists(&self) -> impl Iterator<Item = &[QuantizedSegment]> {
        self.ends.windows(2).map(|ends| &self.segments[ends[0] as usize..ends[1] as usize])
    }

    /// The supersegments of all rays.
    pub(super) fn segments(&self) -> &[QuantizedSegment] {
        &self.segments
    }

    /// The band for [`Self::read`] of the same version: numbers of 32 bits, little-endian. The number of rays, the end of each ray, then start, end,
    /// red, green, blue and opacity of each supersegment.
    pub fn to_bytes(&self) -> Vec<u8> {
        let rays = self.rays();
        let mut bytes = Vec::with_capacity(4 * (1 + rays) + SEGMENT_BYTES * self.segments.len());
        bytes.extend((rays as u32).to_le_bytes());
        self.ends().iter().for_each(|end| bytes.extend(end.to_le_bytes()));
        for QuantizedSegment { start, end, code } in &self.segments {
            bytes.extend(start.to_le_bytes());
            bytes.extend(end.to_le_bytes());
            bytes.extend(code);
        }
        bytes
    }

    /// Takes a band from the front of `bytes`.
    ///
    /// # Errors
    /// If the bytes are cut short, or what they hold cannot be.
    pub fn read(bytes: &mut &[u8]) -> Result<Self, CodecError> {
        let rays = u32::from_le_bytes(*take::<4>(bytes, 1)?.first().ok_or_else(too_short)?) as usize;
        let mut ends = vec![0];
        ends.extend(take::<4>(bytes, rays)?.iter().copied().map(u32::from_le_bytes));
        if !ends.is_sorted() {
            return Err(invalid("the ends of a band's rays do not rise"));
        }
        let segments = take::<SEGMENT_BYTES>(bytes, ends[rays] as usize)?.iter().map(|bytes| {
            let [start, end, code] = *bytes.as_chunks::<4>().0 else { unreachable!("twelve bytes") };
            QuantizedSegment { start: u32::from_le_bytes(start), end: u32::from_le_bytes(end), code }
        });
        let segments: Vec<QuantizedSegment> = segments.collect();
        if segments.iter().any(|s| s.start >= s.end) {
            return Err(invalid("a supersegment of a band ends before it begins"));
        }
        Ok(Self { ends, segments })
    }
}

/// The first `count` pieces of `N` bytes.
fn take<'a, const N: usize>(bytes: &mut &'a [u8], count: usize) -> Result<&'a [[u8; N]], CodecError> {
    let length = count.checked_mul(N).ok_or_else(too_short)?;
    let (taken, rest) = bytes.split_at_checked(length).ok_or_else(too_short)?;
    *bytes = rest;
    Ok(taken.as_chunks().0)
}
