//! Memory to compute a brick into, which the generator-node reads where it is.

use crate::{RunOptions, VoxelSlice};
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
    /// Of the run's fields.
    types: Vec<VoxelType>,
    memory: BufferMemory,
}

impl Buffer {
    /// Bytes of a box of `dims` sample points, of all fields.
    ///
    /// # Errors
    /// If that is beyond counting, or a field would not be aligned behind those before it.
    pub(crate) fn size(dims: [usize; 3], run: &RunOptions) -> Result<usize, Invalid> {
        let mut bytes = 0_usize;
        for (name, voxel_type) in run.fields() {
            if !bytes.is_multiple_of(voxel_type.size_bytes()) {
                let why = format!("{dims:?} voxels leave {name} unaligned; push a brick from memory of your own");
                return Err(Invalid::new("buffer", why));
            }
            let counted = dims.iter().try_fold(voxel_type.size_bytes(), |n, d| n.checked_mul(*d)).filter(|&n| n > 0);
            let none = || Invalid::new("buffer", format!("a box of {dims:?} is none"));
            bytes = counted.and_then(|field| bytes.checked_add(field)).ok_or_else(none)?;
        }
        Ok(bytes)
    }

    /// In `lease`, or in memory of this process where there is none.
    pub(crate) fn new(
        start: [usize; 3],
        dims: [usize; 3],
        run: &RunOptions,
        lease: Option<Lease>,
    ) -> Result<Self, Invalid> {
        let bytes = Self::size(dims, run)?;
        let memory = lease.map_or_else(|| BufferMemory::Own(vec![0; bytes.div_ceil(8)]), BufferMemory::Shared);
        Ok(Self { start, dims, types: run.fields().map(|(_, voxel_type)| voxel_type).collect(), memory })
    }

    fn voxels(&self) -> usize {
        self.dims.iter().product()
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

    /// The memory of each field.
    fn split_mut(&mut self) -> Vec<&mut [u8]> {
        let (voxels, types) = (self.voxels(), self.types.clone());
        let mut rest = self.bytes_mut();
        let mut field = |voxel_type: VoxelType| {
            let (field, behind) = std::mem::take(&mut rest).split_at_mut(voxels * voxel_type.size_bytes());
            rest = behind;
            field
        };
        types.into_iter().map(&mut field).collect()
    }

    /// Voxels of the run's field and, if it has another field, those of the next: colors, or the first of the further ones.
    ///
    /// # Errors
    /// If they are of other types.
    pub fn fields_mut<T: VoxelScalar, C: VoxelScalar>(&mut self) -> Result<(&mut [T], &mut [C]), Invalid> {
        crate::check_type("the field", T::TYPE, self.types[0])?;
        self.types.get(1).map_or(Ok(()), |second| crate::check_type("the second field", C::TYPE, *second))?;
        let mut fields = self.split_mut().into_iter();
        let (first, second) = (fields.next().unwrap_or_default(), fields.next().unwrap_or_default());
        Ok((cast_slice_mut(first), cast_slice_mut(second)))
    }

    /// Voxels of field `n` of the run: 0 is the first, then come the second, if there is one, and the further ones.
    ///
    /// # Errors
    /// If there is none, or it is of another type.
    pub fn field_mut<T: VoxelScalar>(&mut self, n: usize) -> Result<&mut [T], Invalid> {
        let missing =
            || Invalid::new("buffer", format!("the run has {} fields, and none of number {n}", self.types.len()));
        crate::check_type("the field", T::TYPE, *self.types.get(n).ok_or_else(missing)?)?;
        Ok(cast_slice_mut(self.split_mut().swap_remove(n)))
    }

    /// Voxels of the run's only field.
    ///
    /// # Errors
    /// If they are of another type, or the run has several.
    pub fn voxels_mut<T: VoxelScalar>(&mut self) -> Result<&mut [T], Invalid> {
        if self.types.len() > 1 {
            return Err(Invalid::new("buffer", "the run has a second field; ask for both"));
        }
        self.field_mut(0)
    }

    /// The slot that the node maps, if it is one.
    pub(crate) fn lease(&self) -> Option<&Lease> {
        match &self.memory {
            BufferMemory::Shared(lease) => Some(lease),
            BufferMemory::Own(_) => None,
        }
    }

    /// All fields, as voxels in memory.
    pub(crate) fn fields(&self) -> Vec<VoxelSlice<'_>> {
        let mut rest = self.bytes();
        let mut field = |voxel_type: &VoxelType| {
            let (field, behind) = rest.split_at(self.voxels() * voxel_type.size_bytes());
            rest = behind;
            slice(field, *voxel_type)
        };
        self.types.iter().map(&mut field).collect()
    }

    /// The address of each field: for callers that know no slices.
    pub fn addresses(&mut self) -> Vec<*mut u8> {
        self.split_mut().into_iter().map(<[u8]>::as_mut_ptr).collect()
    }

    /// True if these are its [`Self::addresses`].
    pub fn is_at(&self, fields: &[*const u8]) -> bool {
        let mut own = self.bytes().as_ptr();
        let mut is_next = |(field, voxel_type): (&*const u8, &VoxelType)| {
            let is_it = std::ptr::eq(own, *field);
            own = own.wrapping_add(self.voxels() * voxel_type.size_bytes());
            is_it
        };
        fields.len() == self.types.len() && fields.iter().zip(&self.types).all(&mut is_next)
    }

    /// Its first sample point in the run's grid.
    pub(crate) fn start(&self) -> [usize; 3] {
        self.start
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
