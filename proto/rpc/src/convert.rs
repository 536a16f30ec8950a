//! Messages to model types and back. Whatever arrives is checked by the model's own constructors.

use crate::v1;
use lamina_model::{FullPolicy, GenerationParams, Invalid, Quality, Representation, ViewError};
use std::time::Duration;

impl From<Representation> for v1::Representation {
    fn from(r: Representation) -> Self {
        match r {
            Representation::Vdi => Self::Vdi,
            Representation::Volume => Self::Volume,
        }
    }
}

impl From<&GenerationParams> for v1::GenerationParams {
    fn from(p: &GenerationParams) -> Self {
        Self {
            resolution: p.resolution(),
            gamma: p.gamma(),
            opacity_cutoff: p.opacity_cutoff(),
            step_voxels: p.step_voxels(),
            representation: v1::Representation::from(p.representation()).into(),
        }
    }
}

/// What `params` turn a step into.
///
/// # Errors
/// If this version does not know it.
pub fn representation(params: &v1::GenerationParams) -> Result<Representation, Invalid> {
    match v1::Representation::try_from(params.representation) {
        Ok(v1::Representation::Vdi) => Ok(Representation::Vdi),
        Ok(v1::Representation::Volume) => Ok(Representation::Volume),
        Err(_) => Err(Invalid::new("representation", format!("{} is unknown to this version", params.representation))),
    }
}

impl TryFrom<v1::GenerationParams> for GenerationParams {
    type Error = Invalid;
    fn try_from(p: v1::GenerationParams) -> Result<Self, Invalid> {
        let representation = representation(&p)?;
        let params = Self::new(p.resolution, p.gamma)?.with_opacity_cutoff(p.opacity_cutoff)?;
        Ok(params.with_step_voxels(p.step_voxels)?.with_representation(representation))
    }
}

impl v1::Cost {
    /// Wall time of generation, without encoding.
    pub fn generation_time(&self) -> Duration {
        Duration::from_nanos(self.generation_ns)
    }

    /// Wall time of encoding.
    pub fn encode_time(&self) -> Duration {
        Duration::from_nanos(self.encode_ns)
    }
}

impl v1::QualityReply {
    /// The answer about a trial.
    pub fn new(trial_id: u64, q: &Quality) -> Self {
        let view = |v: &ViewError| v1::View { angle_deg: v.angle_deg, batch_mse: v.batch_mse.clone() };
        Self { trial_id, views: q.views.iter().map(view).collect() }
    }
}

impl TryFrom<v1::QualityReply> for Quality {
    type Error = Invalid;
    fn try_from(q: v1::QualityReply) -> Result<Self, Invalid> {
        let batches = q.views.first().map_or(0, |v| v.batch_mse.len());
        if batches == 0 || q.views.iter().any(|v| v.batch_mse.len() != batches) {
            return Err(Invalid::new("quality", "views without batches, or with unequally many"));
        }
        if let Some(mse) = q.views.iter().flat_map(|v| &v.batch_mse).find(|mse| !(mse.is_finite() && **mse >= 0.0)) {
            return Err(Invalid::new("quality", format!("a mean squared error of {mse}")));
        }
        let view = |v: v1::View| ViewError { angle_deg: v.angle_deg, batch_mse: v.batch_mse };
        Ok(Self { views: q.views.into_iter().map(view).collect() })
    }
}

impl From<FullPolicy> for v1::FullPolicy {
    fn from(policy: FullPolicy) -> Self {
        match policy {
            FullPolicy::DropOldest => Self::DropOldest,
            FullPolicy::DropNewest => Self::DropNewest,
            FullPolicy::Block => Self::Block,
        }
    }
}

impl From<v1::FullPolicy> for FullPolicy {
    /// One that is not stated is the default.
    fn from(policy: v1::FullPolicy) -> Self {
        match policy {
            v1::FullPolicy::Unspecified | v1::FullPolicy::DropOldest => Self::DropOldest,
            v1::FullPolicy::DropNewest => Self::DropNewest,
            v1::FullPolicy::Block => Self::Block,
        }
    }
}
