//! Messages to model types and back. Whatever arrives is checked by the model's own constructors.

use crate::v1::generation_params::Kind;
use crate::{required, v1};
use lamina_model::{
    Coordinates, Cost, Frame, FullPolicy, GenerationParams, Grid, Invalid, Limits, Objective, Quality, RunInfo,
    Setting, StepReport, TuningState, VdiParams, ViewError, VoxelType,
};
use std::time::Duration;

impl From<&GenerationParams> for v1::GenerationParams {
    fn from(p: &GenerationParams) -> Self {
        let kind = match p {
            GenerationParams::Vdi(vdi) => Kind::Vdi(v1::generation_params::Vdi {
                resolution: vdi.resolution(),
                gamma: vdi.gamma(),
                opacity_cutoff: vdi.opacity_cutoff(),
                step_voxels: vdi.step_voxels(),
            }),
            GenerationParams::Volume(volume) => Kind::Volume(v1::generation_params::Volume {
                longest_side: volume.longest_side(),
                error_bound: volume.error_bound(),
            }),
        };
        Self { kind: Some(kind) }
    }
}

impl TryFrom<v1::GenerationParams> for GenerationParams {
    type Error = Invalid;
    fn try_from(p: v1::GenerationParams) -> Result<Self, Invalid> {
        match required(p.kind, "params.kind")? {
            Kind::Vdi(vdi) => {
                let params = VdiParams::new(vdi.resolution, vdi.gamma)?.with_opacity_cutoff(vdi.opacity_cutoff)?;
                Ok(Self::Vdi(params.with_step_voxels(vdi.step_voxels)?))
            }
            Kind::Volume(volume) => Self::volume(volume.longest_side, volume.error_bound),
        }
    }
}

impl From<Cost> for v1::Cost {
    fn from(cost: Cost) -> Self {
        Self {
            size_bytes: cost.size_bytes,
            generation_ns: cost.generation.as_nanos() as u64,
            encode_ns: cost.encode.as_nanos() as u64,
            supersegments: cost.elements,
        }
    }
}

impl From<v1::Cost> for Cost {
    fn from(cost: v1::Cost) -> Self {
        Self {
            size_bytes: cost.size_bytes,
            generation: Duration::from_nanos(cost.generation_ns),
            encode: Duration::from_nanos(cost.encode_ns),
            elements: cost.supersegments,
        }
    }
}

impl From<Limits> for v1::Limits {
    fn from(limits: Limits) -> Self {
        let Limits { size_bytes, time_ms, with_encoding, psnr_db, overhead } = limits;
        let time_ns = time_ms.map(|ms| (ms * 1e6) as u64);
        Self { size_bytes, time_ns, with_encoding, psnr_db, overhead }
    }
}

impl From<v1::Limits> for Limits {
    fn from(limits: v1::Limits) -> Self {
        let v1::Limits { size_bytes, time_ns, with_encoding, psnr_db, overhead } = limits;
        Self { size_bytes, time_ms: time_ns.map(|ns| ns as f64 / 1e6), with_encoding, psnr_db, overhead }
    }
}

impl From<TuningState> for v1::TuningState {
    fn from(state: TuningState) -> Self {
        match state {
            TuningState::None => Self::None,
            TuningState::Provisional => Self::Provisional,
            TuningState::Done => Self::Done,
        }
    }
}

impl From<v1::TuningState> for TuningState {
    fn from(state: v1::TuningState) -> Self {
        match state {
            v1::TuningState::None => Self::None,
            v1::TuningState::Provisional => Self::Provisional,
            v1::TuningState::Done => Self::Done,
        }
    }
}

impl From<Objective> for v1::Objective {
    fn from(objective: Objective) -> Self {
        match objective {
            Objective::Quality => Self::Quality,
            Objective::Size => Self::Size,
            Objective::Time => Self::Time,
        }
    }
}

