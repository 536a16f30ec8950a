//! Partition of large volumes into bands of planes, coded independently on all cores.
//!
//! Models start untrained in each band, which at [`BAND_VOXELS`] costs about a percent of the bytes. The partition follows
//! from the grid's dimensions alone.
use super::encode::{PredictedBand, encode as encode_band};
use super::{ErrorMeasure, Tolerance, decode::decode as decode_band, wavelet};
use crate::entropy::EntropyError;
use rayon::prelude::*;
use std::ops::Range;

/// Approximate voxels of a band.
const BAND_VOXELS: usize = 1 << 22;
/// Fewest planes of a band.
const BAND_PLANES: usize = 16;
/// First bytes of bands that may be coded in several ways.
const PREDICTED: u8 = 0;
const WAVELET: u8 = 1;
const TEMPORAL: u8 = 2;

/// Planes of each band of a volume of `dims` voxels.
fn bands([nx, ny, nz]: [usize; 3]) -> Vec<Range<usize>> {
    let plane = nx.saturating_mul(ny);
    let count = (plane.saturating_mul(nz) / BAND_VOXELS).min(nz / BAND_PLANES).max(1);
    (0..count).map(|k| k * nz / count..(k + 1) * nz / count).collect()
}

/// Encodes `values` of a volume of `dims` voxels (x fastest), all finite, so that each decodes within `tolerance` or, where `free` gives an interval for a voxel's index, within that interval; or, by
/// [`ErrorMeasure::MeanSquare`], with a mean square error that is no greater. `before` holds the values of a volume that resembles
/// this one, if there is one.
///
/// # Panics
/// If `dims` do not multiply to the number of values.
pub(super) fn encode(
    values: &[f32],
    dims: [usize; 3],
    tolerance: Tolerance,
    free: impl Fn(usize) -> Option<(f32, f32)> + Sync,
    measure: ErrorMeasure,
    before: Option<&[f32]>,
) -> CodedBands {
    assert_eq!(dims.iter().product::<usize>(), values.len(), "a volume has as many values as voxels");
    let plane = dims[0] * dims[1];
    let band = |z: Range<usize>| {
        let (first, dims) = (z.start * plane, [dims[0], dims[1], z.len()]);
        let values = &values[first..z.end * plane];
        let free = |n: usize| free(first + n);
        let before = before.map(|before| &before[first..first + values.len()]);
        let (kind, mut predicted) = predicted(before, |before| encode_band(values, dims, tolerance, free, before));
        let bytes = std::mem::take(&mut predicted.bytes);
        let decoded = predicted.decoded();
        let other = match measure {
            ErrorMeasure::Maximum | ErrorMeasure::Everywhere => None,
            ErrorMeasure::MeanSquare => wavelet::encode(values, dims, free, &decoded, bytes.len()),
        };
        other.map_or((kind, bytes, decoded), |(bytes, decoded)| (WAVELET, bytes, decoded))
    };
    let coded: Vec<(u8, Vec<u8>, Vec<f32>)> = bands(dims).into_par_iter().map(band).collect();
    let is_marked = coded.iter().any(|(kind, ..)| *kind != PREDICTED);
    let mark = |kind: u8| is_marked.then_some(kind);
    let lengths = coded.iter().flat_map(|(_, c, _)| ((c.len() + usize::from(is_marked)) as u64).to_le_bytes());
    let bytes = coded.iter().flat_map(|(kind, c, _)| mark(*kind).into_iter().chain(c.iter().copied()));
    let bytes = lengths.chain(bytes).collect();
    let is_temporal = coded.iter().any(|(kind, ..)| *kind == TEMPORAL);
    let decoded = joined(coded.into_iter().map(|(.., decoded)| decoded), values.len());
    CodedBands { bytes, decoded, is_marked, is_temporal }
}

/// All bands of a volume.
pub(super) struct CodedBands {
    pub bytes: Vec<u8>,
    /// The values as they decode.
    pub decoded: Vec<f32>,
    /// Each band begins with a byte that says how it is coded.
    pub is_marked: bool,
    /// A decoder has to have the volume before.
    pub is_temporal: bool,
}

/// The band coded after the volume before, if there is one and it saves bytes.
fn predicted(before: Option<&[f32]>, code: impl Fn(Option<&[f32]>) -> PredictedBand) -> (u8, PredictedBand) {
    let Some(before) = before else { return (PREDICTED, code(None)) };
    let temporal = code(Some(before));
    if temporal.is_corrected {
        return (TEMPORAL, temporal);
    }
    let alone = code(None);
    if temporal.bytes.len() < alone.bytes.len() { (TEMPORAL, temporal) } else { (PREDICTED, alone) }
}

