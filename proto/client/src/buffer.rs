//! Memory to compute a brick into, which the generator-node reads where it is.

use crate::{Brick, RunOptions, VoxelSlice};
use bytemuck::{Pod, cast_slice, cast_slice_mut};
use half::f16;
use lamina_model::{Invalid, VoxelType};
use lamina_shared_memory::Lease;

/// A number that voxels can be.
pub trait VoxelScalar: Pod {
    /// Its type.
    const TYPE: VoxelType;
}

macro_rules! scalars {
    ($($t:ty, $variant:ident);*) => {$(
        impl VoxelScalar for $t {
            const TYPE: VoxelType = VoxelType::$variant;
        }
    )*};
}
scalars!(u8, U8; u16, U16; i16, I16; f16, F16; f32, F32; f64, F64);

#[derive(Debug)]
enum BufferMemory {
    /// A slot that the node maps, too.
    Shared(Lease),
    /// Of this process alone; eight bytes at a time, so that any voxel is aligned.
    Own(Vec<u64>),
}

/// A brick to be filled: an index box of the run's grid, x fastest, without gaps. What it holds at first is of no meaning.
#[derive(Debug)]
pub struct Buffer {
    start: [usize; 3],
    dims: [usize; 3],
    voxel_type: VoxelType,
    color_type: Option<VoxelType>,
    memory: BufferMemory,
}

impl Buffer {
    /// Bytes of a box of `dims` sample points, and of its first field alone.
    ///
    /// # Errors
    /// If that is beyond counting, or the second field would not be aligned behind the first.
    pub(crate) fn sizes(dims: [usize; 3], run: &RunOptions) -> Result<(usize, usize), Invalid> {
        let bytes_of = |voxel_type: VoxelType| {
            dims.iter().try_fold(voxel_type.size_bytes(), |n, d| n.checked_mul(*d)).filter(|&n| n > 0)
        };
        let none = || Invalid::new("buffer", format!("a box of {dims:?} is none"));
        let first = bytes_of(run.voxel_type).ok_or_else(none)?;
        let Some((name, color_type)) = &run.color_field else { return Ok((first, first)) };
        if !first.is_multiple_of(color_type.size_bytes()) {
            let why = format!("{dims:?} voxels leave {name} unaligned; push a brick from memory of your own");
            return Err(Invalid::new("buffer", why));
        }
        let both = bytes_of(*color_type).and_then(|second| first.checked_add(second)).ok_or_else(none)?;
        Ok((both, first))
    }

    /// In `lease`, or in memory of this process where there is none.
    pub(crate) fn new(
        start: [usize; 3],
        dims: [usize; 3],
        run: &RunOptions,
        lease: Option<Lease>,
    ) -> Result<Self, Invalid> {
        let (bytes, _) = Self::sizes(dims, run)?;
        let memory = lease.map_or_else(|| BufferMemory::Own(vec![0; bytes.div_ceil(8)]), BufferMemory::Shared);
        let color_type = run.color_field.as_ref().map(|(_, t)| *t);
        Ok(Self { start, dims, voxel_type: run.voxel_type, color_type, memory })
    }

    fn first_bytes(&self) -> usize {
        self.dims.iter().product::<usize>() * self.voxel_type.size_bytes()
    }

    fn bytes(&self) -> &[u8] {
        match &self.memory {
            BufferMemory::Shared(lease) => lease.bytes(),
            BufferMemory::Own(words) => cast_slice(words),
        }
    }

    fn bytes_mut(&mut self) -> &mut [u8] {
        match &mut self.memory {
            BufferMemory::Shared(lease) => lease.bytes_mut(),
            BufferMemory::Own(words) => cast_slice_mut(words),
        }
    }

    /// Voxels of the run's field and, if it has a second field, the colors.
    ///
    /// # Errors
    /// If they are of other types.
    pub fn fields_mut<T: VoxelScalar, C: VoxelScalar>(&mut self) -> Result<(&mut [T], &mut [C]), Invalid> {
        crate::check_type("the field", T::TYPE, self.voxel_type)?;
        let count = self.dims.iter().product::<usize>();
        let (first, colors) = (self.first_bytes(), self.color_type);
        let (voxels, rest) = self.bytes_mut().split_at_mut(first);
        let Some(color_type) = colors else { return Ok((cast_slice_mut(voxels), &mut [])) };
        crate::check_type("the second field", C::TYPE, color_type)?;
        Ok((cast_slice_mut(voxels), cast_slice_mut(&mut rest[..count * color_type.size_bytes()])))
    }

    /// Voxels of the run's only field.
    ///
    /// # Errors
    /// If they are of another type, or the run has a second field.
    pub fn voxels_mut<T: VoxelScalar>(&mut self) -> Result<&mut [T], Invalid> {
        if self.color_type.is_some() {
            return Err(Invalid::new("buffer", "the run has a second field; ask for both"));
        }
        Ok(self.fields_mut::<T, u8>()?.0)
    }

    /// The slot that the node maps, if it is one.
    pub(crate) fn lease(&self) -> Option<&Lease> {
        match &self.memory {
            BufferMemory::Shared(lease) => Some(lease),
            BufferMemory::Own(_) => None,
        }
    }

    /// As voxels in memory.
    pub(crate) fn brick(&self) -> Brick<'_> {
        let count = self.dims.iter().product::<usize>();
        let (voxels, rest) = self.bytes().split_at(self.first_bytes());
        let brick = Brick::new(self.start, self.dims, slice(voxels, self.voxel_type));
        let Some(color_type) = self.color_type else { return brick };
        brick.with_colors(slice(&rest[..count * color_type.size_bytes()], color_type))
    }

    /// The voxels' address, and the colors' or null: for callers that know no slices.
    pub fn addresses(&mut self) -> (*mut u8, *mut u8) {
        let (first, colors) = (self.first_bytes(), self.color_type.is_some());
        let (voxels, rest) = self.bytes_mut().split_at_mut(first);
        (voxels.as_mut_ptr(), if colors { rest.as_mut_ptr() } else { std::ptr::null_mut() })
    }

    /// True if these are its [`Self::addresses`].
    pub fn is_at(&self, voxels: *const u8, colors: *const u8) -> bool {
        let (first, rest) = self.bytes().split_at(self.first_bytes());
        let second = if self.color_type.is_some() { rest.as_ptr() } else { std::ptr::null() };
        std::ptr::eq(first.as_ptr(), voxels) && std::ptr::eq(second, colors)
    }

    /// The box.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The same box elsewhere in the grid.
    #[must_use]
    pub fn at(self, start: [usize; 3]) -> Self {
        Self { start, ..self }
    }
}

fn slice(bytes: &[u8], voxel_type: VoxelType) -> VoxelSlice<'_> {
    match voxel_type {
        VoxelType::U8 => VoxelSlice::U8(bytes),
        VoxelType::U16 => VoxelSlice::U16(cast_slice(bytes)),
        VoxelType::I16 => VoxelSlice::I16(cast_slice(bytes)),
        VoxelType::F16 => VoxelSlice::F16(cast_slice(bytes)),
        VoxelType::F32 => VoxelSlice::F32(cast_slice(bytes)),
        VoxelType::F64 => VoxelSlice::F64(cast_slice(bytes)),
    }
}
