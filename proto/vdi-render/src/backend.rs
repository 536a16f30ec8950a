//! Choice of the level that renders.

use super::psnr::{QualityEstimate, estimate_of, quality_of};
use super::{Detail, Drawable, PreparedVdi};
use crate::gpu_renderer::{GpuError, GpuRenderer};
use lamina_compute::gpu::{Choice, DeviceError, Gpu, Opened};
use lamina_model::{Camera, Image, Invalid, Quality, ReferenceSamples, Vdi};
use std::fmt::Display;
use std::ops::{Deref, Range};
use std::sync::{Arc, OnceLock};

/// Rows drawn by each thread before asking again whether the picture is wanted: enough to share them evenly.
const ROWS_A_THREAD: u32 = 128;

/// The level that renders, chosen once at start-up.
#[derive(Debug, Clone)]
pub struct Backend {
    vdis: VdiRenderer,
    choice: Choice,
    /// Ray caster of reduced volumes; opened at the first one.
    volumes: Arc<OnceLock<lamina_raycast::Backend>>,
}

/// The levels of both kernels, for a program that generates representations and renders them.
#[derive(Debug, Clone)]
pub struct Kernels {
    /// Casts rays through volumes.
    pub cast: lamina_raycast::Backend,
    /// Renders representations; reduced volumes by the same ray caster as `cast`.
    pub draw: Backend,
}

impl Kernels {
    /// The levels that `choice` selects on this machine, logged with the reason.
    ///
    /// # Errors
    /// If a GPU is asked for by name and there is none that works.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
        let cast = lamina_raycast::Backend::open(choice)?;
        let volumes = Arc::new(OnceLock::from(cast.clone()));
        Ok(Self { cast, draw: Backend { volumes, ..Backend::open(choice)? } })
    }
}

/// The level that renders VDIs.
#[derive(Debug, Clone)]
enum VdiRenderer {
    /// The processor, on all cores.
    Cpu,
    /// A GPU; the processor does what the GPU cannot.
    Gpu(Arc<dyn GpuRenderer>),
}

impl Default for Backend {
    /// The processor.
    fn default() -> Self {
        Self { vdis: VdiRenderer::Cpu, choice: Choice::Cpu, volumes: Arc::default() }
    }
}