/// Decodes a volume of `dims` voxels coded with the same `tolerance`, and after `before` if there is one; `is_marked` as [`encode`]
/// returned it.
///
/// # Errors
/// If the lengths of bands do not fit the bytes, or a value is impossible.
pub(super) fn decode(
    bytes: &[u8],
    dims: [usize; 3],
    tolerance: Tolerance,
    is_marked: bool,
    before: Option<&[f32]>,
) -> Result<Vec<f32>, EntropyError> {
    let plane = dims[0].checked_mul(dims[1]).ok_or(EntropyError::SizeOverflow)?;
    let voxels = plane.checked_mul(dims[2]).ok_or(EntropyError::SizeOverflow)?;
    let bands = bands(dims);
    let (lengths, mut rest) = bytes.split_at_checked(8 * bands.len()).ok_or(EntropyError::LengthMismatch)?;
    let mut coded = Vec::with_capacity(bands.len());
    for length in lengths.as_chunks::<8>().0 {
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| EntropyError::LengthMismatch)?;
        let (band, after) = rest.split_at_checked(length).ok_or(EntropyError::LengthMismatch)?;
        coded.push(band);
        rest = after;
    }
    if !rest.is_empty() {
        return Err(EntropyError::LengthMismatch);
    }
    let band = |(z, bytes): (Range<usize>, &[u8])| {
        let before = before.map(|before| &before[z.start * plane..z.end * plane]);
        let dims = [dims[0], dims[1], z.len()];
        match (is_marked, bytes.split_first(), before) {
            (false, ..) => decode_band(bytes, dims, tolerance, None),
            (true, Some((&PREDICTED, bytes)), _) => decode_band(bytes, dims, tolerance, None),
            (true, Some((&WAVELET, bytes)), _) => wavelet::decode(bytes, dims),
            (true, Some((&TEMPORAL, bytes)), Some(before)) => decode_band(bytes, dims, tolerance, Some(before)),
            (true, ..) => Err(EntropyError::InvalidValue),
        }
    };
    let decoded: Vec<Vec<f32>> = bands.into_par_iter().zip(coded).map(band).collect::<Result<_, EntropyError>>()?;
    Ok(joined(decoded.into_iter(), voxels))
}

/// All `bands` in one piece of `voxels`.
fn joined(mut bands: impl Iterator<Item = Vec<f32>>, voxels: usize) -> Vec<f32> {
    let mut values = bands.next().unwrap_or_default();
    values.reserve_exact(voxels.saturating_sub(values.len()));
    bands.for_each(|b| values.extend(b));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_all_planes_once_and_are_neither_many_nor_thin() {
        for dims in [[1, 1, 1], [256, 256, 256], [4096, 4096, 40], [128, 128, 128], [5000, 5000, 3], [9, 9, 100_000]] {
            let bands = bands(dims);
            assert_eq!((bands[0].start, bands[bands.len() - 1].end), (0, dims[2]));
            assert!(bands.windows(2).all(|w| w[0].end == w[1].start));
            assert!(bands.len() == 1 || bands.iter().all(|b| b.len() >= BAND_PLANES));
        }
        assert_eq!(bands([256, 256, 256]).len(), 4);
        assert_eq!(bands([128, 128, 128]).len(), 1);
    }

    #[test]
    fn a_volume_in_bands_comes_back_within_the_bound_and_cut_bytes_are_refused() {
        let dims = [520, 300, 64];
        let values: Vec<f32> = (0..dims.iter().product::<usize>())
            .map(|n| {
                (0.01 * (n % 520) as f32).sin() + (0.02 * (n / 520 % 300) as f32).cos() + 1e-3 * (n / 156_000) as f32
            })
            .collect();
        assert_eq!(bands(dims).len(), 2);
        let free = |n: usize| (n >= 156_000 * 40).then_some((-9.0, 9.0));
        let CodedBands { bytes, is_marked, .. } =
            encode(&values, dims, Tolerance::Bound(0.02), free, ErrorMeasure::Maximum, None);
        assert!(!is_marked);
        let back = decode(&bytes, dims, Tolerance::Bound(0.02), false, None).unwrap();
        assert_eq!(back.len(), values.len());
        // What is free in the second band is free by its own index.
        let worst = |z: Range<usize>| {
            let off = |n: usize| (values[n] - back[n]).abs();
            (z.start * 156_000..z.end * 156_000).map(off).fold(0.0, f32::max)
        };
        assert!(worst(0..40) <= 0.02 * 1.0001 && worst(40..64) > 0.02, "{} {}", worst(0..40), worst(40..64));
        for n in [0, 3, 15, 16, bytes.len() - 1] {
            assert!(decode(&bytes[..n], dims, Tolerance::Bound(0.02), false, None).is_err(), "{n} bytes");
        }
        assert!(decode(&[&bytes[..], &[0]].concat(), dims, Tolerance::Bound(0.02), false, None).is_err());
    }
}
