//! The GPU as a level of [`crate::Backend`].

use crate::Field;
use lamina_compute::gpu::KernelError;
use lamina_model::{Camera, Image, Invalid, Segmentation, Vdi, VdiParams};
use std::fmt::Debug;
use std::time::Duration;

/// Why a GPU gave no result. The processor can always do the work instead.
pub type GpuError = KernelError<Invalid>;

/// What a GPU does in place of the processor. A trait object, so that no program names a type of the graphics library: the
/// compiler would search all of it, in each asynchronous function, for what threads may share.
pub trait GpuRayCaster: Debug + Send + Sync {
    /// As [`crate::Backend::generate`]; the time is the device's.
    ///
    /// # Errors
    /// As [`crate::Backend::generate`], or if the volume or the result does not fit the device, or the device fails.
    fn generate(
        &self,
        field: &Field,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<(Vdi, Duration), GpuError>;

    /// As [`crate::Backend::raycast`].
    ///
    /// # Errors
    /// As [`Self::generate`], and if the picture's size is out of bounds.
    fn raycast(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, GpuError>;

    /// As [`crate::Backend::raycast_pixels`].
    ///
    /// # Errors
    /// As [`Self::raycast`].
    fn raycast_pixels(
        &self,
        field: &Field,
        camera: &Camera,
        width: u32,
        height: u32,
        pixels: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, GpuError>;
}
