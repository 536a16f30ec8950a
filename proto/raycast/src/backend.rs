//! Where R runs.

use super::gpu::{GpuError, GpuKernels};
use super::{Field, reduce, reference};
use crate::simd::{self, Level, Shot};
use lamina_compute::gpu::{Choice, DeviceError, Gpu, Opened};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{
    Camera, GenerationParams, Image, Intermediate, Invalid, ReferenceSamples, Representation, SamplePlan, Segmentation,
    Vdi,
};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What casts the rays: chosen once, at start-up.
///
/// All give the same picture within what [`super`] states. What a GPU cannot do, because the volume or the result is too
/// large for it or it failed, is done by the processor, with a line in the log.
#[derive(Debug, Clone)]
pub enum Backend {
    /// Eight rays at a time on the processor.
    Cpu(Level),
    /// A GPU, and the level that steps in for it.
    Gpu(Arc<GpuKernels>, Level),
}

impl Backend {
    /// The processor, at its best level.
    pub fn cpu() -> Self {
        Self::Cpu(Level::detect())
    }

    /// What `choice` leads to on this machine.
    ///
    /// # Errors
    /// If a GPU is asked for and none opens.
    pub fn open(choice: Choice) -> Result<Self, DeviceError> {
        let (gpu, level) = match Gpu::open(choice)? {
            Opened::Gpu(gpu) => (gpu, Level::detect()),
            Opened::Cpu(why) => {
                tracing::info!(level = ?Level::detect(), why, "casting rays on the processor");
                return Ok(Self::cpu());
            }
        };
        let name = gpu.facts().name.clone();
        match GpuKernels::new(*gpu) {
            Ok(kernels) => {
                tracing::info!(gpu = name, "casting rays on the GPU");
                Ok(Self::Gpu(Arc::new(kernels), level))
            }
            Err(GpuError::Device(error)) if choice == Choice::Gpu => Err(error),
            Err(error) => {
                tracing::warn!(gpu = name, %error, "casting rays on the processor");
                Ok(Self::Cpu(level))
            }
        }
    }

    /// The VDI of `field` from its scene's camera with `segmentation`, and the time it took: on a GPU the device's own. The
    /// paper's tau.
    ///
    /// Rays do not end where they become opaque, unless `params` says so: what is hidden now is seen from the side.
    ///
    /// # Errors
    /// If the step is so short that rays would have too many of them, or the VDI too many supersegments (2^32).
    pub fn generate(
        &self,
        field: &Field,
        params: &GenerationParams,
        segmentation: Segmentation,
    ) -> Result<(Vdi, Duration), Invalid> {
        if let Some(done) = self.on_gpu(|gpu| gpu.generate(field, params, segmentation)) {
            return done;
        }
        let start = Instant::now();
        let vdi = if simd::fits(field) {
            simd::generate(self.level(), field, params, segmentation)?
        } else {
            reference::generate(field, params, segmentation)?
        };
        Ok((vdi, start.elapsed()))
    }

    /// What `params` ask for, VDIs with `segmentation`, and the time it took.
    ///
    /// # Errors
    /// As [`Self::generate`] and [`reduce`].
    #[doc(alias = "R")]
    pub fn represent(
        &self,
        field: &Field,
        params: &GenerationParams,
        segmentation: Segmentation,
    ) -> Result<(Intermediate, Duration), Invalid> {
        match params.representation() {
            Representation::Vdi => {
                let (vdi, time) = self.generate(field, params, segmentation)?;
                Ok((Intermediate::Vdi(Box::new(vdi)), time))
            }
            Representation::Volume => {
                let start = Instant::now();
                let volume = reduce(field, params)?;
                Ok((Intermediate::Volume(Box::new(volume)), start.elapsed()))
            }
        }
    }

    /// What `params` ask for with each of `gammas` instead of their own.
    ///
    /// # Errors
    /// As [`Self::generate_all`] and [`reduce`].
    pub fn represent_all(
        &self,
        field: &Field,
        params: &GenerationParams,
        gammas: &[f64],
        segmentation: Segmentation,
    ) -> Result<Vec<Intermediate>, Invalid> {
        match params.representation() {
            Representation::Vdi => {
                let vdis = self.generate_all(field, params, gammas, segmentation)?;
                Ok(vdis.into_iter().map(|vdi| Intermediate::Vdi(Box::new(vdi))).collect())
            }
            // The bound is the encoder's matter.
            Representation::Volume => {
                let volume = reduce(field, params)?;
                gammas
                    .iter()
                    .map(|&gamma| Ok(Intermediate::Volume(Box::new(volume.clone().with_gamma(gamma)?))))
                    .collect()
            }
        }
    }

