//! Pipelines and bind group layouts.

use crate::kernel::RENDER;
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::pipeline::{READ, UNIFORM, WRITE};
use lamina_compute::gpu::wgpu::{BindGroupLayout, ComputePipeline};

/// The compiled pipelines, and the layouts of their bind groups.
#[derive(Debug)]
pub(super) struct Pipelines {
    /// Group 0: a VDI, and the rays of a picture.
    pub vdi: BindGroupLayout,
    /// Group 1: pixels and their colors.
    pub picture: BindGroupLayout,
    pub render_rows: ComputePipeline,
    pub render_pixels: ComputePipeline,
}

impl Pipelines {
    /// To be called inside [`Gpu::run`].
    pub(super) fn new(gpu: &Gpu) -> Self {
        let vdi = gpu.layout("vdi", &[UNIFORM, UNIFORM, READ, READ, READ, READ, READ]);
        let picture = gpu.layout("picture", &[UNIFORM, READ, WRITE]);
        let module = gpu.module("render", RENDER);
        let pipeline = |entry| gpu.pipeline(&module, entry, &[&vdi, &picture], &[]);
        let (render_rows, render_pixels) = (pipeline("color_rows"), pipeline("color_pixels"));
        Self { vdi, picture, render_rows, render_pixels }
    }
}
