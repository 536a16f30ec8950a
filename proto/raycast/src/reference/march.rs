//! Ray marching: samples the field along a ray. Ray casting and VDI generation differ only in what they do with a sample.

use crate::Field;
use crate::volume::transfer_lut::PreintegrationTable;
use lamina_model::transfer::Classified;
use lamina_model::{Aabb, Ray, vdi};
use std::ops::ControlFlow;

/// A sample in the middle of a step.
pub(super) struct RaySample {
    /// Index of the step, counted from the ray's entry into the box.
    pub step: u32,
    /// World length of the step; shorter than the others for the last one.
    pub length: f64,
    /// Color and extinction by the transfer function.
    pub classified: Classified,
}

/// A field sampled at equal steps.
pub(super) struct RayMarcher<'a> {
    pub(super) field: &'a Field,
    pub(super) bounds: Aabb,
    pub(super) unit_length: f64,
    pub(super) step_length: f64,
    integral: Option<PreintegrationTable>,
}

impl<'a> RayMarcher<'a> {
    /// Samples `field` every `step_length` (world units).
    pub(super) fn new(field: &'a Field, step_length: f64) -> Self {
        let unit_length = field.unit_length();
        let integrated = field.effects().is_some_and(|e| e.pre_integrated);
        let integral = integrated.then(|| PreintegrationTable::new(&field.scene().transfer, unit_length, step_length));
        Self { field, bounds: field.grid().bounds(), unit_length, step_length, integral }
    }

    /// World length that opacities refer to.
    pub(super) fn unit_length(&self) -> f64 {
        self.unit_length
    }

    /// Passes the samples of `ray` that are not transparent to `visit`, front to back until it breaks. Samples lie in the middle
    /// of their steps (second order); the last step is cut at the box, so that the whole length is covered.
    #[inline]
    pub(super) fn samples(&self, ray: &Ray, mut visit: impl FnMut(RaySample) -> ControlFlow<()>) {
        if let Some(effects) = self.field.effects() {
            return self.samples_with(effects, self.integral.as_ref(), ray, visit);
        }
        let Some((t_in, t_out)) = self.bounds.clip(ray) else { return };
        let origin = self.field.index_from_world(ray.origin);
        let direction = ray.direction / self.field.grid().spacing();
        for step in 0..vdi::steps(t_out - t_in, self.step_length) {
            let start = t_in + f64::from(step) * self.step_length;
            let length = self.step_length.min(t_out - start);
            let index = origin + (start + 0.5 * length) * direction;
            if !self.field.is_visible(index) {
                continue;
            }
            let classified = self.field.scene().transfer.classify(self.field.sample(index), self.unit_length);
            if classified.extinction > 0.0 && visit(RaySample { step, length, classified }).is_break() {
                return;
            }
        }
    }
}
