//! Where I runs.

use super::PreparedVdi;
use super::gpu::{GpuError, GpuKernels};
use super::quality::quality_of;
use lamina_device::{Choice, DeviceError, Gpu, Opened};
use lamina_model::{Camera, Image, Invalid, Quality, ReferenceSamples, Vdi};
use std::fmt::Display;
use std::ops::{Deref, Range};
use std::sync::Arc;

/// What draws: chosen once, at start-up.
#[derive(Debug, Clone, Default)]
pub enum Backend {
    /// All cores.
    #[default]
    Cpu,
    /// A GPU; what it cannot do is left to the cores.
    Gpu(Arc<GpuKernels>),
}

impl Backend {
    /// What `choice` leads to on this machine; the log says what and why.
    ///
    /// # Errors
    /// If a GPU is asked for by name and there is none that works.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
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

    /// A picture of `vdi` from `camera`. The paper's I.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "I")]
    pub fn render<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        width: u32,
        height: u32,
    ) -> Result<Image, Invalid> {
        match self {
            Self::Cpu => vdi.render(camera, width, height),
            Self::Gpu(kernels) => {
                let drawn = kernels.render(vdi, camera, width, height);
                or_cpu(kernels, drawn, || vdi.render(camera, width, height))
            }
        }
    }

    /// Errors of some batches of the sampled pixels.
    ///
    /// # Errors
    /// If the samples do not fit their plan, or hold fewer batches.
    #[doc(alias = "q")]
    pub fn quality<V: Deref<Target = Vdi>>(
        &self,
        vdi: &PreparedVdi<V>,
        reference: &ReferenceSamples,
        batches: Range<u32>,
    ) -> Result<Quality, Invalid> {
        match self {
            Self::Cpu => vdi.quality(reference, batches),
            Self::Gpu(kernels) => quality_of(reference, batches, |camera, size, pixels| {
                let drawn = kernels.render_pixels(vdi, camera, size, size, pixels);
                or_cpu(kernels, drawn, || Ok(vdi.render_pixels(camera, size, size, pixels)))
            }),
        }
    }
}

/// What the GPU drew; if it could not, what the processor does.
fn or_cpu<T>(
    kernels: &GpuKernels,
    drawn: Result<T, GpuError>,
    on_cpu: impl FnOnce() -> Result<T, Invalid>,
) -> Result<T, Invalid> {
    match drawn {
        Ok(drawn) => Ok(drawn),
        Err(GpuError::Invalid(e)) => Err(e),
        Err(e) => {
            if kernels.is_first_failure() {
                tracing::warn!("{e}; drawn by the processor, and so is, unsaid, whatever fails from now on");
            }
            on_cpu()
        }
    }
}
