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

    fn le_bytes(&self, range: std::ops::Range<usize>) -> Vec<u8> {
        match self {
            Self::U8(v) => v[range].to_vec(),
            Self::U16(v) => v[range].iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::I16(v) => v[range].iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::F16(v) => v[range].iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::F32(v) => v[range].iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::F64(v) => v[range].iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }
}

/// An index box of the run's grid and its voxels, x fastest.
#[derive(Debug, Clone, Copy)]
pub struct Brick<'a> {
    pub(crate) start: [usize; 3],
    pub(crate) dims: [usize; 3],
    voxels: VoxelSlice<'a>,
    colors: Option<VoxelSlice<'a>>,
}

impl<'a> Brick<'a> {
    /// The box of `dims` sample points from `start` on.
    pub fn new(start: [usize; 3], dims: [usize; 3], voxels: impl Into<VoxelSlice<'a>>) -> Self {
        Self { start, dims, voxels: voxels.into(), colors: None }
    }

    /// The same with the voxels of the run's second field.
    #[must_use]
    pub fn with_colors(self, colors: impl Into<VoxelSlice<'a>>) -> Self {
        Self { colors: Some(colors.into()), ..self }
    }

    /// Refuses, before anything is sent, what cannot belong to the run.
    pub(crate) fn check(&self, run: &RunOptions) -> Result<(), Invalid> {
        let check = |field: &str, voxels: &VoxelSlice, of_run: VoxelType| {
            let (have, want) = (voxels.len(), self.dims.iter().product::<usize>());
            if have != want || want == 0 {
                return Err(Invalid::new("brick", format!("{have} voxels of {field} for a box of {:?}", self.dims)));
            }
            let given = voxels.voxel_type();
            if given != of_run {
                return Err(Invalid::new("brick", format!("{given} voxels of {field}; the run has {of_run}")));
            }
            Ok(())
        };
        check(&run.field, &self.voxels, run.voxel_type)?;
        match (&self.colors, &run.color_field) {
            (None, None) => Ok(()),
            (Some(colors), Some((name, voxel_type))) => check(name, colors, *voxel_type),
            (None, Some((name, _))) => {
                Err(Invalid::new("brick", format!("no voxels of {name}; add them by with_colors")))
            }
            (Some(_), None) => {
                let reason = "voxels of a second field, which the run's options do not name (color_field)";
                Err(Invalid::new("brick", reason))
            }
        }
    }

    /// Its bytes, those of the second field last, in pieces of about `chunk_bytes`, converted one at a time.
    pub(crate) fn chunks(&self, chunk_bytes: usize) -> impl Iterator<Item = Vec<u8>> + '_ {
        std::iter::once(&self.voxels).chain(&self.colors).flat_map(move |voxels| {
            let per_chunk = (chunk_bytes / voxels.voxel_type().size_bytes()).max(1);
            let len = voxels.len();
            (0..len).step_by(per_chunk).map(move |start| voxels.le_bytes(start..len.min(start + per_chunk)))
        })
    }
}
