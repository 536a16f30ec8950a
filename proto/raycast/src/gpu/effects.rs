//! Effects of a scene on the device.

use super::resident::ResidentField;
use crate::Field;
use crate::kernel::effects::{integral, sums, uniform};
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{Buffer, BufferUsages, TextureView};
use lamina_model::Camera;

/// The effects' data on the device.
#[derive(Debug)]
pub(super) struct EffectResources {
    pub uniform: Buffer,
    pub sums: Buffer,
    pub light: Buffer,
    pub colors: TextureView,
}

impl EffectResources {
    /// The data for pictures of `camera`, sampled every `step_length` (world units).
    pub(super) fn new(gpu: &Gpu, field: &Field, resident: &ResidentField, camera: &Camera, step_length: f64) -> Self {
        let integral = integral(field, step_length);
        let sums = sums(integral.as_ref());
        let uniform = uniform(field, integral.as_ref(), camera, step_length);
        Self {
            uniform: gpu.upload("effects", bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM),
            sums: gpu.upload("sums", bytemuck::cast_slice(&sums), BufferUsages::STORAGE),
            light: resident.light.clone(),
            colors: resident.colors.clone(),
        }
    }
}
