//! A VDI coded in bands by workers that share no memory, as the members of a group of generator-nodes: to the bytes of [`super::encode`].
//!
//! Each worker quantizes the rays it has ([`VdiBand::quantized`]) and tells the [`BandStatistics`] of them; of the union of all follow
//! the bands and the palette, with which each band is coded apart.

use super::band::VdiBand;
use super::context::{self, Palette};
use super::header::Contents;
use super::options::{Codec, EncodedHeader, Layout};
use crate::envelope::too_short;
use crate::error::{CodecError, invalid};
use lamina_model::VdiHeader;
use std::ops::Range;

/// What has to be known of all rays of a VDI before a band of it can be coded: how many supersegments there are, and their colors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BandStatistics {
    segments: u64,
    /// Rays with at least one supersegment.
    occupied_rays: u64,
    palette: Palette,
}

impl BandStatistics {
    /// Of the rays of `band`.
    pub fn of(band: &VdiBand) -> Self {
        Self {
            segments: band.segments().len() as u64,
            occupied_rays: band.lists().filter(|ray| !ray.is_empty()).count() as u64,
            palette: Palette::of(band.segments().iter().map(|s| s.code)),
        }
    }

    /// Of the rays of all `parts`, none of which is in two of them.
    pub fn union(parts: &[Self]) -> Self {
        Self {
            segments: parts.iter().map(|part| part.segments).sum(),
            occupied_rays: parts.iter().map(|part| part.occupied_rays).sum(),
            palette: Palette::union(parts.iter().map(|part| &part.palette)),
        }
    }

    /// Supersegments.
    pub fn segments(&self) -> u64 {
        self.segments
    }

    /// As [`Self::read`] takes them: the numbers of supersegments and of occupied rays, u64, little-endian, and the palette as coded.
    pub fn to_bytes(&self) -> Vec<u8> {
        let numbers = [self.segments, self.occupied_rays];
        numbers.into_iter().flat_map(u64::to_le_bytes).chain(self.palette.to_bytes()).collect()
    }

    /// The statistics that `bytes` are of.
    ///
    /// # Errors
    /// If the bytes are cut short, or what they hold cannot be.
    pub fn read(bytes: &[u8]) -> Result<Self, CodecError> {
        let (numbers, palette) = bytes.split_at_checked(16).ok_or_else(too_short)?;
        let [segments, occupied_rays] = *numbers.as_chunks::<8>().0 else { unreachable!("sixteen bytes") };
        let [segments, occupied_rays] = [segments, occupied_rays].map(u64::from_le_bytes);
        let most = usize::try_from(segments).unwrap_or(usize::MAX);
        let palette = Palette::read(palette, most).map_err(context::damaged)?;
        Ok(Self { segments, occupied_rays, palette })
    }

    /// The rows of each band of a VDI of `resolution` rays a side.
    pub fn bands(&self, resolution: u32) -> Vec<Range<usize>> {
        context::bands(resolution as usize, self.segments as usize)
    }

    /// Codes the geometry of a band of a VDI of `resolution` rays a side, all whose rays are in `band`.
    ///
    /// # Errors
    /// If they are not whole rows.
    pub fn encode_geometry(&self, resolution: u32, band: &VdiBand) -> Result<Vec<u8>, CodecError> {
        let row = whole_rows(resolution, band)?;
        Ok(context::encode_geometry(band, row, self.segments as usize, &self.palette))
    }

    /// The same of its colors.
    ///
    /// # Errors
    /// If they are not whole rows.
    pub fn encode_colors(&self, resolution: u32, band: &VdiBand) -> Result<Vec<u8>, CodecError> {
        let row = whole_rows(resolution, band)?;
        Ok(context::encode_colors(band, row, self.segments as usize, &self.palette))
    }

    /// The encoded VDI of all its `bands` in order, of each its geometry and its colors.
    ///
    /// # Errors
    /// If they are not as many, or it has 2^32 supersegments or more.
    pub fn encoded(&self, header: &VdiHeader, bands: &[[Vec<u8>; 2]]) -> Result<Vec<u8>, CodecError> {
        let [segments, occupied_rays] = [self.segments, self.occupied_rays].map(u32::try_from);
        let (Ok(segments), Ok(occupied_rays)) = (segments, occupied_rays) else {
            return Err(invalid(format!("it has {} supersegments, more than 2^32 - 1", self.segments)));
        };
        let wanted = self.bands(header.params.resolution()).len();
        if bands.len() != wanted {
            return Err(invalid(format!("{} bands of {wanted}", bands.len())));
        }
        let header = EncodedHeader { header: *header, codec: Codec::ContextMixing, layout: Layout::Columns, segments };
        super::framed(&Contents { header, occupied_rays }, |bytes| {
            bytes.extend(context::join(&self.palette, bands));
            Ok(())
        })
    }
}

