//! The algorithm of [`super::simd`] on a GPU: WGSL twins in single precision, and the Rust that feeds them.
//!
//! The last few VDIs stay on the device. A kernel gives a whole picture or a [`GpuError`]: never part of one. It knows
//! nothing of when to prefer a GPU.
//!
//! **Agreement.** A pixel has the colour that the oracle gives to a ray less than 1/2000 of a VDI's pixel and 1/2000 of a
//! step beside it, within 1e-3. So where colour changes gently, pictures agree to 1e-3; where a ray passes by the edge of
//! something opaque closer than that, it may hit what the oracle's misses. proto/vdi-render/tests/gpu.rs holds it to this.

mod error;
mod layout;
mod pipelines;
mod resident;
#[cfg(test)]
mod tests;
mod view;

pub use error::GpuError;

use super::{Displacement, PreparedVdi};
use lamina_compute::gpu::wgpu::{BindGroup, BufferUsages, ComputePipeline};
use lamina_compute::gpu::{AdapterFacts, DeviceError, Gpu};
use lamina_model::{Camera, Image, Vdi};
use layout::{Picture, View};
use pipelines::Pipelines;
use resident::Residents;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Pixels dispatched at a time: far below a second of work, so that no watchdog takes it for a hang.
const BAND: u64 = 1 << 20;
/// Bytes of one colour.
const COLOR_BYTES: u64 = 12;

/// The kernels on one device.
#[derive(Debug)]
pub struct GpuKernels {
    gpu: Gpu,
    pipelines: Pipelines,
    /// Also makes one picture wait for another: they would share the device's memory.
    residents: Mutex<Residents>,
    has_failed: AtomicBool,
    /// Bytes of the largest array taken.
    array_bytes: u64,
}

/// The rays of a picture.
struct Shot<'a> {
    camera: &'a Camera,
    size: [u32; 2],
    /// Displacement of the VDI's image.
    by: Displacement,
}

/// A VDI and the rays of a picture, bound.
struct Bound<'a> {
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    /// Group 0.
    vdi: BindGroup,
}

