//! Choice of the level that casts rays.

use super::{Field, reduce, reference};
use crate::gpu_ray_caster::{GpuError, GpuRayCaster};
use crate::simd::{self, Level, Shot};
use lamina_compute::gpu::{Choice, DeviceError, Gpu, Opened};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{
    Camera, GenerationParams, Image, Intermediate, Invalid, ReferenceSamples, SamplePlan, Segmentation, Vdi, VdiParams,
};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The level that casts rays, chosen once at start-up.
///
/// All levels give the same pictures and VDIs within the [crate's](crate) tolerances. What a GPU cannot do, because the
/// volume or the result is too large for it or because it failed, the processor does, with a line in the log.
#[derive(Debug, Clone)]
pub enum Backend {
    /// Eight rays at a time on the processor.
    Cpu(Level),
    /// A GPU, and the processor's level as its substitute.
    Gpu(Arc<dyn GpuRayCaster>, Level),
}

impl Backend {
    /// The processor, at the best level it supports.
    pub fn cpu() -> Self {
        Self::Cpu(Level::detect())
    }

    /// The level that `choice` selects on this machine.
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
        match kernels(*gpu) {
            Ok(kernels) => {
                tracing::info!(gpu = name, "casting rays on the GPU");
                Ok(Self::Gpu(kernels, level))
            }
            Err(GpuError::Device(error)) if choice == Choice::Gpu => Err(error),
            Err(error) => {
                tracing::warn!(gpu = name, %error, "casting rays on the processor");
                Ok(Self::Cpu(level))
            }
        }
    }

    /// Generates the VDI of `field` from its scene's camera with `segmentation`; also returns the time taken, on a GPU as the
    /// device measures it. The paper's R and tau.
    ///
    /// Rays do not end where they become opaque, unless `params` sets a cutoff: what is hidden now is seen from other angles.
    ///
    /// ```
    /// use lamina_model::{Grid, Invalid, Segmentation, VdiParams, Volume, Voxels, suggest::suggest};
    /// use lamina_raycast::{Backend, Field};
    ///
    /// // Density that rises along y and z, 16 voxels a side.
    /// let grid = Grid::new([16; 3], glam::DVec3::ONE, glam::DVec3::ZERO)?;
    /// let volume = Volume::new(grid, Voxels::U8((0..16 * 16 * 16).map(|n| (n / 16) as u8).collect()))?;
    /// let field = Field::new(volume.clone(), &suggest(&[&volume])?);
    ///
    /// let (vdi, _) = Backend::cpu().generate(&field, &VdiParams::new(32, 0.02)?, Segmentation::Fitted)?;
    /// let (coarser, _) = Backend::cpu().generate(&field, &VdiParams::new(32, 0.2)?, Segmentation::Fitted)?;
    /// assert_eq!(vdi.resolution(), 32);
    /// assert!(coarser.segments().len() < vdi.segments().len(), "gamma is the price of a supersegment");
    /// # Ok::<(), Invalid>(())
    /// ```
    ///
    /// # Errors
    /// If the step is so short that rays would have too many of them, or the VDI has 2^32 supersegments or more.
    pub fn generate(
        &self,
        field: &Field,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<(Vdi, Duration), Invalid> {
        if let Some(done) = self.on_gpu(field, |gpu| gpu.generate(field, params, segmentation)) {
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

    /// Generates the representation that `params` asks for, VDIs with `segmentation`; also returns the time taken.
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
        match params {
            GenerationParams::Vdi(params) => {
                let (vdi, time) = self.generate(field, params, segmentation)?;
                Ok((Intermediate::Vdi(Box::new(vdi)), time))
            }
            GenerationParams::Volume(params) => {
                let start = Instant::now();
                let volume = reduce(field, params)?;
                Ok((Intermediate::Volume(Box::new(volume)), start.elapsed()))
            }
        }
    }

    /// Generates the representation that `params` asks for, once for each of `gammas` in place of its own.
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
        match params {
            GenerationParams::Vdi(params) => {
                let vdis = self.generate_all(field, params, gammas, segmentation)?;
                Ok(vdis.into_iter().map(|vdi| Intermediate::Vdi(Box::new(vdi))).collect())
            }
            // A volume does not depend on its error bound before it is encoded.
            GenerationParams::Volume(params) => {
                let volume = reduce(field, params)?;
                gammas
                    .iter()
                    .map(|&gamma| Ok(Intermediate::Volume(Box::new(volume.clone().with_error_bound(gamma)?))))
                    .collect()
            }
        }
    }

    /// Generates the VDI of each of `gammas`, all other parameters being those of `params`. Without effects a single march on
    /// the processor serves all gammas; with effects each takes one.
    ///
    /// # Errors
    /// As [`Self::generate`], or if a gamma is negative or not finite.
    pub fn generate_all(
        &self,
        field: &Field,
        params: &VdiParams,
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

    /// Casts a whole picture of `field`, `width` x `height` pixels.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "reference image")]
    pub fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
        Image::check_size(width, height)?;
        if let Some(done) = self.on_gpu(field, |gpu| gpu.raycast(field, camera, width, height)) {
            return done;
        }
        if !simd::fits(field) {
            return reference::raycast(field, camera, width, height);
        }
        Image::new(width, height, simd::raycast(self.level(), field, &shot(camera, width, height)))
    }

    /// Casts some `pixels` (column, row) of that picture; returns their colors in order.
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
        if let Some(done) = self.on_gpu(field, |gpu| gpu.raycast_pixels(field, camera, width, height, pixels)) {
            return done;
        }
        if !simd::fits(field) {
            return Ok(reference::raycast_pixels(field, camera, width, height, pixels));
        }
        Ok(simd::raycast_pixels(self.level(), field, &shot(camera, width, height), pixels))
    }

    /// Casts some `pixels` of that picture without its background: premultiplied color and transmittance of what the field has in
    /// its own cells.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    pub fn raycast_layers(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 4]>, Invalid> {
        Image::check_size(width, height)?;
        if !simd::fits(field) {
            return Ok(reference::raycast_layers(field, camera, width, height, pixels));
        }
        Ok(simd::raycast_layers(self.level(), field, &shot(camera, width, height), pixels))
    }

    /// Casts the reference samples that VDIs of time step `step` are compared with.
    ///
    /// # Errors
    /// If the plan is out of bounds.
    pub fn reference_samples(&self, field: &Field, plan: &SamplePlan, step: u64) -> Result<ReferenceSamples, Invalid> {
        self.reference_slice(field, plan, step, 0..plan.batches)
    }

    /// Casts some batches of the reference samples.
    ///
    /// # Errors
    /// If the plan is out of bounds.
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

    /// The result of `work` on the GPU; `None` if there is no GPU, it could not do the work, or the field is a part of a grid.
    fn on_gpu<T>(
        &self,
        field: &Field,
        work: impl FnOnce(&dyn GpuRayCaster) -> Result<T, GpuError>,
    ) -> Option<Result<T, Invalid>> {
        let Self::Gpu(gpu, _) = self else { return None };
        if !field.grid_part().is_whole() {
            return None;
        }
        match work(&**gpu) {
            Ok(done) => Some(Ok(done)),
            Err(GpuError::Invalid(invalid)) => Some(Err(invalid)),
            Err(error) => {
                tracing::warn!(%error, "done on the processor instead");
                None
            }
        }
    }
}

#[cfg(feature = "gpu")]
fn kernels(gpu: Gpu) -> Result<Arc<dyn GpuRayCaster>, GpuError> {
    Ok(Arc::new(crate::gpu::GpuKernels::new(gpu)?))
}

#[cfg(not(feature = "gpu"))]
fn kernels(gpu: Gpu) -> Result<Arc<dyn GpuRayCaster>, GpuError> {
    match gpu {}
}

fn shot(camera: &Camera, width: u32, height: u32) -> Shot<'_> {
    Shot { camera, size: [width, height], floor: TRANSMITTANCE_FLOOR as f32 }
}
