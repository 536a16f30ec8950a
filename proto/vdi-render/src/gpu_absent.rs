//! Stands in for the GPU's kernels in builds without the feature `gpu`: they cannot be made.

use crate::{Detail, PreparedVdi};
use lamina_compute::gpu::{AdapterFacts, Gpu, KernelError};
use lamina_model::{Camera, Invalid, Vdi};
use std::ops::Deref;

/// Why the GPU gave no result.
pub type GpuError = KernelError<Invalid>;

/// Kernels that cannot exist.
#[derive(Debug, Clone, Copy)]
pub enum GpuKernels {}

impl GpuKernels {
    pub(super) fn new(gpu: Gpu) -> Result<Self, GpuError> {
        match gpu {}
    }

    pub(super) fn facts(&self) -> &AdapterFacts {
        match *self {}
    }

    pub(super) fn is_first_failure(&self) -> bool {
        match *self {}
    }

    pub(super) fn picture<V: Deref<Target = Vdi>>(
        &self,
        _: &PreparedVdi<V>,
        _: &Camera,
        _: [u32; 2],
        _: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        match *self {}
    }

    pub(super) fn pixels<V: Deref<Target = Vdi>>(
        &self,
        _: &PreparedVdi<V>,
        _: &Camera,
        _: [u32; 2],
        _: &[(u32, u32)],
        _: Detail,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        match *self {}
    }
}
