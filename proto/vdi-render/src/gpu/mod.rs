//! VDI rendering on a GPU: WGSL counterparts of the `simd` level in single precision, and their host code.
//!
//! The device holds the last few VDIs. A kernel returns a whole picture or a [`GpuError`], never a part of one. The choice
//! between GPU and processor is made elsewhere ([`crate::Backend`]).
//!
//! **Agreement.** Each pixel agrees within 1e-3 with the oracle's color for a ray displaced by less than 1/2000 of a VDI pixel
//! and 1/2000 of a step. So pictures agree to 1e-3 where colors vary smoothly; a ray that passes the edge of something opaque
//! more closely may hit it where the oracle's does not. tests/gpu.rs verifies this.

mod pipelines;
mod resident;
#[cfg(test)]
mod tests;

pub use crate::gpu_renderer::GpuError;

use super::{Detail, PreparedVdi};
use crate::gpu_renderer::GpuRenderer;
use crate::kernel::layout::PictureUniforms;
use crate::kernel::view_uniforms;
use crate::simd::PreparedRef;
use lamina_compute::gpu::wgpu::{BindGroup, BufferUsages};
use lamina_compute::gpu::{AdapterFacts, ColorPass, DeviceError, Gpu};
use lamina_model::{Camera, Image, Vdi};
use parking_lot::Mutex;
use pipelines::Pipelines;
use resident::ResidentVdis;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pixels of one dispatch: far less than a second of work, so that no watchdog takes it for a hang.
const BAND: u64 = 1 << 20;
/// The compiled kernels on one device.
#[derive(Debug)]
pub struct GpuKernels {
    gpu: Gpu,
    pipelines: Pipelines,
    /// Also serializes pictures, which would otherwise share the device's memory.
    residents: Mutex<ResidentVdis>,
    has_failed: AtomicBool,
    /// Bytes of the largest array accepted.
    array_bytes: u64,
}

/// The rays of a picture.
struct PictureRays<'a> {
    camera: &'a Camera,
    size: [u32; 2],
    detail: Detail,
}

/// A VDI and the rays of a picture, bound to the kernels.
struct BoundVdi<'a> {
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    /// Group 0.
    vdi: BindGroup,
}

impl GpuKernels {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Gpu) -> Result<Self, GpuError> {
        let pipelines = gpu.run("compiling kernels", || Ok::<_, DeviceError>(Pipelines::new(&gpu)))?;
        let array_bytes = gpu.max_binding_bytes();
        Ok(Self { gpu, pipelines, residents: Mutex::default(), has_failed: AtomicBool::new(false), array_bytes })
    }

    /// The same kernels, accepting no VDI with an array of more than `bytes`.
    pub fn with_array_bytes(self, bytes: u64) -> Self {
        let array_bytes = self.array_bytes.min(bytes);
        Self { array_bytes, ..self }
    }

    /// The driver's description of the device.
    pub fn facts(&self) -> &AdapterFacts {
        self.gpu.facts()
    }

    /// Renders all pixels of a picture of `size` (width, height), row by row. The paper's I.
    ///
    /// # Errors
    /// If the picture's size is out of bounds, the VDI does not fit the device, or the device fails.
    #[doc(alias = "I")]
    pub fn picture<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size: [u32; 2],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        GpuRenderer::picture(self, vdi.by_ref(), camera, size, detail)
    }

    /// Renders some `pixels` (column, row) of that picture; returns their colors in order.
    ///
    /// # Errors
    /// As for the whole picture.
    pub fn pixels<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size: [u32; 2],
        pixels: &[(u32, u32)],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        GpuRenderer::pixels(self, vdi.by_ref(), camera, size, pixels, detail)
    }

    /// Runs `work` with `vdi` and the rays of a picture on the device; an invisible VDI gives the background `count` times
    /// without it. `doing` names the work in errors.
    fn with(
        &self,
        doing: &str,
        vdi: PreparedRef,
        shot: &PictureRays<'_>,
        count: usize,
        work: impl FnOnce(&BoundVdi<'_>) -> Result<Vec<[f32; 3]>, GpuError>,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        let (gpu, pipelines, grid) = (&self.gpu, &self.pipelines, vdi.grid);
        if grid.depths[0] >= grid.depths[1] || count == 0 {
            return Ok(vec![vdi.vdi.header().background; count]);
        }
        resident::check_size(self.array_bytes, vdi.vdi, grid)?;
        let mut residents = self.residents.lock();
        let done = gpu.run(doing, || {
            let resident = residents.get(gpu, vdi);
            let view = view_uniforms(vdi, shot.camera, shot.size, shot.detail);
            let view = gpu.upload("view", bytemuck::bytes_of(&view), BufferUsages::UNIFORM);
            let [stored, slots, spans, masks, ends, contents] = &resident.buffers;
            let vdi = gpu.bind(&pipelines.vdi, &[stored, &view, slots, spans, masks, ends, contents]);
            work(&BoundVdi { gpu, pipelines, vdi })
        });
        if done.is_err() {
            // Resources created during a failure cannot be relied on.
            *residents = ResidentVdis::default();
        }
        done
    }
}

impl GpuRenderer for GpuKernels {
    fn facts(&self) -> &AdapterFacts {
        self.facts()
    }

    fn is_first_failure(&self) -> bool {
        !self.has_failed.swap(true, Ordering::Relaxed)
    }

    fn picture(
        &self,
        vdi: PreparedRef,
        camera: &Camera,
        size @ [width, height]: [u32; 2],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        Image::check_size(width, height).map_err(GpuError::Invalid)?;
        let whole = width as usize * height as usize;
        self.with("a picture", vdi, &PictureRays { camera, size, detail }, whole, |bound| {
            Ok(bound.color_pass(&bound.groups()).rows(&bound.pipelines.render_rows, size, uniforms)?)
        })
    }

    fn pixels(
        &self,
        vdi: PreparedRef,
        camera: &Camera,
        size: [u32; 2],
        pixels: &[(u32, u32)],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        Image::check_size(size[0], size[1]).map_err(GpuError::Invalid)?;
        self.with("pixels of a picture", vdi, &PictureRays { camera, size, detail }, pixels.len(), |bound| {
            let pipeline = &bound.pipelines.render_pixels;
            Ok(bound.color_pass(&bound.groups()).pixels(pipeline, pixels, |count| uniforms(0, count))?)
        })
    }
}

impl BoundVdi<'_> {
    /// The bind groups other than group 1, by number.
    fn groups(&self) -> [(u32, &BindGroup); 1] {
        [(0, &self.vdi)]
    }

    fn color_pass<'a>(&'a self, groups: &'a [(u32, &'a BindGroup)]) -> ColorPass<'a> {
        ColorPass { gpu: self.gpu, label: "render", layout: &self.pipelines.picture, groups, max_pixels: BAND }
    }
}

/// The uniform of a dispatch that colors `count` rows from row `first` on, or `count` listed pixels.
fn uniforms(first: u32, count: u32) -> Vec<u8> {
    bytemuck::bytes_of(&PictureUniforms { first, count, pad0: [0; 2] }).to_vec()
}
