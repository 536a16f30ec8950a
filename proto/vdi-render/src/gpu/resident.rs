//! VDIs on the device: supersegments as two columns, and the parts of the acceleration grid that kernels read.

use super::GpuError;
use crate::kernel::arrays;
use crate::simd::{AccelerationGrid, PreparedRef};
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{Buffer, BufferUsages};
use lamina_compute::kernel::Resource;
use lamina_model::Vdi;

/// The most VDIs kept: the one viewed, and those measured meanwhile.
const KEPT: usize = 3;
/// The most bytes of VDIs kept besides the last one.
const KEPT_BYTES: u64 = 1 << 30;
/// Bytes of a supersegment's color and density, the largest array per supersegment.
const CONTENT_BYTES: u64 = 16;
/// Bytes per ray of the largest array per ray.
const RAY_BYTES: u64 = 16;
/// A VDI on the device.
#[derive(Debug)]
pub(super) struct ResidentVdi {
    id: u64,
    bytes: u64,
    /// Its buffers, in the order of bindings.
    pub buffers: [Buffer; 6],
}

/// The VDIs on the device, the last used last.
#[derive(Debug, Default)]
pub(super) struct ResidentVdis(Vec<ResidentVdi>);

impl ResidentVdis {
    /// `vdi` on the device, uploaded at first use. To be called inside [`Gpu::run`], after [`check_size`].
    pub(super) fn get(&mut self, gpu: &Gpu, vdi: PreparedRef) -> &ResidentVdi {
        let found = self.0.iter().position(|r| r.id == vdi.id).map(|n| self.0.remove(n));
        let resident = found.unwrap_or_else(|| {
            self.make_room();
            ResidentVdi::new(gpu, vdi)
        });
        self.0.push(resident);
        &self.0[self.0.len() - 1]
    }

    /// Removes the least recently used VDIs before another one is uploaded: there may be no room for both.
    fn make_room(&mut self) {
        while self.0.len() >= KEPT || self.0.iter().map(|r| r.bytes).sum::<u64>() > KEPT_BYTES {
            self.0.remove(0);
        }
    }
}

impl ResidentVdi {
    fn new(gpu: &Gpu, prepared: PreparedRef) -> Self {
        let buffers = arrays(prepared).map(|binding| match binding.resource {
            Resource::Uniform(bytes) => gpu.upload("stored", &bytes, BufferUsages::UNIFORM),
            Resource::Storage(bytes) => gpu.upload("array", &bytes, BufferUsages::STORAGE),
            Resource::Texture { .. } => unreachable!("a VDI has no textures"),
        });
        Self { id: prepared.id, bytes: buffers.iter().map(Buffer::size).sum(), buffers }
    }
}

/// Succeeds if no array of the VDI is larger than `most` bytes.
pub(super) fn check_size(most: u64, vdi: &Vdi, grid: &AccelerationGrid) -> Result<(), GpuError> {
    let (needed, limit) = (vdi.segments().len() as u64, most / CONTENT_BYTES);
    if needed > limit {
        let (what, unit, remedy) = ("the VDI", "supersegments", "raise gamma");
        return Err(GpuError::TooLarge { what, needed, limit, unit, remedy });
    }
    // There is one span more than rays, one for no ray, and the masks of tiles.
    let (needed, limit) = (grid.slots.len() as u64, (most / RAY_BYTES).saturating_sub(2));
    if needed > limit {
        let (what, unit, remedy) = ("the VDI", "rays", "lower the resolution");
        return Err(GpuError::TooLarge { what, needed, limit, unit, remedy });
    }
    Ok(())
}
