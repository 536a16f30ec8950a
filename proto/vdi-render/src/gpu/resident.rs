//! VDIs on the device: supersegments as two columns, and of what was prepared what the kernels look at.

use super::GpuError;
use super::layout::Stored;
use crate::PreparedVdi;
use crate::simd::Index;
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{Buffer, BufferUsages};
use lamina_model::Vdi;
use rayon::prelude::*;
use std::ops::Deref;

/// VDIs kept: what a viewer looks at, and what is measured meanwhile.
const KEPT: usize = 3;
/// Bytes that those beside the last one may take.
const KEPT_BYTES: u64 = 1 << 30;
/// Bytes of a supersegment's colour and optical depth: the largest array there is.
const CONTENT_BYTES: u64 = 16;
/// Bytes per ray of the largest array that grows with rays.
const RAY_BYTES: u64 = 16;
/// How many slabs places may be off beside what the volume's extent adds.
const MARGIN: f64 = 2e-3;
/// What the sums that give a depth may lose, in units of the box.
const ROUNDING: f64 = 4e-6;

/// A VDI on the device.
#[derive(Debug)]
pub struct Resident {
    id: u64,
    bytes: u64,
    /// In the order of their bindings.
    pub buffers: [Buffer; 6],
}

/// Those that are there, the last one used last.
#[derive(Debug, Default)]
pub struct Residents(Vec<Resident>);

impl Residents {
    /// `vdi` on the device, uploaded if it is not there. To be called inside [`Gpu::run`], after [`check_size`].
    pub fn get<V: Deref<Target = Vdi>>(&mut self, gpu: &Gpu, vdi: &PreparedVdi<V>) -> &Resident {
        let found = self.0.iter().position(|r| r.id == vdi.id()).map(|n| self.0.remove(n));
        let resident = found.unwrap_or_else(|| {
            self.make_room();
            Resident::new(gpu, vdi)
        });
        self.0.push(resident);
        &self.0[self.0.len() - 1]
    }

    /// The oldest go first, and before another one comes: there may be no room for both.
    fn make_room(&mut self) {
        while self.0.len() >= KEPT || self.0.iter().map(|r| r.bytes).sum::<u64>() > KEPT_BYTES {
            self.0.remove(0);
        }
    }
}

impl Resident {
    fn new<V: Deref<Target = Vdi>>(gpu: &Gpu, prepared: &PreparedVdi<V>) -> Self {
        let (vdi, index) = (&**prepared.vdi(), prepared.index());
        let masks: Vec<u64> = index.masks.iter().flatten().copied().collect();
        let ends: Vec<[u32; 2]> = vdi.segments().par_iter().map(|s| [s.start, s.end]).collect();
        let upload = |label, bytes| gpu.upload(label, bytes, BufferUsages::STORAGE);
        let buffers = [
            gpu.upload("stored", bytemuck::bytes_of(&stored(vdi, index)), BufferUsages::UNIFORM),
            upload("slots", bytemuck::cast_slice(&index.slots)),
            upload("spans", bytemuck::cast_slice(&index.spans)),
            // Little-endian, so the lower word comes first.
            upload("masks", bytemuck::cast_slice(&masks)),
            upload("ends", bytemuck::cast_slice(&ends)),
            upload("contents", bytemuck::cast_slice(&contents(vdi, index))),
        ];
        Self { id: prepared.id(), bytes: buffers.iter().map(Buffer::size).sum(), buffers }
    }
}

/// Passes a VDI none of whose arrays is larger than `most` bytes.
pub fn check_size(most: u64, vdi: &Vdi, index: &Index) -> Result<(), GpuError> {
    let (needed, limit) = (vdi.segments().len() as u64, most / CONTENT_BYTES);
    if needed > limit {
        let (what, unit, remedy) = ("the VDI", "supersegments", "raise gamma");
        return Err(GpuError::TooLarge { what, needed, limit, unit, remedy });
    }
    // One span more than rays, one for none, and masks of tiles.
    let (needed, limit) = (index.slots.len() as u64, (most / RAY_BYTES).saturating_sub(2));
    if needed > limit {
        let (what, unit, remedy) = ("the VDI", "rays", "lower the resolution");
        return Err(GpuError::TooLarge { what, needed, limit, unit, remedy });
    }
    Ok(())
}

fn stored(vdi: &Vdi, index: &Index) -> Stored {
    let [near, far] = index.depths;
    // As where the slabs begin and end: nearer than a quarter of the farthest depth all is one.
    let thickness = far - near.max(0.25 * far);
    let lost = 64.0 * ROUNDING * vdi.header().bounds.size().length() / thickness;
    let tiles = |level: usize| index.masks[level].len() as u32;
    Stored {
        size: index.size,
        first_masks: [tiles(0), tiles(0) + tiles(1)],
        depth: index.middle as f32,
        far: (far - index.middle) as f32,
        slabs: (index.slabs.per_inverse_depth * index.slabs.far) as f32,
        // With 64 or more nothing is passed over.
        margin: (MARGIN + lost).clamp(MARGIN, 64.0) as f32,
    }
}

/// Colours, and optical depth per step.
fn contents(vdi: &Vdi, index: &Index) -> Vec<[f32; 4]> {
    let both = vdi.segments().par_iter().zip(&index.densities);
    both.map(|(s, &density)| [s.color[0], s.color[1], s.color[2], density]).collect()
}
