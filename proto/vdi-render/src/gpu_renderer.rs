//! The GPU as a level of [`crate::Backend`].

use crate::Detail;
use crate::simd::PreparedRef;
use lamina_compute::gpu::{AdapterFacts, KernelError};
use lamina_model::{Camera, Invalid};
use std::fmt::Debug;

/// Why a GPU gave no result. The processor can always do the work instead.
pub type GpuError = KernelError<Invalid>;

/// What a GPU does in place of the processor; a trait object for the reason that [`lamina_raycast::GpuRayCaster`] states.
pub(crate) trait GpuRenderer: Debug + Send + Sync {
    /// The driver's description of the device.
    fn facts(&self) -> &AdapterFacts;

    /// True at the first call only, so that a persistent failure is logged once.
    fn is_first_failure(&self) -> bool;

    /// Renders all pixels of a picture of `size` (width, height), row by row.
    fn picture(
        &self,
        vdi: PreparedRef,
        camera: &Camera,
        size: [u32; 2],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError>;

    /// Renders some `pixels` (column, row) of that picture; returns their colors in order.
    fn pixels(
        &self,
        vdi: PreparedRef,
        camera: &Camera,
        size: [u32; 2],
        pixels: &[(u32, u32)],
        detail: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError>;
}
