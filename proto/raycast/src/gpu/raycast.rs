//! The reference on the GPU; twin of scalar/raycast.rs.

use super::layout::Picture;
use super::{BAND, Bound, GpuError, GpuKernels, Rays};
use crate::Field;
use lamina_compute::gpu::wgpu::{BufferUsages, ComputePipeline};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Camera, Image};

/// Bytes of one colour.
const COLOR_BYTES: u64 = 12;

impl GpuKernels {
    /// A whole picture of `field`, `width` x `height` pixels.
    ///
    /// # Errors
    /// If the picture's size is out of bounds, the field does not fit the device, or the device fails.
    #[doc(alias = "reference image")]
    pub fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, GpuError> {
        Image::check_size(width, height)?;
        let rays = Rays { camera, width, height, step_length: field.scene().step_length(field.grid()) };
        let pixels = self.with("a picture", field, &rays, |bound| {
            let mut colors = Vec::with_capacity(width as usize * height as usize);
            let rows = (at_a_time(bound) / u64::from(width)).max(1) as u32;
            for first in (0..height).step_by(rows as usize) {
                let count = rows.min(height - first);
                let groups = [width.div_ceil(8), count.div_ceil(8)];
                let (picture, pixels) = (picture(field, first, count), u64::from(width) * u64::from(count));
                cast(bound, &bound.march.raycast_rows, &picture, &[0], groups, pixels, &mut colors)?;
            }
            Ok(colors)
        })?;
        Ok(Image::new(width, height, pixels)?)
    }

    /// The colours of some `pixels` (column, row) of that picture.
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
        Image::check_size(width, height)?;
        let rays = Rays { camera, width, height, step_length: field.scene().step_length(field.grid()) };
        self.with("pixels of a picture", field, &rays, |bound| {
            let mut colors = Vec::with_capacity(pixels.len());
            for band in pixels.chunks(at_a_time(bound) as usize) {
                // Sides of a picture fit 15 bits.
                let packed: Vec<u32> = band.iter().map(|(i, j)| i | j << 16).collect();
                let groups = bound.gpu.groups(band.len() as u64, 64);
                let picture = picture(field, 0, band.len() as u32);
                let pipeline = &bound.march.raycast_pixels;
                cast(bound, pipeline, &picture, &packed, groups, band.len() as u64, &mut colors)?;
            }
            Ok(colors)
        })
    }
}

/// Pixels to cast at a time.
fn at_a_time(bound: &Bound<'_>) -> u64 {
    (bound.gpu.max_binding_bytes() / COLOR_BYTES).min(BAND)
}

fn picture(field: &Field, first: u32, count: u32) -> Picture {
    let (background, floor) = (field.scene().background, TRANSMITTANCE_FLOOR as f32);
    Picture { background, floor, first, count, pad0: [0; 2] }
}

/// Casts `count` pixels and adds their colours to `colors`.
fn cast(
    bound: &Bound<'_>,
    pipeline: &ComputePipeline,
    picture: &Picture,
    pixels: &[u32],
    [x, y]: [u32; 2],
    count: u64,
    colors: &mut Vec<[f32; 3]>,
) -> Result<(), GpuError> {
    let gpu = bound.gpu;
    let picture = gpu.upload("picture", bytemuck::bytes_of(picture), BufferUsages::UNIFORM);
    let pixels = gpu.upload("pixels", bytemuck::cast_slice(pixels), BufferUsages::STORAGE);
    let size = COLOR_BYTES * count;
    let out = gpu.buffer("colors", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
    let bindings = gpu.bind(&bound.pipelines.raycast, &[&picture, &pixels, &out]);
    let done = gpu.submit(
        "raycast",
        |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bound.field, &[]);
            pass.set_bind_group(1, &bindings, &[]);
            pass.set_bind_group(2, &bound.effects, &[]);
            pass.dispatch_workgroups(x, y, 1);
        },
        &[(&out, 0..size)],
    )?;
    let bytes = &done.copies[0];
    colors.extend(bytes.chunks_exact(COLOR_BYTES as usize).map(bytemuck::pod_read_unaligned::<[f32; 3]>));
    Ok(())
}