impl Backend {
    /// The level that `choice` selects on this machine, logged with the reason.
    ///
    /// # Errors
    /// If a GPU is asked for by name and there is none that works.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
        Ok(Self { vdis: VdiRenderer::open(choice)?, choice, volumes: Arc::default() })
    }

    /// A backend that renders VDIs by `kernels`.
    #[cfg(feature = "gpu")]
    pub fn on_gpu(kernels: crate::gpu::GpuKernels) -> Self {
        Self { vdis: VdiRenderer::Gpu(Arc::new(kernels)), choice: Choice::Gpu, volumes: Arc::default() }
    }

    /// Renders either representation from `camera`; VDIs with reconstruction `detail`. The paper's I.
    ///
    /// ```
    /// use lamina_model::{GenerationParams, Grid, Invalid, Segmentation, Volume, Voxels, psnr, suggest::suggest};
    /// use lamina_raycast::Field;
    /// use lamina_vdi_render::{Backend, Detail, Drawable};
    ///
    /// let grid = Grid::new([16; 3], glam::DVec3::ONE, glam::DVec3::ZERO)?;
    /// let volume = Volume::new(grid, Voxels::U8((0..16 * 16 * 16).map(|n| (n / 16) as u8).collect()))?;
    /// let field = Field::new(volume.clone(), &suggest(&[&volume])?);
    /// let caster = lamina_raycast::Backend::cpu();
    /// let (vdi, _) = caster.represent(&field, &GenerationParams::vdi(64, 0.01)?, Segmentation::Fitted)?;
    ///
    /// let shown = Drawable::new(vdi);
    /// let aside = shown.camera().rotated_about_y(20.0)?;
    /// let picture = Backend::default().render(&shown, &aside, 64, 64, Detail::Cubic)?;
    /// let truth = caster.raycast(&field, &aside, 64, 64)?;
    /// assert!(psnr(&picture, &truth)? > 30.0);
    /// # Ok::<(), Invalid>(())
    /// ```
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "I")]
    pub fn render(
        &self,
        shown: &Drawable,
        camera: &Camera,
        width: u32,
        height: u32,
        detail: Detail,
    ) -> Result<Image, Invalid> {
        let image = self.render_while(shown, camera, [width, height], detail, || true)?;
        Ok(image.expect("it is wanted"))
    }

    /// Renders as [`Self::render`] while `wanted`; returns `None` once it is not. Asked before each band of rows.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_while(
        &self,
        shown: &Drawable,
        camera: &Camera,
        size: [u32; 2],
        detail: Detail,
        wanted: impl Fn() -> bool,
    ) -> Result<Option<Image>, Invalid> {
        match shown {
            Drawable::Vdi(vdi) => self.vdi_while(vdi, camera, size, detail, wanted),
            Drawable::Volume(_) if !wanted() => Ok(None),
            Drawable::Volume(field) => self.volumes().raycast(field, camera, size[0], size[1]).map(Some),
        }
    }

    /// Measures the quality of some batches of the reference samples; VDIs are rendered with `detail`.
    ///
    /// # Errors
    /// If the samples do not fit their plan, or hold fewer batches.
    #[doc(alias = "q")]
    pub fn quality(
        &self,
        shown: &Drawable,
        reference: &ReferenceSamples,
        batches: Range<u32>,
        detail: Detail,
    ) -> Result<Quality, Invalid> {
        match shown {
            Drawable::Vdi(vdi) => self.quality_vdi(vdi, reference, batches, detail),
            Drawable::Volume(field) => quality_of(reference, batches, |camera, size, pixels| {
                self.volumes().raycast_pixels(field, camera, size, size, pixels)
            }),
        }
    }

    /// Measures the quality of all batches that `reference` holds, with the confidence interval of its PSNR.
    ///
    /// # Errors
    /// As [`Self::quality`].
    pub fn estimate(
        &self,
        shown: &Drawable,
        reference: &ReferenceSamples,
        detail: Detail,
    ) -> Result<QualityEstimate, Invalid> {
        estimate_of(reference, |camera, size, pixels| match shown {
            Drawable::Vdi(vdi) => self.vdi_pixels(vdi, camera, [size; 2], pixels, detail),
            Drawable::Volume(field) => self.volumes().raycast_pixels(field, camera, size, size, pixels),
        })
    }

    fn volumes(&self) -> &lamina_raycast::Backend {
        let open = || {
            lamina_raycast::Backend::open(self.choice).unwrap_or_else(|error| {
                tracing::warn!(%error, "volumes are rendered by the processor");
                lamina_raycast::Backend::cpu()
            })
        };
        self.volumes.get_or_init(open)
    }

    /// Renders `vdi` from `camera`.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    pub fn render_vdi<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        width: u32,
        height: u32,
        detail: Detail,
    ) -> Result<Image, Invalid> {
        Ok(self.vdi_while(vdi, camera, [width, height], detail, || true)?.expect("it is wanted"))
    }

    fn vdi_while<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size: [u32; 2],
        detail: Detail,
        wanted: impl Fn() -> bool,
    ) -> Result<Option<Image>, Invalid> {
        Image::check_size(size[0], size[1])?;
        let on_cpu = || {
            let rows = ROWS_A_THREAD * rayon::current_num_threads() as u32;
            // No copy where all fit one band.
            let mut colors = Vec::new();
            for first in (0..size[1]).step_by(rows as usize) {
                if !wanted() {
                    return None;
                }
                let mut band = vdi.rows(camera, size, first..size[1].min(first + rows), detail);
                if colors.is_empty() { colors = band } else { colors.append(&mut band) }
            }
            Some(colors)
        };
        let colors = match &self.vdis {
            VdiRenderer::Cpu => on_cpu(),
            VdiRenderer::Gpu(_) if !wanted() => None,
            VdiRenderer::Gpu(kernels) => {
                or_cpu(&**kernels, kernels.picture(vdi.by_ref(), camera, size, detail).map(Some), on_cpu)?
            }
        };
        colors.map(|colors| Image::new(size[0], size[1], colors)).transpose()
    }

    /// Measures the quality of `vdi` on some batches of the reference samples.
    ///
    /// # Errors
    /// As [`Self::quality`].
    pub fn quality_vdi<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        reference: &ReferenceSamples,
        batches: Range<u32>,
        detail: Detail,
    ) -> Result<Quality, Invalid> {
        quality_of(reference, batches, |camera, size, pixels| self.vdi_pixels(vdi, camera, [size; 2], pixels, detail))
    }

    /// Renders some `pixels` (column, row) of a picture of `vdi` of `size` (width, height); returns their colors in order.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    pub fn vdi_pixels<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        size: [u32; 2],
        pixels: &[(u32, u32)],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, Invalid> {
        Image::check_size(size[0], size[1])?;
        let on_cpu = || vdi.pixels(camera, size, pixels, detail);
        match &self.vdis {
            VdiRenderer::Cpu => Ok(on_cpu()),
            VdiRenderer::Gpu(kernels) => {
                or_cpu(&**kernels, kernels.pixels(vdi.by_ref(), camera, size, pixels, detail), on_cpu)
            }
        }
    }
}

impl VdiRenderer {
    fn open(choice: Choice) -> Result<Self, DeviceError> {
        let on_cpu = |reason: &dyn Display| {
            tracing::info!(backend = "cpu", "pictures are rendered by the processor: {reason}");
            Ok(Self::Cpu)
        };
        let gpu = match Gpu::open(choice)? {
            Opened::Cpu(reason) => return on_cpu(&reason),
            Opened::Gpu(gpu) => *gpu,
        };
        match kernels(gpu) {
            Ok(kernels) => {
                let facts = kernels.facts();
                tracing::info!(backend = "gpu", driver = facts.driver, "pictures are rendered by {}", facts.name);
                Ok(Self::Gpu(kernels))
            }
            Err(reason) if choice == Choice::Auto => on_cpu(&reason),
            Err(GpuError::Device(e)) => Err(e),
            Err(e) => Err(DeviceError::Fault { doing: "compiling kernels".to_owned(), reason: e.to_string() }),
        }
    }
}

#[cfg(feature = "gpu")]
fn kernels(gpu: Gpu) -> Result<Arc<dyn GpuRenderer>, GpuError> {
    Ok(Arc::new(crate::gpu::GpuKernels::new(gpu)?))
}

#[cfg(not(feature = "gpu"))]
fn kernels(gpu: Gpu) -> Result<Arc<dyn GpuRenderer>, GpuError> {
    match gpu {}
}

/// The GPU's result, or the processor's if the GPU failed.
fn or_cpu<T>(
    kernels: &dyn GpuRenderer,
    rendered: Result<T, GpuError>,
    on_cpu: impl FnOnce() -> T,
) -> Result<T, Invalid> {
    match rendered {
        Ok(rendered) => Ok(rendered),
        Err(GpuError::Invalid(e)) => Err(e),
        Err(e) => {
            if kernels.is_first_failure() {
                tracing::warn!("{e}; rendered by the processor; later failures are not logged");
            }
            Ok(on_cpu())
        }
    }
}
