//! Dispatch of kernels that color pixels, shared by ray casting and VDI rendering: band by band, colors copied to the host.

use super::{DeviceError, Gpu};
use wgpu::{BindGroup, BindGroupLayout, BufferUsages, ComputePipeline};

/// Bytes of one color: red, green, blue as `f32`.
const COLOR_BYTES: u64 = 12;

/// The resources of a kernel that writes one color per pixel.
#[derive(Debug)]
pub struct ColorPass<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Name of the pass in captures and errors.
    pub label: &'a str,
    /// Layout of group 1: a uniform with the band, the list of pixels (column, and row in the upper half word), the colors.
    pub layout: &'a BindGroupLayout,
    /// The other bind groups, by number.
    pub groups: &'a [(u32, &'a BindGroup)],
    /// The most pixels of one dispatch, so that no watchdog takes it for a hang.
    pub max_pixels: u64,
}

impl ColorPass<'_> {
    /// The colors of a whole picture, row by row. `pipeline` has workgroups of 8 x 8 pixels; `band` gives the bytes of the
    /// uniform for a first row and a number of rows.
    ///
    /// # Errors
    /// If the device fails.
    pub fn rows(
        &self,
        pipeline: &ComputePipeline,
        [width, height]: [u32; 2],
        band: impl Fn(u32, u32) -> Vec<u8>,
    ) -> Result<Vec<[f32; 3]>, DeviceError> {
        let mut colors = Vec::with_capacity(width as usize * height as usize);
        let rows = (self.pixels_at_a_time() / u64::from(width)).max(1) as u32;
        for first in (0..height).step_by(rows as usize) {
            let count = rows.min(height - first);
            let workgroups = [width.div_ceil(8), count.div_ceil(8)];
            let pixels = u64::from(width) * u64::from(count);
            self.dispatch(pipeline, &band(first, count), &[0], workgroups, pixels, &mut colors)?;
        }
        Ok(colors)
    }

    /// The colors of some `pixels` (column, row; both below 2^15), in order. `pipeline` has workgroups of 64 pixels; `band`
    /// gives the bytes of the uniform for a number of pixels.
    ///
    /// # Errors
    /// If the device fails.
    pub fn pixels(
        &self,
        pipeline: &ComputePipeline,
        pixels: &[(u32, u32)],
        band: impl Fn(u32) -> Vec<u8>,
    ) -> Result<Vec<[f32; 3]>, DeviceError> {
        let mut colors = Vec::with_capacity(pixels.len());
        for some in pixels.chunks(self.pixels_at_a_time() as usize) {
            let packed: Vec<u32> = some.iter().map(|(i, j)| i | j << 16).collect();
            let workgroups = self.gpu.groups(some.len() as u64, 64);
            self.dispatch(pipeline, &band(some.len() as u32), &packed, workgroups, some.len() as u64, &mut colors)?;
        }
        Ok(colors)
    }

    fn pixels_at_a_time(&self) -> u64 {
        (self.gpu.max_binding_bytes() / COLOR_BYTES).min(self.max_pixels)
    }

    /// Colors `count` pixels and appends their colors to `colors`.
    fn dispatch(
        &self,
        pipeline: &ComputePipeline,
        band: &[u8],
        pixels: &[u32],
        [x, y]: [u32; 2],
        count: u64,
        colors: &mut Vec<[f32; 3]>,
    ) -> Result<(), DeviceError> {
        let gpu = self.gpu;
        let band = gpu.upload("band", band, BufferUsages::UNIFORM);
        let pixels = gpu.upload("pixels", bytemuck::cast_slice(pixels), BufferUsages::STORAGE);
        let size = COLOR_BYTES * count;
        let out = gpu.buffer("colors", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let bindings = gpu.bind(self.layout, &[&band, &pixels, &out]);
        let copies = gpu.submit(
            self.label,
            |pass| {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(1, &bindings, &[]);
                for &(number, group) in self.groups {
                    pass.set_bind_group(number, group, &[]);
                }
                pass.dispatch_workgroups(x, y, 1);
            },
            &[(&out, 0..size)],
        )?;
        let bytes = &copies[0];
        colors.extend(bytes.chunks_exact(COLOR_BYTES as usize).map(bytemuck::pod_read_unaligned::<[f32; 3]>));
        Ok(())
    }
}