impl GpuKernels {
    /// Compiles.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Gpu) -> Result<Self, GpuError> {
        let pipelines = gpu.run("compiling kernels", || Ok::<_, DeviceError>(Pipelines::new(&gpu)))?;
        let array_bytes = gpu.max_binding_bytes();
        Ok(Self { gpu, pipelines, residents: Mutex::default(), has_failed: AtomicBool::new(false), array_bytes })
    }

    /// The same, taking no VDI with an array of more than `bytes`.
    pub fn with_array_bytes(self, bytes: u64) -> Self {
        let array_bytes = self.array_bytes.min(bytes);
        Self { array_bytes, ..self }
    }

    /// What the driver says of the device.
    pub fn facts(&self) -> &AdapterFacts {
        self.gpu.facts()
    }

    /// True the first time: the same trouble at every picture is one line in the log.
    pub(super) fn is_first_failure(&self) -> bool {
        !self.has_failed.swap(true, Ordering::Relaxed)
    }

    /// A picture of `vdi` from `camera`. The paper's I.
    ///
    /// # Errors
    /// If the picture's size is out of bounds, the VDI does not fit the device, or the device fails.
    #[doc(alias = "I")]
    pub fn render<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        width: u32,
        height: u32,
    ) -> Result<Image, GpuError> {
        Ok(Image::new(width, height, self.displaced(vdi, camera, [width, height], [0.0; 2])?)?)
    }

    /// All colours of that picture, the VDI's image displaced.
    pub(super) fn displaced<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size @ [width, height]: [u32; 2],
        by: Displacement,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        Image::check_size(width, height)?;
        let whole = width as usize * height as usize;
        self.with("a picture", vdi, &Shot { camera, size, by }, whole, |bound| {
            let mut colors = Vec::with_capacity(whole);
            let rows = (bound.at_a_time() / u64::from(width)).max(1) as u32;
            for first in (0..height).step_by(rows as usize) {
                let count = rows.min(height - first);
                let (groups, pixels) = ([width.div_ceil(8), count.div_ceil(8)], u64::from(width) * u64::from(count));
                let picture = Picture { first, count, pad0: [0; 2] };
                bound.draw(&bound.pipelines.render_rows, &picture, &[0], groups, pixels, &mut colors)?;
            }
            Ok(colors)
        })
    }

    /// The colours of some `pixels` (column, row) of that picture.
    ///
    /// # Errors
    /// As for the whole picture.
    pub fn render_pixels<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        self.displaced_pixels(vdi, camera, [width, height], pixels, [0.0; 2])
    }

    /// The same, the VDI's image displaced.
    pub(super) fn displaced_pixels<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size: [u32; 2],
        pixels: &[(u32, u32)],
        by: Displacement,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        Image::check_size(size[0], size[1])?;
        self.with("pixels of a picture", vdi, &Shot { camera, size, by }, pixels.len(), |bound| {
            let mut colors = Vec::with_capacity(pixels.len());
            for band in pixels.chunks(bound.at_a_time() as usize) {
                // Sides of a picture fit 15 bits.
                let packed: Vec<u32> = band.iter().map(|(i, j)| i | j << 16).collect();
                let groups = bound.gpu.groups(band.len() as u64, 64);
                let picture = Picture { first: 0, count: band.len() as u32, pad0: [0; 2] };
                let pipeline = &bound.pipelines.render_pixels;
                bound.draw(pipeline, &picture, &packed, groups, band.len() as u64, &mut colors)?;
            }
            Ok(colors)
        })
    }

    /// Runs `work` with `vdi` and the rays of a picture on the device; what shows nothing anywhere is background, `count`
    /// times. `doing` names the work.
    fn with<V: Deref<Target = Vdi>>(
        &self,
        doing: &str,
        vdi: &PreparedVdi<V>,
        shot: &Shot<'_>,
        count: usize,
        work: impl FnOnce(&Bound<'_>) -> Result<Vec<[f32; 3]>, GpuError>,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        let (gpu, pipelines, index) = (&self.gpu, &self.pipelines, vdi.index());
        if index.depths[0] >= index.depths[1] || count == 0 {
            return Ok(vec![vdi.vdi().header().background; count]);
        }
        resident::check_size(self.array_bytes, vdi.vdi(), index)?;
        let mut residents = self.residents.lock().unwrap_or_else(PoisonError::into_inner);
        let done = gpu.run(doing, || {
            let resident = residents.get(gpu, vdi);
            let view = View::new(vdi.vdi(), index, shot.camera, shot.size, shot.by);
            let view = gpu.upload("view", bytemuck::bytes_of(&view), BufferUsages::UNIFORM);
            let [stored, slots, spans, masks, ends, contents] = &resident.buffers;
            let vdi = gpu.bind(&pipelines.vdi, &[stored, &view, slots, spans, masks, ends, contents]);
            work(&Bound { gpu, pipelines, vdi })
        });
        if done.is_err() {
            // What was made on the way cannot be relied on.
            *residents = Residents::default();
        }
        done
    }
}

impl Bound<'_> {
    /// Pixels to draw at a time.
    fn at_a_time(&self) -> u64 {
        (self.gpu.max_binding_bytes() / COLOR_BYTES).min(BAND)
    }

    /// Draws `count` pixels and adds their colours to `colors`.
    fn draw(
        &self,
        pipeline: &ComputePipeline,
        picture: &Picture,
        pixels: &[u32],
        [x, y]: [u32; 2],
        count: u64,
        colors: &mut Vec<[f32; 3]>,
    ) -> Result<(), GpuError> {
        let gpu = self.gpu;
        let picture = gpu.upload("picture", bytemuck::bytes_of(picture), BufferUsages::UNIFORM);
        let pixels = gpu.upload("pixels", bytemuck::cast_slice(pixels), BufferUsages::STORAGE);
        let size = COLOR_BYTES * count;
        let out = gpu.buffer("colors", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let bindings = gpu.bind(&self.pipelines.picture, &[&picture, &pixels, &out]);
        let done = gpu.submit(
            "render",
            |pass| {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &self.vdi, &[]);
                pass.set_bind_group(1, &bindings, &[]);
                pass.dispatch_workgroups(x, y, 1);
            },
            &[(&out, 0..size)],
        )?;
        let bytes = &done.copies[0];
        colors.extend(bytes.chunks_exact(COLOR_BYTES as usize).map(bytemuck::pod_read_unaligned::<[f32; 3]>));
        Ok(())
    }
}
