//! Where R runs.

use super::lanes::{self, Level, Shot};
use super::{Field, scalar};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Camera, GenerationParams, Image, Invalid, ReferenceSamples, SamplePlan, Vdi};

/// What casts the rays: chosen once, at start-up.
#[derive(Debug, Clone)]
pub enum Backend {
    /// One ray at a time, double precision.
    Scalar,
    /// Eight rays at a time. Volumes with an axis of one sample point are left to [`Self::Scalar`].
    Lanes(Level),
}

impl Backend {
    /// The best there is on the processor.
    pub fn cpu() -> Self {
        Self::Lanes(Level::detect())
    }

    /// The VDI of `field` from its scene's camera. The paper's R.
    ///
    /// Rays do not end where they become opaque, unless `params` says so: what is hidden now is seen from the side.
    ///
    /// # Errors
    /// If the step is so short that rays would have too many of them, or the VDI too many supersegments (2^32).
    #[doc(alias = "R")]
    pub fn generate(&self, field: &Field, params: &GenerationParams) -> Result<Vdi, Invalid> {
        match *self {
            Self::Lanes(level) if lanes::fits(field) => lanes::generate(level, field, params),
            _ => scalar::generate(field, params),
        }
    }

    /// A whole picture of `field`, `width` x `height` pixels.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "reference image")]
    pub fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
        match *self {
            Self::Lanes(level) if lanes::fits(field) => {
                Image::check_size(width, height)?;
                Image::new(width, height, lanes::raycast(level, field, &shot(camera, width, height)))
            }
            _ => scalar::raycast(field, camera, width, height),
        }
    }

    /// The colours of some `pixels` (column, row) of that picture.
    pub fn raycast_pixels(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Vec<[f32; 3]> {
        match *self {
            Self::Lanes(level) if lanes::fits(field) => {
                lanes::raycast_pixels(level, field, &shot(camera, width, height), pixels)
            }
            _ => scalar::raycast_pixels(field, camera, width, height, pixels),
        }
    }

    /// The colours that a VDI of time step `step` is compared with.
    ///
    /// # Errors
    /// If the plan is out of bounds.
    pub fn reference_samples(&self, field: &Field, plan: &SamplePlan, step: u64) -> Result<ReferenceSamples, Invalid> {
        let plan = plan.clone().check()?;
        let (scene, size) = (field.scene(), plan.image_size);
        let cameras = plan.test_cameras(&scene.camera)?;
        let view = |(v, camera): (usize, &Camera)| self.raycast_pixels(field, camera, size, size, &plan.pixels(v));
        let colors = cameras.iter().enumerate().map(view).collect();
        Ok(ReferenceSamples { step, plan, scene: scene.clone(), colors })
    }
}

fn shot(camera: &Camera, width: u32, height: u32) -> Shot<'_> {
    Shot { camera, size: [width, height], floor: TRANSMITTANCE_FLOOR as f32 }
}
