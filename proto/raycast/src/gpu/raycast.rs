//! Ray casting of the field on the GPU; counterpart of `reference/raycast.rs`.

use super::{BAND, BoundField, GpuError, GpuKernels, PerspectiveRays};
use crate::Field;
use crate::kernel::picture_uniforms;
use lamina_compute::gpu::ColorPass;
use lamina_compute::gpu::wgpu::BindGroup;
use lamina_model::{Camera, Image};

impl GpuKernels {
    /// A whole picture of `field`, `width` x `height` pixels.
    ///
    /// # Errors
    /// If the picture's size is out of bounds, the field does not fit the device, or the device fails.
    #[doc(alias = "reference image")]
    pub fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, GpuError> {
        Image::check_size(width, height).map_err(GpuError::Invalid)?;
        let rays = PerspectiveRays { camera, width, height, step_length: field.scene().step_length(field.grid()) };
        let colors = self.with("a picture", field, &rays, |bound| {
            let uniforms = |first, count| uniforms(field, first, count);
            let pipeline = bound.march.raycast_rows(bound.gpu, bound.pipelines);
            Ok(color_pass(bound, &bound.bindings()).rows(pipeline, [width, height], uniforms)?)
        })?;
        Image::new(width, height, colors).map_err(GpuError::Invalid)
    }

    /// The colors of some `pixels` (column, row) of that picture.
    ///
    /// # Errors
    /// As for the whole picture.
    pub fn raycast_pixels(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        Image::check_size(width, height).map_err(GpuError::Invalid)?;
        let rays = PerspectiveRays { camera, width, height, step_length: field.scene().step_length(field.grid()) };
        self.with("pixels of a picture", field, &rays, |bound| {
            let uniforms = |count| uniforms(field, 0, count);
            let pipeline = bound.march.raycast_pixels(bound.gpu, bound.pipelines);
            Ok(color_pass(bound, &bound.bindings()).pixels(pipeline, pixels, uniforms)?)
        })
    }
}

fn color_pass<'a>(bound: &'a BoundField<'a>, groups: &'a [(u32, &'a BindGroup)]) -> ColorPass<'a> {
    ColorPass { gpu: bound.gpu, label: "raycast", layout: &bound.pipelines.raycast, groups, max_pixels: BAND }
}

fn uniforms(field: &Field, first: u32, count: u32) -> Vec<u8> {
    bytemuck::bytes_of(&picture_uniforms(field, first, count)).to_vec()
}
