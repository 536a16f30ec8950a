//! Where I runs.

use super::gpu::{GpuError, GpuKernels};
use super::psnr::{QualityEstimate, estimate_of, quality_of};
use super::reconstruction::{Detail, drawn};
use super::{Prepared, PreparedVdi};
use lamina_compute::gpu::{Choice, DeviceError, Gpu, Opened};
use lamina_model::{Camera, Image, Invalid, Quality, ReferenceSamples, Vdi};
use std::fmt::Display;
use std::ops::{Deref, Range};
use std::sync::{Arc, OnceLock};

/// What draws: chosen once, at start-up.
#[derive(Debug, Clone)]
pub struct Backend {
    vdis: Drawer,
    choice: Choice,
    /// What casts volumes; opened for the first one.
    volumes: Arc<OnceLock<lamina_raycast::Backend>>,
}

/// What draws VDIs.
#[derive(Debug, Clone)]
enum Drawer {
    /// All cores.
    Cpu,
    /// A GPU; what it cannot do is left to the cores.
    Gpu(Arc<GpuKernels>),
}

impl Default for Backend {
    /// The processor.
    fn default() -> Self {
        Self { vdis: Drawer::Cpu, choice: Choice::Cpu, volumes: Arc::default() }
    }
}

impl Backend {
    /// What `choice` leads to on this machine; the log says what and why.
    ///
    /// # Errors
    /// If a GPU is asked for by name and there is none that works.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
        Ok(Self { vdis: Drawer::open(choice)?, choice, volumes: Arc::default() })
    }

    /// VDIs are drawn by `kernels`.
    pub fn on_gpu(kernels: GpuKernels) -> Self {
        Self { vdis: Drawer::Gpu(Arc::new(kernels)), choice: Choice::Gpu, volumes: Arc::default() }
    }

    /// A picture of either representation from `camera`; `detail` is how carefully VDIs are drawn. The paper's I.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "I")]
    pub fn render(
        &self,
        shown: &Prepared,
        camera: &Camera,
        width: u32,
        height: u32,
        detail: Detail,
    ) -> Result<Image, Invalid> {
        let image = self.render_while(shown, camera, [width, height], detail, || true)?;
        Ok(image.expect("it is wanted"))
    }

    /// The same, given up, with nothing drawn, once it is no longer `wanted`.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_while(
        &self,
        shown: &Prepared,
        camera: &Camera,
        size: [u32; 2],
        detail: Detail,
        wanted: impl Fn() -> bool,
    ) -> Result<Option<Image>, Invalid> {
        match shown {
            Prepared::Vdi(vdi) => self.vdi_while(vdi, camera, size, detail, wanted),
            Prepared::Volume(_) if !wanted() => Ok(None),
            Prepared::Volume(field) => self.volumes().raycast(field, camera, size[0], size[1]).map(Some),
        }
    }

    /// Errors of some batches of the sampled pixels, VDIs drawn with `detail`.
    ///
    /// # Errors
    /// If the samples do not fit their plan, or hold fewer batches.
    #[doc(alias = "q")]
    pub fn quality(
        &self,
        shown: &Prepared,
        reference: &ReferenceSamples,
        batches: Range<u32>,
        detail: Detail,
    ) -> Result<Quality, Invalid> {
        match shown {
            Prepared::Vdi(vdi) => self.quality_vdi(vdi, reference, batches, detail),
            Prepared::Volume(field) => quality_of(reference, batches, |camera, size, pixels| {
                self.volumes().raycast_pixels(field, camera, size, size, pixels)
            }),
        }
    }

    /// The same of all batches that `reference` holds, with the interval of its PSNR.
    ///
    /// # Errors
    /// As [`Self::quality`].
    pub fn estimate(
        &self,
        shown: &Prepared,
        reference: &ReferenceSamples,
        detail: Detail,
    ) -> Result<QualityEstimate, Invalid> {
        estimate_of(reference, |camera, size, pixels| match shown {
            Prepared::Vdi(vdi) => self.vdi_pixels(vdi, camera, [size; 2], pixels, detail),
            Prepared::Volume(field) => self.volumes().raycast_pixels(field, camera, size, size, pixels),
        })
    }

    fn volumes(&self) -> &lamina_raycast::Backend {
        let open = || {
            lamina_raycast::Backend::open(self.choice).unwrap_or_else(|error| {
                tracing::warn!(%error, "volumes are drawn by the processor");
                lamina_raycast::Backend::cpu()
            })
        };
        self.volumes.get_or_init(open)
    }

    /// A picture of `vdi` from `camera`.
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
        let on_cpu = |by| vdi.displaced(camera, size, by);
        let colors = drawn(detail, vdi.magnification(camera, size[1]), |by| match &self.vdis {
            _ if !wanted() => Err(None),
            Drawer::Cpu => Ok(on_cpu(by)),
            Drawer::Gpu(kernels) => {
                or_cpu(kernels, kernels.displaced(vdi, camera, size, by), || on_cpu(by)).map_err(Some)
            }
        });
        match colors {
            Ok(colors) => Image::new(size[0], size[1], colors).map(Some),
            Err(None) => Ok(None),
            Err(Some(error)) => Err(error),
        }
    }

    /// Errors of some batches of the sampled pixels of `vdi`.
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

    /// The colours of some `pixels` (column, row) of a picture of `vdi`, `size` pixels.
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
        let on_cpu = |by| vdi.displaced_pixels(camera, size, pixels, by);
        drawn(detail, vdi.magnification(camera, size[1]), |by| match &self.vdis {
            Drawer::Cpu => Ok(on_cpu(by)),
            Drawer::Gpu(kernels) => {
                or_cpu(kernels, kernels.displaced_pixels(vdi, camera, size, pixels, by), || on_cpu(by))
            }
        })
    }
}

impl Drawer {
    fn open(choice: Choice) -> Result<Self, DeviceError> {
        let on_cpu = |reason: &dyn Display| {
            tracing::info!(backend = "cpu", "pictures are drawn by the processor: {reason}");
            Ok(Self::Cpu)
        };
        let gpu = match Gpu::open(choice)? {
            Opened::Cpu(reason) => return on_cpu(&reason),
            Opened::Gpu(gpu) => *gpu,
        };
        match GpuKernels::new(gpu) {
            Ok(kernels) => {
                let facts = kernels.facts();
                tracing::info!(backend = "gpu", driver = facts.driver, "pictures are drawn by {}", facts.name);
                Ok(Self::Gpu(Arc::new(kernels)))
            }
            Err(reason) if choice == Choice::Auto => on_cpu(&reason),
            Err(GpuError::Device(e)) => Err(e),
            Err(e) => Err(DeviceError::Fault { doing: "compiling kernels".to_owned(), reason: e.to_string() }),
        }
    }
}

/// What the GPU drew; if it could not, what the processor does.
fn or_cpu<T>(kernels: &GpuKernels, drawn: Result<T, GpuError>, on_cpu: impl FnOnce() -> T) -> Result<T, Invalid> {
    match drawn {
        Ok(drawn) => Ok(drawn),
        Err(GpuError::Invalid(e)) => Err(e),
        Err(e) => {
            if kernels.is_first_failure() {
                tracing::warn!("{e}; drawn by the processor, and so is, unsaid, whatever fails from now on");
            }
            Ok(on_cpu())
        }
    }
}