    /// The VDI for each of `gammas`, the other parameters being those of `params`: one march for all, on the processor; with
    /// effects one for each.
    ///
    /// # Errors
    /// As [`Self::generate`], or if a gamma is negative or not finite.
    pub fn generate_all(
        &self,
        field: &Field,
        params: &GenerationParams,
        gammas: &[f64],
        segmentation: Segmentation,
    ) -> Result<Vec<Vdi>, Invalid> {
        if !simd::fits(field) {
            let one = |&gamma| reference::generate(field, &params.with_gamma(gamma)?, segmentation);
            return gammas.iter().map(one).collect();
        }
        if field.effects().is_some() {
            let one = |&gamma| Ok(self.generate(field, &params.with_gamma(gamma)?, segmentation)?.0);
            return gammas.iter().map(one).collect();
        }
        let mut order: Vec<usize> = (0..gammas.len()).collect();
        order.sort_by(|&a, &b| gammas[a].total_cmp(&gammas[b]));
        let mut vdis: Vec<Option<Vdi>> = gammas.iter().map(|_| None).collect();
        for some in order.chunks(simd::MOST_GAMMAS) {
            let ascending: Vec<f64> = some.iter().map(|&n| gammas[n]).collect();
            for (&n, vdi) in some.iter().zip(simd::generate_all(self.level(), field, params, &ascending, segmentation)?)
            {
                vdis[n] = Some(vdi);
            }
        }
        Ok(vdis.into_iter().flatten().collect())
    }

    /// A whole picture of `field`, `width` x `height` pixels.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "reference image")]
    pub fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
        Image::check_size(width, height)?;
        if let Some(done) = self.on_gpu(|gpu| gpu.raycast(field, camera, width, height)) {
            return done;
        }
        if !simd::fits(field) {
            return reference::raycast(field, camera, width, height);
        }
        Image::new(width, height, simd::raycast(self.level(), field, &shot(camera, width, height)))
    }

    /// The colours of some `pixels` (column, row) of that picture.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    pub fn raycast_pixels(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, Invalid> {
        Image::check_size(width, height)?;
        if let Some(done) = self.on_gpu(|gpu| gpu.raycast_pixels(field, camera, width, height, pixels)) {
            return done;
        }
        if !simd::fits(field) {
            return Ok(reference::raycast_pixels(field, camera, width, height, pixels));
        }
        Ok(simd::raycast_pixels(self.level(), field, &shot(camera, width, height), pixels))
    }

    /// The colours that a VDI of time step `step` is compared with.
    ///
    /// # Errors
    /// If the plan is out of bounds.
    pub fn reference_samples(&self, field: &Field, plan: &SamplePlan, step: u64) -> Result<ReferenceSamples, Invalid> {
        self.reference_slice(field, plan, step, 0..plan.batches)
    }

    /// The same of some of the plan's batches.
    ///
    /// # Errors
    /// If the plan cannot be carried out.
    pub fn reference_slice(
        &self,
        field: &Field,
        plan: &SamplePlan,
        step: u64,
        batches: Range<u32>,
    ) -> Result<ReferenceSamples, Invalid> {
        let plan = plan.clone().check()?;
        let (scene, size) = (field.scene(), plan.image_size);
        let cameras = plan.test_cameras(&scene.camera)?;
        let view = |(v, camera): (usize, &Camera)| {
            let pixels: Vec<_> = batches.clone().flat_map(|b| plan.pixels(v, b)).collect();
            self.raycast_pixels(field, camera, size, size, &pixels)
        };
        let colors = cameras.iter().enumerate().map(view).collect::<Result<_, _>>()?;
        Ok(ReferenceSamples { step, plan, scene: scene.clone(), batches, colors })
    }

    fn level(&self) -> Level {
        match *self {
            Self::Cpu(level) | Self::Gpu(_, level) => level,
        }
    }

    /// The GPU's answer, if there is a GPU and it has one.
    fn on_gpu<T>(&self, work: impl FnOnce(&GpuKernels) -> Result<T, GpuError>) -> Option<Result<T, Invalid>> {
        let Self::Gpu(gpu, _) = self else { return None };
        match work(gpu) {
            Ok(done) => Some(Ok(done)),
            Err(GpuError::Invalid(invalid)) => Some(Err(invalid)),
            Err(error) => {
                tracing::warn!(%error, "done on the processor instead");
                None
            }
        }
    }
}

fn shot(camera: &Camera, width: u32, height: u32) -> Shot<'_> {
    Shot { camera, size: [width, height], floor: TRANSMITTANCE_FLOOR as f32 }
}
