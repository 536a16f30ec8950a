//! A rank's part of a time step, borrowed from the simulation's memory.

use crate::RunOptions;
use half::f16;
use lamina_model::{Invalid, VoxelType};

/// Voxels in the simulation's own memory.
#[derive(Debug, Clone, Copy)]
pub enum VoxelSlice<'a> {
    /// Unsigned 8 bits.
    U8(&'a [u8]),
    /// Unsigned 16 bits.
    U16(&'a [u16]),
    /// Signed 16 bits.
    I16(&'a [i16]),
    /// Half precision.
    F16(&'a [f16]),
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

macro_rules! from_slices {
    ($($variant:ident $scalar:ty),*) => {$(
        impl<'a> From<&'a [$scalar]> for VoxelSlice<'a> {
            fn from(v: &'a [$scalar]) -> Self { Self::$variant(v) }
        }
        impl<'a> From<&'a Vec<$scalar>> for VoxelSlice<'a> {
            fn from(v: &'a Vec<$scalar>) -> Self { Self::$variant(v) }
        }
    )*};
}
from_slices!(U8 u8, U16 u16, I16 i16, F16 f16, F32 f32, F64 f64);

impl<'a> From<&'a lamina_model::Voxels> for VoxelSlice<'a> {
    fn from(voxels: &'a lamina_model::Voxels) -> Self {
        lamina_model::for_voxels!(voxels, v => v.into())
    }
}

impl VoxelSlice<'_> {
    fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::F16(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    fn voxel_type(&self) -> VoxelType {
        match self {
            Self::U8(_) => VoxelType::U8,
            Self::U16(_) => VoxelType::U16,
            Self::I16(_) => VoxelType::I16,
            Self::F16(_) => VoxelType::F16,
            Self::F32(_) => VoxelType::F32,
            Self::F64(_) => VoxelType::F64,
        }
    }

    /// Copies the bytes of those that `rows` picks, as many as `to` has.
    fn copy_le_bytes(&self, rows: impl Iterator<Item = VoxelRow>, to: &mut [u8]) {
        match self {
            Self::U8(v) => copy(v, rows, |x| [x], to),
            Self::U16(v) => copy(v, rows, u16::to_le_bytes, to),
            Self::I16(v) => copy(v, rows, i16::to_le_bytes, to),
            Self::F16(v) => copy(v, rows, f16::to_le_bytes, to),
            Self::F32(v) => copy(v, rows, f32::to_le_bytes, to),
            Self::F64(v) => copy(v, rows, f64::to_le_bytes, to),
        }
    }
}

fn copy<T: Copy, const N: usize>(
    v: &[T],
    rows: impl Iterator<Item = VoxelRow>,
    le: impl Fn(T) -> [u8; N],
    mut to: &mut [u8],
) {
    for VoxelRow { first, len, stride } in rows {
        let (row, rest) = std::mem::take(&mut to).split_at_mut(N * len);
        to = rest;
        let places = row.as_chunks_mut().0.iter_mut();
        // Neighbors in memory are copied many at a time.
        if stride == 1 {
            places.zip(&v[first..first + len]).for_each(|(place, &x)| *place = le(x));
        } else {
            places.zip(v[first..].iter().step_by(stride.max(1))).for_each(|(place, &x)| *place = le(x));
        }
    }
}

/// Voxels evenly apart in memory.
struct VoxelRow {
    first: usize,
    len: usize,
    stride: usize,
}

/// Strides of a box of voxels without gaps, x fastest.
pub fn dense(dims: [usize; 3]) -> [usize; 3] {
    [1, dims[0], dims[0].saturating_mul(dims[1])]
}

/// How many voxels in memory a box whose neighbors lie `strides` apart reaches over, from its first to its last.
///
/// # Errors
/// If the box is empty, or reaches beyond counting.
pub fn span(dims: [usize; 3], strides: [usize; 3]) -> Result<usize, Invalid> {
    let axes = || dims.into_iter().zip(strides);
    let reach = |span: usize, (d, s): (usize, usize)| span.checked_add(d.checked_sub(1)?.checked_mul(s)?);
    let counted = dims.iter().try_fold(1_usize, |n, d| n.checked_mul(*d));
    let span = axes().try_fold(1, reach).filter(|_| !axes().any(|(d, s)| d > 1 && s == 0));
    let none = || Invalid::new("brick", format!("a box of {dims:?}, neighbors {strides:?} apart, is none"));
    counted.and(span).ok_or_else(none)
}

/// Refuses voxels of another type than the run has of `field`.
///
/// # Errors
/// If they are.
pub fn check_type(field: &str, given: VoxelType, of_run: VoxelType) -> Result<(), Invalid> {
    let other = || Invalid::new("brick", format!("{given} voxels of {field}; the run has {of_run}"));
    if given == of_run { Ok(()) } else { Err(other()) }
}

/// An index box of the run's grid and its voxels, x fastest unless [`Brick::with_strides`] says otherwise.
#[derive(Debug, Clone, Copy)]
pub struct Brick<'a> {
    pub(crate) start: [usize; 3],
    pub(crate) dims: [usize; 3],
    /// How far voxels that are neighbors along x, y, z lie apart in memory, in voxels.
    strides: [usize; 3],
    voxels: VoxelSlice<'a>,
    colors: Option<VoxelSlice<'a>>,
    more: &'a [VoxelSlice<'a>],
}

impl<'a> Brick<'a> {
    /// The box of `dims` sample points from `start` on.
    pub fn new(start: [usize; 3], dims: [usize; 3], voxels: impl Into<VoxelSlice<'a>>) -> Self {
        Self { start, dims, strides: dense(dims), voxels: voxels.into(), colors: None, more: &[] }
    }

    /// The same where the voxels, in memory from the box's first one on, lie so many voxels apart along x, y and z: inside of
    /// ghost cells, or with z fastest.
    #[must_use]
    pub fn with_strides(self, strides: [usize; 3]) -> Self {
        Self { strides, ..self }
    }

    /// The same with the voxels of the run's second field.
    #[must_use]
    pub fn with_colors(self, colors: impl Into<VoxelSlice<'a>>) -> Self {
        Self { colors: Some(colors.into()), ..self }
    }

    /// The same with the voxels of the run's further fields, in their order.
    #[must_use]
    pub fn with_more_fields(self, more: &'a [VoxelSlice<'a>]) -> Self {
        Self { more, ..self }
    }

    /// The voxels of all its fields.
    fn fields(&self) -> impl Iterator<Item = &VoxelSlice<'a>> {
        std::iter::once(&self.voxels).chain(&self.colors).chain(self.more)
    }

    /// Refuses, before anything is sent, what cannot belong to the run.
    pub(crate) fn check(&self, run: &RunOptions) -> Result<(), Invalid> {
        let span = span(self.dims, self.strides)?;
        let count = self.dims.iter().product::<usize>();
        let check = |field: &str, voxels: &VoxelSlice, of_run: VoxelType| {
            let have = voxels.len();
            // Of strided ones the slice may go on after the last.
            if have < span || (have > span && count == span) {
                let apart = if count == span { String::new() } else { format!(", which reach over {span}") };
                let reason = format!("{have} voxels of {field} for a box of {:?}{apart}", self.dims);
                return Err(Invalid::new("brick", reason));
            }
            check_type(field, voxels.voxel_type(), of_run)
        };
        check(&run.field, &self.voxels, run.voxel_type)?;
        if self.more.len() != run.more_fields.len() {
            let (have, need) = (self.more.len(), run.more_fields.len());
            let reason = format!("voxels of {have} further fields; the run's options name {need} (more_fields)");
            return Err(Invalid::new("brick", reason));
        }
        for (voxels, (name, voxel_type)) in self.more.iter().zip(&run.more_fields) {
            check(name, voxels, *voxel_type)?;
        }
        match (&self.colors, &run.color_field) {
            (None, None) => Ok(()),
            (Some(colors), Some((name, voxel_type))) => check(name, colors, *voxel_type),
            (None, Some((name, _))) => {
                Err(Invalid::new("brick", format!("no voxels of {name}, the second field that the run's options name")))
            }
            (Some(_), None) => {
                let reason = "voxels of a second field, which the run's options do not name (color_field)";
                Err(Invalid::new("brick", reason))
            }
        }
    }

    /// Voxels `from` up to, not including, `to`, counted with x fastest.
    fn rows(&self, from: usize, to: usize) -> impl Iterator<Item = VoxelRow> {
        let ([nx, ny, nz], [sx, sy, sz]) = (self.dims, self.strides);
        // Without gaps everything is one row.
        let whole = self.strides == dense(self.dims);
        let nx = if whole { nx * ny * nz } else { nx };
        (from / nx..to.div_ceil(nx)).map(move |row| {
            let (begin, end) = (from.max(row * nx), to.min((row + 1) * nx));
            VoxelRow { first: row % ny * sy + row / ny * sz + (begin - row * nx) * sx, len: end - begin, stride: sx }
        })
    }

    /// Its bytes, field by field, in pieces of about `chunk_bytes`, converted one at a time.
    pub(crate) fn chunks(&self, chunk_bytes: usize) -> impl Iterator<Item = Vec<u8>> + '_ {
        self.fields().flat_map(move |voxels| {
            let voxel_bytes = voxels.voxel_type().size_bytes();
            let per_chunk = (chunk_bytes / voxel_bytes).max(1);
            let len = self.dims.iter().product::<usize>();
            let piece = move |start: usize| {
                let end = len.min(start + per_chunk);
                let mut bytes = vec![0; (end - start) * voxel_bytes];
                voxels.copy_le_bytes(self.rows(start, end), &mut bytes);
                bytes
            };
            (0..len).step_by(per_chunk).map(piece)
        })
    }

    /// How many bytes that is.
    pub(crate) fn size_bytes(&self) -> usize {
        let point: usize = self.fields().map(|voxels| voxels.voxel_type().size_bytes()).sum();
        self.dims.iter().product::<usize>() * point
    }

    /// All its bytes into `to`, which has room for them.
    pub(crate) fn copy_to(&self, mut to: &mut [u8]) {
        let len = self.dims.iter().product::<usize>();
        for voxels in self.fields() {
            let (field, rest) = std::mem::take(&mut to).split_at_mut(len * voxels.voxel_type().size_bytes());
            voxels.copy_le_bytes(self.rows(0, len), field);
            to = rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strided_voxels_are_sent_as_a_copy_without_gaps_would_be() {
        // 3 x 4 x 2 inside of one ghost cell on each side, x fastest; then the same with z fastest.
        let dims = [3, 4, 2];
        let copy: Vec<u16> = (0..24).map(|n| 1000 + n).collect();
        let at = |x: usize, y: usize, z: usize| copy[x + 3 * (y + 4 * z)];
        let sent = |brick: &Brick, chunk| brick.chunks(chunk).flatten().collect::<Vec<u8>>();
        for strides in [[1, 5, 30], [24, 4, 1]] {
            let first = strides.iter().sum::<usize>();
            let mut padded = vec![7_u16; 5 * 6 * 4];
            for (n, place) in (0..24).map(|n| (n, [n % 3, n / 3 % 4, n / 12])) {
                let offset = place.iter().zip(strides).map(|(p, s)| p * s).sum::<usize>();
                padded[first + offset] = at(place[0], place[1], place[2]);
                assert_eq!(padded[first + offset], copy[n]);
            }
            let run = RunOptions::new(
                "",
                "",
                "f",
                lamina_model::Grid::new([9; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap(),
                VoxelType::U16,
            );
            let strided = Brick::new([0; 3], dims, &padded[first..]).with_strides(strides);
            strided.check(&run).unwrap();
            for chunk in [2, 10, 1 << 20] {
                assert_eq!(sent(&strided, chunk), sent(&Brick::new([0; 3], dims, &copy), 4096), "{strides:?} {chunk}");
            }
            let short = Brick::new([0; 3], dims, &padded[..span(dims, strides).unwrap() - 1]).with_strides(strides);
            assert!(short.check(&run).unwrap_err().reason.contains("which reach over"));
            let absurd = strided.with_strides([usize::MAX; 3]);
            assert!(absurd.check(&run).unwrap_err().reason.contains("is none"));
        }
    }
}