/// Rays of a row.
fn whole_rows(resolution: u32, band: &VdiBand) -> Result<usize, CodecError> {
    let (rays, row) = (band.rays(), resolution as usize);
    if rays.is_multiple_of(row) { Ok(row) } else { Err(invalid(format!("{rays} rays are no rows of {row}"))) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DecodeLimits, EncodeOptions, decode, encode, quantize};
    use glam::DVec3;
    use lamina_model::{Aabb, Camera, Supersegment, Vdi, VdiParams};

    /// A VDI of so many rays a side with up to 60 supersegments on each, of 200 colors.
    fn vdi(resolution: u32) -> Vdi {
        let mut random = fastrand::Rng::with_seed(7);
        let (mut offsets, mut segments) = (vec![0], Vec::new());
        for _ in 0..resolution * resolution {
            let mut depth = 0;
            for _ in 0..random.u32(0..60) {
                let (start, shade) = (depth + random.u32(0..3), random.u8(0..200));
                let color = [f32::from(shade) / 255.0, 0.5, f32::from(shade / 2) / 255.0];
                depth = start + random.u32(1..9);
                segments.push(Supersegment { start, end: depth, color, optical_depth: random.f32() });
            }
            offsets.push(segments.len() as u32);
        }
        let header = VdiHeader {
            camera: Camera::new(DVec3::new(0.0, 0.0, 400.0), DVec3::ZERO, DVec3::Y, 30.0).unwrap(),
            bounds: Aabb::new(DVec3::splat(-100.0), DVec3::splat(100.0)).unwrap(),
            step_length: 0.5,
            params: VdiParams::new(resolution, 0.02).unwrap(),
            transfer_id: 3,
            background: [0.1; 3],
        };
        Vdi::new(header, offsets, segments).unwrap()
    }

    /// The rays of every `of`th row from row `first` on.
    fn rows(vdi: &Vdi, first: usize, of: usize) -> VdiBand {
        let r = vdi.resolution();
        let rays = (first as u32..r).step_by(of).flat_map(|row| (0..r).map(move |x| (x, row)));
        VdiBand::quantized(rays.map(|(x, row)| vdi.list(x, row)), vdi.header().params.gamma())
    }

    #[test]
    fn bands_coded_apart_are_the_bytes_of_all_coded_together() {
        for (resolution, bands) in [(16, 1), (131, 3)] {
            let vdi = vdi(resolution);
            let r = resolution as usize;
            for workers in [1, 3, 200] {
                let tiles: Vec<VdiBand> = (0..workers).map(|worker| rows(&vdi, worker, workers)).collect();
                let sent = tiles.iter().map(|tile| BandStatistics::of(tile).to_bytes());
                let read: Vec<_> = sent.map(|bytes| BandStatistics::read(&bytes).unwrap()).collect();
                let all = BandStatistics::union(&read);
                assert_eq!(all, BandStatistics::of(&rows(&vdi, 0, 1)));
                assert_eq!((all.segments(), all.bands(resolution).len()), (vdi.segments().len() as u64, bands));
                let code = |rows: Range<usize>| {
                    let mut band = VdiBand::default();
                    for row in rows {
                        let nth = row / workers;
                        band.append(&tiles[row % workers].slice(nth * r..(nth + 1) * r));
                    }
                    [all.encode_geometry(resolution, &band).unwrap(), all.encode_colors(resolution, &band).unwrap()]
                };
                let coded: Vec<_> = all.bands(resolution).into_iter().map(code).collect();
                let bytes = all.encoded(vdi.header(), &coded).unwrap();
                assert_eq!(bytes, encode(&vdi, &EncodeOptions::default()).unwrap(), "{workers}");
                assert_eq!(decode(&bytes, &DecodeLimits::default()).unwrap(), quantize(&vdi));
                assert!(all.encoded(vdi.header(), &coded[1..]).is_err());
            }
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let all = BandStatistics::of(&rows(&vdi(16), 0, 1));
        let bytes = all.to_bytes();
        (0..16).for_each(|end| assert!(BandStatistics::read(&bytes[..end]).is_err()));
        let fewer = [&1_u64.to_le_bytes()[..], &bytes[8..]].concat();
        assert!(BandStatistics::read(&fewer).is_err(), "more colors than supersegments");
        let mut half = VdiBand::default();
        half.append(&rows(&vdi(16), 0, 1).slice(0..24));
        assert!(all.encode_geometry(16, &half).is_err() && all.encode_colors(16, &half).is_err());
        assert!(BandStatistics { segments: 1 << 32, ..all }.encoded(vdi(16).header(), &[Default::default()]).is_err());
    }
}
