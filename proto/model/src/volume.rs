//! Regular grids of scalars as simulations and scanners write them.

use crate::{Aabb, Invalid};
use glam::DVec3;
use half::f16;
use serde::{Deserialize, Serialize};

/// The most voxels a volume may have: 2^37 (a 5000^3 grid), so that every byte count fits 64 bits with room to spare.
pub const MAX_VOXELS: u64 = 1 << 37;

/// The type of one voxel as handed in, little-endian where it travels as bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoxelType {
    /// Unsigned 8 bits.
    U8,
    /// Unsigned 16 bits.
    U16,
    /// Signed 16 bits.
    I16,
    /// IEEE 754 half precision.
    F16,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

impl VoxelType {
    /// Bytes of one voxel.
    pub fn size_bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl std::str::FromStr for VoxelType {
    type Err = Invalid;
    fn from_str(s: &str) -> Result<Self, Invalid> {
        match s.to_ascii_lowercase().as_str() {
            "u8" | "uint8" | "uchar" => Ok(Self::U8),
            "u16" | "uint16" | "ushort" => Ok(Self::U16),
            "i16" | "int16" | "short" => Ok(Self::I16),
            "f16" | "float16" | "half" => Ok(Self::F16),
            "f32" | "float32" | "float" => Ok(Self::F32),
            "f64" | "float64" | "double" => Ok(Self::F64),
            _ => Err(Invalid::new(
                "voxel type",
                format!("\"{s}\" is none of uint8, uint16, int16, float16, float32, float64"),
            )),
        }
    }
}

impl std::fmt::Display for VoxelType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::F64 => "float64",
        })
    }
}

/// Where the voxels lie: sample points at `origin + index * spacing`, x fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    spacing: DVec3,
    origin: DVec3,
}

impl Grid {
    /// A grid of `dims` sample points.
    ///
    /// # Errors
    /// If a dimension is 0, the grid exceeds [`MAX_VOXELS`], or spacing and origin are not finite with positive spacing.
    pub fn new(dims: [usize; 3], spacing: DVec3, origin: DVec3) -> Result<Self, Invalid> {
        if dims.contains(&0) {
            return Err(Invalid::new(
                "grid.dims",
                format!("{dims:?} has a side of 0 voxels; every side needs one or more"),
            ));
        }
        let voxels = dims.iter().try_fold(1u64, |n, &d| n.checked_mul(d as u64)).filter(|&n| n <= MAX_VOXELS);
        if voxels.is_none() {
            return Err(Invalid::new("grid.dims", format!("{dims:?} exceeds {MAX_VOXELS} voxels")));
        }
        if !spacing.is_finite() || spacing.min_element() <= 0.0 {
            return Err(Invalid::new("grid.spacing", format!("{spacing} must be finite and positive on every axis")));
        }
        if !origin.is_finite() {
            return Err(Invalid::new("grid.origin", format!("{origin} must be finite")));
        }
        let grid = Self { dims, spacing, origin };
        if !grid.bounds().size().is_finite() || grid.bounds().max.cmple(grid.bounds().min).any() {
            return Err(Invalid::new(
                "grid",
                format!("spacing {spacing} vanishes beside origin {origin} in double precision"),
            ));
        }
        Ok(grid)
    }

    /// Sample points per axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }
    /// World distance between neighboring sample points, per axis.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }
    /// World position of sample point (0, 0, 0).
    pub fn origin(&self) -> DVec3 {
        self.origin
    }
    /// Number of sample points.
    pub fn voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// The most sample points on an axis.
    pub fn longest_side(&self) -> u32 {
        self.dims.into_iter().max().map_or(0, |n| u32::try_from(n).unwrap_or(u32::MAX))
    }

    /// The world length called "one voxel": the smallest spacing.
    pub fn voxel_length(&self) -> f64 {
        self.spacing.min_element()
    }

    /// The box that is drawn: from the first to the last sample point. An axis with a single sample point is drawn one
    /// spacing thick, so that a slice is visible.
    pub fn bounds(&self) -> Aabb {
        let (mut min, mut max) = (self.origin, self.origin);
        for axis in 0..3 {
            if self.dims[axis] == 1 {
                min[axis] -= 0.5 * self.spacing[axis];
                max[axis] += 0.5 * self.spacing[axis];
            } else {
                max[axis] += (self.dims[axis] - 1) as f64 * self.spacing[axis];
            }
        }
        Aabb { min, max }
    }
}

/// Scalars in their own type, x fastest, then y, then z.
#[derive(Debug, Clone, PartialEq)]
pub enum Voxels {
    /// Unsigned 8 bits.
    U8(Vec<u8>),
    /// Unsigned 16 bits.
    U16(Vec<u16>),
    /// Signed 16 bits.
    I16(Vec<i16>),
    /// Half precision.
    F16(Vec<f16>),
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

/// Runs `$body` with `$v` bound to the typed vector inside `$voxels`.
#[macro_export]
macro_rules! for_voxels {
    ($voxels:expr, $v:ident => $body:expr) => {
        match $voxels {
            $crate::Voxels::U8($v) => $body,
            $crate::Voxels::U16($v) => $body,
            $crate::Voxels::I16($v) => $body,
            $crate::Voxels::F16($v) => $body,
            $crate::Voxels::F32($v) => $body,
            $crate::Voxels::F64($v) => $body,
        }
    };
}

impl Voxels {
    /// Number of scalars.
    pub fn len(&self) -> usize {
        for_voxels!(self, v => v.len())
    }
    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// The type of one scalar.
    pub fn voxel_type(&self) -> VoxelType {
        match self {
            Self::U8(_) => VoxelType::U8,
            Self::U16(_) => VoxelType::U16,
            Self::I16(_) => VoxelType::I16,
            Self::F16(_) => VoxelType::F16,
            Self::F32(_) => VoxelType::F32,
            Self::F64(_) => VoxelType::F64,
        }
    }
    /// Scalar `index` in double precision.
    pub fn get(&self, index: usize) -> f64 {
        match self {
            Self::U8(v) => f64::from(v[index]),
            Self::U16(v) => f64::from(v[index]),
            Self::I16(v) => f64::from(v[index]),
            Self::F16(v) => f64::from(v[index]),
            Self::F32(v) => f64::from(v[index]),
            Self::F64(v) => v[index],
        }
    }

