//! Stands in for the GPU's kernels in builds without the feature `gpu`: they cannot be made.

use crate::Field;
use lamina_compute::gpu::{Gpu, KernelError};
use lamina_model::{Camera, Image, Invalid, Segmentation, Vdi, VdiParams};
use std::time::Duration;

/// Why the GPU gave no result.
pub type GpuError = KernelError<Invalid>;

/// Kernels that cannot exist.
#[derive(Debug, Clone, Copy)]
pub enum GpuKernels {}

impl GpuKernels {
    pub(super) fn new(gpu: Gpu) -> Result<Self, GpuError> {
        match gpu {}
    }

    pub(super) fn generate(&self, _: &Field, _: &VdiParams, _: Segmentation) -> Result<(Vdi, Duration), GpuError> {
        match *self {}
    }

    pub(super) fn raycast(&self, _: &Field, _: &Camera, _: u32, _: u32) -> Result<Image, GpuError> {
        match *self {}
    }

    pub(super) fn raycast_pixels(
        &self,
        _: &Field,
        _: &Camera,
        _: u32,
        _: u32,
        _: &[(u32, u32)],
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        match *self {}
    }
}
