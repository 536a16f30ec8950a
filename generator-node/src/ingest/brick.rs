//! A rank's part of a time step, and bricks joined to a whole grid.

use lamina_model::{Grid, Invalid, VoxelType, Voxels};
use lamina_shared_memory::SharedBytes;
use std::ops::{Deref, Range};

/// A brick that a rank would push, as it announces it.
#[derive(Debug, Clone, Copy)]
pub struct BrickOffer {
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// Whose brick.
    pub rank: u32,
    /// Which of the rank's bricks of the step, counted from 0.
    pub index: u32,
    /// How many it has; with 0 the box means nothing.
    pub bricks: u32,
    /// First sample point.
    pub start: [u64; 3],
    /// Sample points per axis.
    pub dims: [u64; 3],
}

/// An index box of a grid, checked to lie inside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridBox {
    start: [usize; 3],
    dims: [usize; 3],
}

impl GridBox {
    /// The box of `dims` sample points from `start` on.
    ///
    /// # Errors
    /// If it is empty or reaches beyond `grid`.
    pub fn new(start: [u64; 3], dims: [u64; 3], grid: &Grid) -> Result<Self, Invalid> {
        for axis in 0..3 {
            let side = grid.dims()[axis] as u64;
            let end = start[axis].checked_add(dims[axis]);
            if dims[axis] == 0 || end.is_none_or(|end| end > side) {
                let reason = format!("{dims:?} voxels from {start:?} do not fit the run's grid {:?}", grid.dims());
                return Err(Invalid::new("brick", reason));
            }
        }
        Ok(Self { start: start.map(|v| v as usize), dims: dims.map(|v| v as usize) })
    }

    /// Index of the first sample point.
    pub fn start(&self) -> [usize; 3] {
        self.start
    }

    /// Sample points per axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Its indices along each axis.
    pub fn ranges(&self) -> [Range<usize>; 3] {
        [0, 1, 2].map(|a| self.start[a]..self.start[a] + self.dims[a])
    }

    /// What the two have in common.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let start = [0, 1, 2].map(|a| self.start[a].max(other.start[a]));
        let end = [0, 1, 2].map(|a| (self.start[a] + self.dims[a]).min(other.start[a] + other.dims[a]));
        (0..3).all(|a| start[a] < end[a]).then(|| Self { start, dims: [0, 1, 2].map(|a| end[a] - start[a]) })
    }

    /// The two as one box, if they share a whole face.
    pub fn union(&self, other: &Self) -> Option<Self> {
        let differ: Vec<usize> =
            (0..3).filter(|&a| (self.start[a], self.dims[a]) != (other.start[a], other.dims[a])).collect();
        let &[a] = differ.as_slice() else { return None };
        let (first, second) = if self.start[a] < other.start[a] { (self, other) } else { (other, self) };
        let mut union = *first;
        union.dims[a] += second.dims[a];
        (first.start[a] + first.dims[a] == second.start[a]).then_some(union)
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// True if the two share a voxel.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|a| self.start[a] < other.start[a] + other.dims[a] && other.start[a] < self.start[a] + self.dims[a])
    }
}

/// Bytes of a brick: its voxels, little-endian, x fastest; those of a second field follow.
#[derive(Debug)]
pub enum BrickBytes {
    /// Received.
    Own(Vec<u8>),
    /// Read where the simulation wrote them.
    Shared(SharedBytes),
}

impl Deref for BrickBytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match self {
            Self::Own(bytes) => bytes,
            Self::Shared(bytes) => bytes,
        }
    }
}

impl From<Vec<u8>> for BrickBytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Own(bytes)
    }
}

/// The voxels that bricks with these bytes make up; they hold `voxel_type` numbers. Where they do not cover the grid, NaN is between them,
/// and integers become single precision.
pub(super) fn join<'a>(
    grid: &Grid,
    voxel_type: VoxelType,
    bricks: impl ExactSizeIterator<Item = (GridBox, &'a [u8])>,
) -> Voxels {
    let bricks: Vec<(GridBox, &[u8])> = bricks.collect();
    if bricks.iter().map(|(brick, _)| brick.voxels()).sum::<usize>() < grid.voxels() {
        return with_hole(grid, voxel_type, &bricks);
    }
    let mut bricks = bricks.into_iter().peekable();
    if bricks.len() == 1
        && let Some((_, bytes)) = bricks.peek()
    {
        return Voxels::from_le_bytes(voxel_type, bytes);
    }
    let size = voxel_type.size_bytes();
    let mut whole = vec![0; grid.voxels() * size];
    bricks.for_each(|(brick, bytes)| place(&mut whole, grid, &brick, bytes, size));
    Voxels::from_le_bytes(voxel_type, &whole)
}

