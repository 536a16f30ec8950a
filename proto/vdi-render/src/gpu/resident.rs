//! VDIs on the device: supersegments as two columns, and the parts of the acceleration grid that kernels read.

use super::error::GpuError;
use super::layout::StoredVdi;
use crate::PreparedVdi;
use crate::simd::AccelerationGrid;
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{Buffer, BufferUsages};
use lamina_model::Vdi;
use rayon::prelude::*;
use std::ops::Deref;

/// The most VDIs kept: the one viewed, and those measured meanwhile.
const KEPT: usize = 3;
/// The most bytes of VDIs kept besides the last one.
const KEPT_BYTES: u64 = 1 << 30;
/// Bytes of a supersegment's color and density, the largest array per supersegment.
const CONTENT_BYTES: u64 = 16;
/// Bytes per ray of the largest array per ray.
const RAY_BYTES: u64 = 16;
/// Rounding error of positions on the scale of depth bins, in bins, besides the part that grows with the volume's extent.
const MARGIN: f64 = 2e-3;
/// Relative rounding error of depths, in units of the box.
const ROUNDING: f64 = 4e-6;

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
    pub(super) fn get<V: Deref<Target = Vdi>>(&mut self, gpu: &Gpu, vdi: &PreparedVdi<V>) -> &ResidentVdi {
        let found = self.0.iter().position(|r| r.id == vdi.id()).map(|n| self.0.remove(n));
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
    fn new<V: Deref<Target = Vdi>>(gpu: &Gpu, prepared: &PreparedVdi<V>) -> Self {
        let (vdi, grid) = (&**prepared.vdi(), prepared.grid());
        let masks: Vec<u64> = grid.masks.iter().flatten().copied().collect();
        let ends: Vec<[u32; 2]> = vdi.segments().par_iter().map(|s| [s.start, s.end]).collect();
        let upload = |label, bytes| gpu.upload(label, bytes, BufferUsages::STORAGE);
        let buffers = [
            gpu.upload("stored", bytemuck::bytes_of(&stored(vdi, grid)), BufferUsages::UNIFORM),
            upload("slots", bytemuck::cast_slice(&grid.slots)),
            upload("spans", bytemuck::cast_slice(&grid.spans)),
            // Little-endian, so the lower word comes first.
            upload("masks", bytemuck::cast_slice(&masks)),
            upload("ends", bytemuck::cast_slice(&ends)),
            upload("contents", bytemuck::cast_slice(&contents(vdi, grid))),
        ];
        Self { id: prepared.id(), bytes: buffers.iter().map(Buffer::size).sum(), buffers }
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

fn stored(vdi: &Vdi, grid: &AccelerationGrid) -> StoredVdi {
    let [near, far] = grid.depths;
    // The depth bins end at a quarter of the farthest depth, as in `DepthBins::new`.
    let thickness = far - near.max(0.25 * far);
    let lost = 64.0 * ROUNDING * vdi.header().bounds.size().length() / thickness;
    let tiles = |level: usize| grid.masks[level].len() as u32;
    StoredVdi {
        size: grid.size,
        first_masks: [tiles(0), tiles(0) + tiles(1)],
        depth: grid.middle as f32,
        far: (far - grid.middle) as f32,
        depth_bins: (grid.depth_bins.per_inverse_depth * grid.depth_bins.far) as f32,
        // A margin of 64 bins disables skipping.
        margin: (MARGIN + lost).clamp(MARGIN, 64.0) as f32,
    }
}

/// Colors and densities (optical depth per step).
fn contents(vdi: &Vdi, grid: &AccelerationGrid) -> Vec<[f32; 4]> {
    let both = vdi.segments().par_iter().zip(&grid.densities);
    both.map(|(s, &density)| [s.color[0], s.color[1], s.color[2], density]).collect()
}
