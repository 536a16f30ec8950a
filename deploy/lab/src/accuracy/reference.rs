//! The converged reference: the step is halved until two successive pictures agree.

use super::error::Error;
use super::integrator::{Integrator, Method};
use lamina_model::{Ray, decibels};

/// Successive pictures that agree this well are converged.
pub(super) const AGREEMENT_DB: f64 = 110.0;
/// Where the first picture starts.
const COARSEST_VOXELS: f64 = 0.5;
/// Where the halving ends, converged or not.
const FINEST_VOXELS: f64 = 1.0 / 128.0;

/// Colors with what is known of their own error.
pub(super) struct Reference {
    /// Per ray.
    pub colors: Vec<[f64; 3]>,
    /// The step they were made with.
    pub step_voxels: f64,
    /// How well they agree with those of twice the step.
    pub agreement: Error,
    /// How much two halvings before differed by, over how much the last two do, as a power of two: the observed order.
    pub order: f64,
}

impl Reference {
    /// Halves the step along `rays` until the colors stay as they are.
    pub(super) fn converged(integrator: &Integrator, rays: &[Ray]) -> Self {
        let mut step_voxels = COARSEST_VOXELS;
        let mut colors = integrator.colors(rays, &Method::midpoint(step_voxels));
        let mut before: Option<Error> = None;
        loop {
            step_voxels *= 0.5;
            let finer = integrator.colors(rays, &Method::midpoint(step_voxels));
            let agreement = Error::between(&colors, &finer);
            colors = finer;
            let order = before.map_or(f64::NAN, |b| (b.rms / agreement.rms).log2());
            before = Some(agreement);
            if agreement.decibels() >= AGREEMENT_DB || step_voxels <= FINEST_VOXELS {
                return Self { colors, step_voxels, agreement, order };
            }
        }
    }

    /// Whether the agreement asked for was reached.
    pub(super) fn is_converged(&self) -> bool {
        self.agreement.decibels() >= AGREEMENT_DB
    }

    /// The error that is left by Richardson's estimate: what the last halving changed, over 2^order - 1.
    pub(super) fn own_rms(&self) -> f64 {
        // An order that was not observed, or is better than the rule's own by chance, is not relied on.
        let order = if self.order.is_finite() { self.order.clamp(0.5, 2.0) } else { 1.0 };
        self.agreement.rms / (order.exp2() - 1.0)
    }

    /// The same as PSNR.
    pub(super) fn own_db(&self) -> f64 {
        decibels(self.own_rms() * self.own_rms())
    }
}
