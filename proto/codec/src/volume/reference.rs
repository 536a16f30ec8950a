//! The step that another one is coded after.
use super::grid::Lattice;
use super::motion::Sampler;
use lamina_model::ReducedVolume;
use rayon::prelude::*;
use std::borrow::Cow;

/// A decoded reduced volume that others are coded after.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceVolume {
    checksum: u32,
    dims: [usize; 3],
    /// Positions in the range; 0 where a point is missing.
    values: Vec<f32>,
}

/// The CRC-32 that an encoded volume ends with.
pub fn checksum(bytes: &[u8]) -> u32 {
    bytes.last_chunk().map_or(0, |crc| u32::from_le_bytes(*crc))
}

impl ReferenceVolume {
    /// The volume that `bytes` decode to.
    pub fn new(bytes: &[u8], decoded: &ReducedVolume) -> Self {
        Self::of(checksum(bytes), decoded.grid().dims(), decoded.units())
    }

    /// The volume of `units`, as bytes with that checksum decode to: positions in the range, x fastest, NaN where a point is missing.
    pub fn of(checksum: u32, dims: [usize; 3], units: &[f32]) -> Self {
        let finite = |u: &f32| if u.is_finite() { *u } else { 0.0 };
        Self { checksum, dims, values: units.par_iter().map(finite).collect() }
    }

    /// The CRC-32 that its bytes end with, by which those coded after it name it.
    pub fn checksum(&self) -> u32 {
        self.checksum
    }

    /// Its sample points.
    pub fn points(&self) -> u64 {
        self.values.len() as u64
    }

    /// Its values at the points of a volume of `dims` points that fills the same box.
    pub(super) fn aligned(&self, dims: [usize; 3]) -> Cow<'_, [f32]> {
        if dims == self.dims {
            return Cow::Borrowed(&self.values);
        }
        let own = Sampler { values: &self.values, points: Lattice { dims: self.dims } };
        let scale: [f32; 3] =
            std::array::from_fn(|a| (self.dims[a] - 1) as f32 / dims[a].saturating_sub(1).max(1) as f32);
        let mut values = vec![0.0; dims.iter().product()];
        values.par_chunks_mut(dims[0] * dims[1]).enumerate().for_each(|(z, plane)| {
            for (n, value) in plane.iter_mut().enumerate() {
                let place = [n % dims[0], n / dims[0], z].map(|i| i as f32);
                *value = own.at(std::array::from_fn(|a| place[a] * scale[a]));
            }
        });
        Cow::Owned(values)
    }
}