    /// Scalars from little-endian bytes; `bytes` must be a whole number of them (a rest is ignored).
    pub fn from_le_bytes(voxel_type: VoxelType, bytes: &[u8]) -> Self {
        match voxel_type {
            VoxelType::U8 => Self::U8(bytes.to_vec()),
            VoxelType::U16 => Self::U16(bytes.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect()),
            VoxelType::I16 => Self::I16(bytes.as_chunks().0.iter().map(|b| i16::from_le_bytes(*b)).collect()),
            VoxelType::F16 => Self::F16(bytes.as_chunks().0.iter().map(|b| f16::from_le_bytes(*b)).collect()),
            VoxelType::F32 => Self::F32(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()),
            VoxelType::F64 => Self::F64(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
        }
    }

    /// Scalars `range` as little-endian bytes.
    pub fn to_le_bytes(&self, range: std::ops::Range<usize>) -> Vec<u8> {
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

/// A scalar field on a grid, and perhaps a second one, for colors.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    grid: Grid,
    voxels: Voxels,
    /// Its name and scalars.
    color_field: Option<(String, Voxels)>,
}

impl Volume {
    /// Joins a grid and its scalars.
    ///
    /// # Errors
    /// If there are not as many scalars as grid points.
    pub fn new(grid: Grid, voxels: Voxels) -> Result<Self, Invalid> {
        check_number("volume", &grid, &voxels)?;
        Ok(Self { grid, voxels, color_field: None })
    }

    /// The same with a second field called `name`, from which a scene may take its colors
    /// ([`ColorField`](crate::effects::ColorField)).
    ///
    /// # Errors
    /// If there are not as many scalars as grid points.
    pub fn with_color_field(self, name: &str, voxels: Voxels) -> Result<Self, Invalid> {
        check_number("color field", &self.grid, &voxels)?;
        Ok(Self { color_field: Some((name.to_owned(), voxels)), ..self })
    }

    /// Where the voxels lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
    /// The scalars.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }
    /// The second field's name and scalars, if there is one.
    pub fn color_field(&self) -> Option<(&str, &Voxels)> {
        self.color_field.as_ref().map(|(name, voxels)| (name.as_str(), voxels))
    }
    /// Grid, scalars and second field, owned.
    pub fn into_parts(self) -> (Grid, Voxels, Option<(String, Voxels)>) {
        (self.grid, self.voxels, self.color_field)
    }
    /// Bytes of the scalars, those of the second field among them.
    pub fn size_bytes(&self) -> usize {
        let bytes = |v: &Voxels| v.len() * v.voxel_type().size_bytes();
        bytes(&self.voxels) + self.color_field().map_or(0, |(_, v)| bytes(v))
    }
}

fn check_number(thing: &'static str, grid: &Grid, voxels: &Voxels) -> Result<(), Invalid> {
    let (have, want) = (voxels.len(), grid.voxels());
    if have == want {
        return Ok(());
    }
    Err(Invalid::new(thing, format!("{have} voxels given, a grid of {:?} needs {want}", grid.dims())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_spans_first_to_last_sample_point_and_a_slice_is_one_spacing_thick() {
        let g = Grid::new([3, 1, 2], DVec3::new(1.0, 2.0, 10.0), DVec3::new(5.0, 0.0, 0.0)).unwrap();
        assert_eq!(g.bounds(), Aabb { min: DVec3::new(5.0, -1.0, 0.0), max: DVec3::new(7.0, 1.0, 10.0) });
        assert_eq!(g.voxel_length(), 1.0);
    }

    #[test]
    fn impossible_grids_are_refused() {
        let e = |d, s, o| Grid::new(d, DVec3::splat(s), DVec3::splat(o)).unwrap_err().thing;
        assert_eq!(e([0, 1, 1], 1.0, 0.0), "grid.dims");
        assert_eq!(e([usize::MAX, 2, 2], 1.0, 0.0), "grid.dims");
        assert_eq!(e([2, 2, 2], 0.0, 0.0), "grid.spacing");
        assert_eq!(e([2, 2, 2], 1.0, f64::INFINITY), "grid.origin");
        assert_eq!(e([2, 2, 2], 1e-12, 1e7), "grid");
    }

    #[test]
    fn bytes_go_and_come_back_for_every_type() {
        for v in [
            Voxels::U8(vec![1, 255]),
            Voxels::U16(vec![1, 65535]),
            Voxels::I16(vec![-1, 32767]),
            Voxels::F16(vec![f16::from_f32(-0.5), f16::MAX]),
            Voxels::F32(vec![-0.5, f32::MAX]),
            Voxels::F64(vec![1e-300, -2.0]),
        ] {
            assert_eq!(Voxels::from_le_bytes(v.voxel_type(), &v.to_le_bytes(0..2)), v);
            assert_eq!(v.voxel_type().to_string().parse::<VoxelType>().unwrap(), v.voxel_type());
        }
        assert!("int128".parse::<VoxelType>().is_err());
    }
}
