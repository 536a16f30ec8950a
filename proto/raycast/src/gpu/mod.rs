//! Ray casting and VDI generation on a GPU: WGSL counterparts of [`super::reference`] in single precision, and their host code.
//!
//! The device holds one field, the last one used. A kernel returns a whole result or a [`GpuError`], never a part of an image.
//! The choice between GPU and processor is made elsewhere ([`crate::Backend`]).

mod effects;
mod generate;
mod pipelines;
mod raycast;
mod resident;
mod scan;
#[cfg(test)]
mod tests;

pub use crate::gpu_ray_caster::GpuError;

use super::Field;
use crate::gpu_ray_caster::GpuRayCaster;
use crate::kernel::effects::EffectSet;
use crate::kernel::layout::ViewUniforms;
use effects::EffectResources;
use lamina_compute::gpu::wgpu::{BindGroup, BufferUsages};
use lamina_compute::gpu::{AdapterFacts, DeviceError, Gpu};
use lamina_model::{Camera, Image, Segmentation, Vdi, VdiParams};
use parking_lot::Mutex;
use pipelines::{MarchPipelines, Pipelines};
use resident::ResidentField;
use std::time::Duration;

/// Bytes of supersegments written by one dispatch: enough to keep the device busy, few enough that the processor, which works on
/// the chunk before, has little to do after the last one.
const CHUNK_BYTES: u64 = 32 << 20;
/// Rays or pixels of one dispatch: far less than a second of work, so that no watchdog takes it for a hang.
const BAND: u64 = 1 << 22;

/// The compiled kernels on one device.
#[derive(Debug)]
pub struct GpuKernels {
    gpu: Gpu,
    pipelines: Pipelines,
    /// Also serializes work, which would otherwise share the device's memory.
    state: Mutex<KernelCache>,
    chunk_bytes: u64,
}

#[derive(Debug, Default)]
struct KernelCache {
    marches: Vec<MarchPipelines>,
    resident: Option<ResidentField>,
}

/// A field and the rays of a camera, bound to the kernels.
struct BoundField<'a> {
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    march: &'a MarchPipelines,
    /// Group 0.
    field: BindGroup,
    /// Group 2.
    effects: BindGroup,
}

impl BoundField<'_> {
    /// The bind groups other than group 1, by number.
    fn bindings(&self) -> [(u32, &BindGroup); 2] {
        [(0, &self.field), (2, &self.effects)]
    }
}

/// The rays of a picture or VDI.
struct PerspectiveRays<'a> {
    camera: &'a Camera,
    width: u32,
    height: u32,
    step_length: f64,
}

impl GpuKernels {
    /// Compiles the kernels that do not depend on the field.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Gpu) -> Result<Self, GpuError> {
        let pipelines = gpu.run("compiling kernels", || Ok::<_, DeviceError>(Pipelines::new(&gpu)))?;
        let chunk_bytes = gpu.max_binding_bytes().min(CHUNK_BYTES);
        Ok(Self { gpu, pipelines, state: Mutex::default(), chunk_bytes })
    }

    /// The same kernels, writing at most `bytes` of supersegments per dispatch.
    pub fn with_chunk_bytes(self, bytes: u64) -> Self {
        let chunk_bytes = self.chunk_bytes.min(bytes);
        Self { chunk_bytes, ..self }
    }

    /// The driver's description of the device.
    pub fn facts(&self) -> &AdapterFacts {
        self.gpu.facts()
    }

    /// Runs `work` with `field` on the device. `doing` names the work in errors.
    fn with<T>(
        &self,
        doing: &str,
        field: &Field,
        rays: &PerspectiveRays<'_>,
        work: impl FnOnce(&BoundField<'_>) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let gpu = &self.gpu;
        resident::check_size(gpu, field)?;
        let mut state = self.state.lock();
        let KernelCache { marches, resident } = &mut *state;
        let done = gpu.run(doing, || {
            if resident.as_ref().is_none_or(|r| r.id != field.id()) {
                // Free the old field first: there may be no room for two.
                *resident = None;
            }
            let resident = resident.get_or_insert_with(|| ResidentField::new(gpu, field));
            let set = EffectSet::of(field);
            let known = marches.iter().position(|m| m.kind == resident.kind && m.set == set);
            let n = known.unwrap_or_else(|| {
                marches.push(MarchPipelines::new(resident.kind, set));
                marches.len() - 1
            });
            let tables = resident.tables(gpu, field, rays.step_length);
            let view = ViewUniforms::new(field, rays.camera, rays.width, rays.height, &tables.facts);
            let view = gpu.upload("view", bytemuck::bytes_of(&view), BufferUsages::UNIFORM);
            let effects = EffectResources::new(gpu, field, resident, rays.camera, rays.step_length);
            let effects = self.pipelines.bind_effects(gpu, &effects);
            let field = self.pipelines.bind_field(gpu, resident, &tables, &view);
            work(&BoundField { gpu, pipelines: &self.pipelines, march: &marches[n], field, effects })
        });
        if let Err(GpuError::Device(_)) = &done {
            // Resources created during a failure cannot be relied on.
            *state = KernelCache::default();
        }
        done
    }
}

impl GpuRayCaster for GpuKernels {
    fn generate(
        &self,
        field: &Field,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<(Vdi, Duration), GpuError> {
        self.generate(field, params, segmentation)
    }

    fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, GpuError> {
        self.raycast(field, camera, width, height)
    }

    fn raycast_pixels(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        self.raycast_pixels(field, camera, width, height, pixels)
    }
}
