//! The algorithm on a GPU: WGSL twins of the scalar code in single precision, and the Rust that feeds them.
//!
//! One field stays on the device, the last one seen. A kernel gives a whole result or a [`GpuError`]: never part of an
//! image. It knows nothing of when to prefer a GPU.

mod effects;
mod error;
mod generate;
mod layout;
mod pipelines;
mod raycast;
mod resident;
mod scan;
#[cfg(test)]
mod tests;
mod view;

pub use error::GpuError;

use super::Field;
use effects::{Resources, Set};
use lamina_compute::gpu::wgpu::{BindGroup, BufferUsages};
use lamina_compute::gpu::{AdapterFacts, DeviceError, Gpu};
use lamina_model::Camera;
use layout::View;
use pipelines::{March, Pipelines};
use resident::Resident;
use std::sync::{Mutex, PoisonError};

/// Bytes of supersegments written at a time: enough to keep the device busy, little beside its memory.
const CHUNK_BYTES: u64 = 256 << 20;
/// Rays or pixels dispatched at a time: far below a second of work, so that no watchdog takes it for a hang.
const BAND: u64 = 1 << 22;

/// The kernels on one device.
#[derive(Debug)]
pub struct GpuKernels {
    gpu: Gpu,
    pipelines: Pipelines,
    /// Also makes one piece of work wait for another: they would share the device's memory.
    state: Mutex<State>,
    chunk_bytes: u64,
}

#[derive(Debug, Default)]
struct State {
    marches: Vec<March>,
    resident: Option<Resident>,
}

/// A field and its rays, bound.
struct Bound<'a> {
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    march: &'a March,
    /// Group 0.
    field: BindGroup,
    /// Group 2.
    effects: BindGroup,
}

/// Rays to be cast.
struct Rays<'a> {
    camera: &'a Camera,
    width: u32,
    height: u32,
    step_length: f64,
}

impl GpuKernels {
    /// Compiles what every field needs.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Gpu) -> Result<Self, GpuError> {
        let pipelines = gpu.run("compiling kernels", || Ok::<_, DeviceError>(Pipelines::new(&gpu)))?;
        let chunk_bytes = gpu.max_binding_bytes().min(CHUNK_BYTES);
        Ok(Self { gpu, pipelines, state: Mutex::default(), chunk_bytes })
    }

    /// The same, writing no more than `bytes` of supersegments at a time.
    pub fn with_chunk_bytes(self, bytes: u64) -> Self {
        let chunk_bytes = self.chunk_bytes.min(bytes);
        Self { chunk_bytes, ..self }
    }

    /// What the driver says of the device.
    pub fn facts(&self) -> &AdapterFacts {
        self.gpu.facts()
    }

    /// Runs `work` with `field` on the device. `doing` names it.
    fn with<T>(
        &self,
        doing: &str,
        field: &Field,
        rays: &Rays<'_>,
        work: impl FnOnce(&Bound<'_>) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let gpu = &self.gpu;
        resident::check_size(gpu, field)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { marches, resident } = &mut *state;
        let done = gpu.run(doing, || {
            if resident.as_ref().is_none_or(|r| r.id != field.id()) {
                // The old one goes first: there may be no room for two.
                *resident = None;
            }
            let resident = resident.get_or_insert_with(|| Resident::new(gpu, field));
            let set = Set::of(field);
            let known = marches.iter().position(|m| m.kind == resident.kind && m.set == set);
            let n = known.unwrap_or_else(|| {
                marches.push(self.pipelines.march(gpu, resident.kind, set));
                marches.len() - 1
            });
            let tables = resident.tables(gpu, field, rays.step_length);
            let view = View::new(field, rays.camera, rays.width, rays.height, &tables);
            let view = gpu.upload("view", bytemuck::bytes_of(&view), BufferUsages::UNIFORM);
            let effects = Resources::new(gpu, field, resident, rays.camera, rays.step_length);
            let effects = self.pipelines.bind_effects(gpu, &effects);
            let field = self.pipelines.bind_field(gpu, resident, &tables, &view);
            work(&Bound { gpu, pipelines: &self.pipelines, march: &marches[n], field, effects })
        });
        if let Err(GpuError::Device(_)) = &done {
            // What was made on the way cannot be relied on.
            *state = State::default();
        }
        done
    }
}