impl From<v1::Objective> for Objective {
    fn from(objective: v1::Objective) -> Self {
        match objective {
            v1::Objective::Quality => Self::Quality,
            v1::Objective::Size => Self::Size,
            v1::Objective::Time => Self::Time,
        }
    }
}

impl v1::StudyProgress {
    /// Whether everybody waits for it: nothing of a run's first study is in use yet.
    pub fn is_urgent(&self) -> bool {
        self.first && self.best_psnr_db.is_none()
    }
}

impl v1::QualityReply {
    /// The answer about a trial.
    pub fn new(trial_id: u64, q: &Quality) -> Self {
        let view = |v: &ViewError| v1::View { angle_deg: v.angle_deg, batch_mse: v.batch_mse.clone(), ssim: v.ssim };
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
        let view = |v: v1::View| ViewError { angle_deg: v.angle_deg, batch_mse: v.batch_mse, ssim: v.ssim };
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

impl From<StepReport> for v1::StepReport {
    fn from(report: StepReport) -> Self {
        let StepReport { run_id, step, time, params, cost, fell_back, has_reference, is_after_another } = report;
        let (params, cost) = (Some((&params).into()), Some(cost.into()));
        Self { run_id, step, time, params, cost, has_reference, fell_back, is_after_another }
    }
}

impl TryFrom<v1::StepReport> for StepReport {
    type Error = Invalid;
    fn try_from(report: v1::StepReport) -> Result<Self, Invalid> {
        Ok(Self {
            run_id: report.run_id,
            step: report.step,
            time: report.time,
            params: required(report.params, "params")?.try_into()?,
            cost: required(report.cost, "cost")?.into(),
            fell_back: report.fell_back,
            has_reference: report.has_reference,
            is_after_another: report.is_after_another,
        })
    }
}

impl v1::SetParametersRequest {
    /// `setting` from step `from_step` on; 0: from the next one generated.
    pub fn new(setting: &Setting, from_step: u64) -> Self {
        Self {
            params: setting.params.as_ref().map(Into::into),
            from_step,
            limits: Some(setting.limits.into()),
            fallbacks: setting.fallbacks.iter().map(Into::into).collect(),
            tuning_state: v1::TuningState::from(setting.tuning).into(),
            only_vdis: setting.only_vdis,
            objective: v1::Objective::from(setting.objective).into(),
        }
    }
}

impl TryFrom<v1::SetParametersRequest> for Setting {
    type Error = Invalid;
    /// Without parameters it brings limits.
    fn try_from(request: v1::SetParametersRequest) -> Result<Self, Invalid> {
        if request.limits.is_none() {
            required(request.params.as_ref(), "params")?;
        }
        Ok(Self {
            tuning: request.tuning_state().into(),
            objective: request.objective().into(),
            params: request.params.map(GenerationParams::try_from).transpose()?,
            limits: request.limits.unwrap_or_default().into(),
            only_vdis: request.only_vdis,
            fallbacks: request.fallbacks.into_iter().map(GenerationParams::try_from).collect::<Result<_, _>>()?,
        })
    }
}

impl From<Frame> for v1::Frame {
    fn from(frame: Frame) -> Self {
        Self {
            run_id: frame.run_id,
            step: frame.step,
            time: frame.time,
            params: Some((&frame.params).into()),
            cost: Some(frame.cost.into()),
            trial_id: frame.trial_id.unwrap_or(0),
            dropped_steps: frame.dropped_steps,
            bytes: frame.bytes,
            after_step: frame.after_step,
            empty_voxels: frame.empty_voxels,
            lost_ranks: frame.lost_ranks,
            triggers: frame.triggers,
            diagnostics: frame.diagnostics.into(),
            derivation_ns: frame.derivation.as_nanos() as u64,
            limits: Some(frame.limits.into()),
            tuning_state: v1::TuningState::from(frame.tuning).into(),
            overhead: frame.overhead,
            throttle: frame.throttle,
        }
    }
}

impl TryFrom<v1::Frame> for Frame {
    type Error = Invalid;
    fn try_from(frame: v1::Frame) -> Result<Self, Invalid> {
        Ok(Self {
            tuning: frame.tuning_state().into(),
            run_id: frame.run_id,
            step: frame.step,
            time: frame.time,
            params: required(frame.params, "params")?.try_into()?,
            cost: required(frame.cost, "cost")?.into(),
            trial_id: Some(frame.trial_id).filter(|id| *id > 0),
            dropped_steps: frame.dropped_steps,
            bytes: frame.bytes,
            after_step: frame.after_step,
            empty_voxels: frame.empty_voxels,
            lost_ranks: frame.lost_ranks,
            triggers: trigger_names(frame.triggers)?,
            diagnostics: frame.diagnostics.try_into()?,
            derivation: Duration::from_nanos(frame.derivation_ns),
            limits: frame.limits.unwrap_or_default().into(),
            overhead: frame.overhead,
            throttle: frame.throttle,
        })
    }
}

/// Names as a record can hold them.
fn trigger_names(names: Vec<String>) -> Result<Vec<String>, Invalid> {
    let is_plain = |name: &String| name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    match names.iter().find(|name| !is_plain(name)) {
        Some(name) => Err(Invalid::new("triggers", format!("{name:?}: a name has letters, digits, - and _"))),
        None => Ok(names),
    }
}

impl From<&RunInfo> for v1::Run {
    fn from(run: &RunInfo) -> Self {
        let RunInfo { id, name, field, grid } = run;
        Self { run_id: id.clone(), name: name.clone(), field: field.clone(), grid: Some(grid.into()) }
    }
}

impl TryFrom<v1::Run> for RunInfo {
    type Error = Invalid;
    fn try_from(run: v1::Run) -> Result<Self, Invalid> {
        let grid = required(run.grid, "grid")?.try_into()?;
        Ok(Self { id: run.run_id, name: run.name, field: run.field, grid })
    }
}

/// The axes of a run whose sample points are not even; none of others.
pub fn axes_message(coordinates: Option<&Coordinates>) -> Vec<v1::AxisCoordinates> {
    let axes = coordinates.into_iter().flat_map(Coordinates::axes);
    axes.map(|positions| v1::AxisCoordinates { positions: positions.clone() }).collect()
}

/// What [`axes_message`] says of `grid`; `None` also where it is even.
///
/// # Errors
/// If there are neither three axes nor none, their positions are wrong, or `grid` is not [`Coordinates::grid`].
pub fn axes_of(axes: Vec<v1::AxisCoordinates>, grid: &Grid) -> Result<Option<Coordinates>, Invalid> {
    if axes.is_empty() {
        return Ok(None);
    }
    let axes = axes.into_iter().map(|axis| axis.positions).collect::<Vec<_>>().try_into();
    let axes = axes.map_err(|_| Invalid::new("coordinates", "of an axis are missing; state those of x, y and z"))?;
    let coordinates = Coordinates::new(axes)?;
    if coordinates.grid()? != *grid {
        let reason = "the grid is not the even one of as many points, from the first to the last of each axis";
        return Err(Invalid::new("coordinates", reason));
    }
    // Where points are even already, nothing is to be resampled.
    Ok(Some(coordinates).filter(|of| !of.are_even()))
}

impl From<&(String, VoxelType)> for v1::RunField {
    fn from((name, voxel_type): &(String, VoxelType)) -> Self {
        Self { name: name.clone(), voxel_type: v1::VoxelType::from(*voxel_type).into() }
    }
}

impl TryFrom<&v1::RunField> for (String, VoxelType) {
    type Error = Invalid;
    fn try_from(field: &v1::RunField) -> Result<Self, Invalid> {
        let voxel_type = field.voxel_type().try_into();
        Ok((
            field.name.clone(),
            voxel_type.map_err(|e: Invalid| Invalid::new("field", format!("{}: {}", field.name, e.reason)))?,
        ))
    }
}
