//! The one loop that samples the field along a ray; raycast and generate differ only in what they do with a sample.

use crate::Field;
use crate::volume::transfer_lut::Integral;
use lamina_model::transfer::Classified;
use lamina_model::{Aabb, Ray, vdi};
use std::ops::ControlFlow;

/// One sample of a ray: the middle of step number `step`.
pub struct Sample {
    /// Steps from the ray's entry into the box.
    pub step: u32,
    /// World length the sample stands for: one step, or the rest at the ray's end.
    pub length: f64,
    /// What the transfer function makes of it.
    pub classified: Classified,
}

/// A field sampled at equal steps.
pub struct March<'a> {
    pub(super) field: &'a Field,
    pub(super) bounds: Aabb,
    pub(super) unit_length: f64,
    pub(super) step_length: f64,
    integral: Option<Integral>,
}

impl<'a> March<'a> {
    /// Samples `field` every `step_length` (world units).
    pub fn new(field: &'a Field, step_length: f64) -> Self {
        let unit_length = field.unit_length();
        let integrated = field.effects().is_some_and(|e| e.pre_integrated);
        let integral = integrated.then(|| Integral::new(&field.scene().transfer, unit_length, step_length));
        Self { field, bounds: field.grid().bounds(), unit_length, step_length, integral }
    }

    /// World length that opacities refer to.
    pub fn unit_length(&self) -> f64 {
        self.unit_length
    }

    /// Visits the samples of `ray` that are not transparent, front to back until `visit` breaks. Samples sit in the middle
    /// of their steps (second order); the last step is cut at the box, so that the whole length is covered whatever the step.
    #[inline]
    pub fn samples(&self, ray: &Ray, mut visit: impl FnMut(Sample) -> ControlFlow<()>) {
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
            if !self.field.skip().is_visible(index) {
                continue;
            }
            let classified = self.field.scene().transfer.classify(self.field.sample(index), self.unit_length);
            if classified.extinction > 0.0 && visit(Sample { step, length, classified }).is_break() {
                return;
            }
        }
    }
}