/// Copies the numbers of `brick`, of `size` bytes each, to where they belong in the whole grid's.
fn place(whole: &mut [u8], grid: &Grid, brick: &GridBox, bytes: &[u8], size: usize) {
    let ([nx, ny, _], [x0, y0, z0], [bx, by, bz]) = (grid.dims(), brick.start, brick.dims);
    let mut rows = bytes.chunks_exact(bx * size);
    for (z, y) in (z0..z0 + bz).flat_map(|z| (y0..y0 + by).map(move |y| (z, y))) {
        let at = ((z * ny + y) * nx + x0) * size;
        if let Some(row) = rows.next() {
            whole[at..at + row.len()].copy_from_slice(row);
        }
    }
}

/// Bytes of a voxel that is missing: NaN; of integers, which have none, 0.
pub(super) fn missing(voxel_type: VoxelType) -> Vec<u8> {
    match voxel_type {
        VoxelType::F64 => f64::NAN.to_le_bytes().to_vec(),
        VoxelType::F32 => f32::NAN.to_le_bytes().to_vec(),
        VoxelType::F16 => 0x7e00_u16.to_le_bytes().to_vec(),
        VoxelType::U8 | VoxelType::U16 | VoxelType::I16 => vec![0; voxel_type.size_bytes()],
    }
}

/// The voxels of bricks that leave a hole: double precision stays, all else becomes single.
fn with_hole(grid: &Grid, voxel_type: VoxelType, bricks: &[(GridBox, &[u8])]) -> Voxels {
    let wide = if voxel_type == VoxelType::F64 { VoxelType::F64 } else { VoxelType::F32 };
    let mut whole = missing(wide).repeat(grid.voxels());
    for (brick, bytes) in bricks {
        let voxels = Voxels::from_le_bytes(voxel_type, bytes);
        let values = (0..voxels.len()).map(|n| voxels.get(n));
        let widened: Vec<u8> = match wide {
            VoxelType::F64 => values.flat_map(f64::to_le_bytes).collect(),
            _ => values.flat_map(|v| (v as f32).to_le_bytes()).collect(),
        };
        place(&mut whole, grid, brick, &widened, wide.size_bytes());
    }
    Voxels::from_le_bytes(wide, &whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn bricks_join_to_the_volume_they_were_cut_from() {
        let grid = Grid::new([4, 3, 2], DVec3::ONE, DVec3::ZERO).unwrap();
        let value = |x: u64, y: u64, z: u64| (x + 10 * y + 100 * z) as u16;
        let cut = |start: [u64; 3], dims: [u64; 3]| {
            let mut bytes = Vec::new();
            for (z, y) in
                (start[2]..start[2] + dims[2]).flat_map(|z| (start[1]..start[1] + dims[1]).map(move |y| (z, y)))
            {
                bytes.extend((start[0]..start[0] + dims[0]).flat_map(|x| value(x, y, z).to_le_bytes()));
            }
            (GridBox::new(start, dims, &grid).unwrap(), bytes)
        };
        let bricks = [cut([0, 0, 0], [1, 3, 2]), cut([1, 0, 0], [3, 3, 1]), cut([1, 0, 1], [3, 3, 1])];
        let joined = join(&grid, VoxelType::U16, bricks.iter().map(|(brick, bytes)| (*brick, &**bytes)));
        let (brick, whole) = cut([0, 0, 0], [4, 3, 2]);
        assert_eq!(joined, join(&grid, VoxelType::U16, std::iter::once((brick, &*whole))));
        let Voxels::F32(holed) = join(&grid, VoxelType::U16, bricks[..2].iter().map(|(b, bytes)| (*b, &**bytes)))
        else {
            panic!("another type");
        };
        for (n, v) in holed.iter().enumerate() {
            let [x, y, z] = [n % 4, n / 4 % 3, n / 12].map(|c| c as u64);
            let is_there = x == 0 || z == 0;
            assert!(if is_there { *v == f32::from(value(x, y, z)) } else { v.is_nan() }, "{x} {y} {z}: {v}");
        }
    }

    #[test]
    fn boxes_outside_or_empty_are_refused_and_overlap_is_seen() {
        let grid = Grid::new([4, 4, 4], DVec3::ONE, DVec3::ZERO).unwrap();
        assert!(GridBox::new([0, 0, 3], [4, 4, 2], &grid).is_err());
        assert!(GridBox::new([0, 0, 0], [4, 0, 4], &grid).is_err());
        assert!(GridBox::new([u64::MAX, 0, 0], [2, 1, 1], &grid).is_err());
        let b = |z, n| GridBox::new([0, 0, z], [4, 4, n], &grid).unwrap();
        assert!(b(0, 3).overlaps(&b(2, 2)) && !b(0, 2).overlaps(&b(2, 2)));
    }
}
