//! One time step, prepared: its volumes and VDIs, their costs, its reference samples.

use crate::delivery::Delivery;
use crate::group::{GroupField, GroupVdi};
use lamina_codec::volume::ReferenceVolume;
use lamina_codec::{EncodeOptions, EncodedStep, encode_timed};
use lamina_compute::{Activity, Laps};
use lamina_model::{
    Cost, Diagnostics, Frame, GenerationParams, Image, Intermediate, Invalid, ReferenceSamples, RunInfo, SamplePlan,
    Segmentation, Setting,
};
use lamina_raycast::{Backend, Field, most_points};
use lamina_rpc::Bytes;
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Where a step's field is.
pub(crate) enum FieldSource {
    /// In this node; its backend casts rays through it.
    Own(Backend, Box<Field>),
    /// In parts at the members of a group.
    Group(Box<GroupField>),
}

/// A step generated.
pub(crate) enum Generated {
    /// Here, to be encoded.
    Here(Intermediate),
    /// By the members of a group, which have encoded it.
    Encoded(GroupVdi),
}

impl Generated {
    /// The step encoded, a volume after `before` if that saves bytes, and what it cost where generation took `generation`.
    pub(crate) fn encode(
        self,
        generation: Duration,
        options: &EncodeOptions,
        before: Option<&ReferenceVolume>,
    ) -> Result<EncodedStep, Invalid> {
        match self {
            Self::Here(intermediate) => Ok(encode_timed(&intermediate, generation, options, before)?),
            Self::Encoded(GroupVdi { bytes, segments, encoding, .. }) => {
                let cost = Cost { size_bytes: bytes.len() as u64, generation, encode: encoding, elements: segments };
                Ok(EncodedStep { bytes, cost, reference: None })
            }
        }
    }
}

impl FieldSource {
    /// The step generated, and the time that took: of a group that of its slowest member.
    fn represent(
        &self,
        params: &GenerationParams,
        segmentation: Segmentation,
    ) -> Result<(Generated, Duration), Invalid> {
        match (self, params) {
            (Self::Own(backend, field), _) => {
                let (made, time) = backend.represent(field, params, segmentation)?;
                Ok((Generated::Here(made), time))
            }
            (Self::Group(group), GenerationParams::Vdi(params)) => {
                let made = group.generate(params, segmentation)?;
                let time = made.generation;
                Ok((Generated::Encoded(made), time))
            }
            (Self::Group(group), GenerationParams::Volume(params)) => {
                let (volume, time) = group.reduce(params)?;
                Ok((Generated::Here(Intermediate::Volume(Box::new(volume))), time))
            }
        }
    }

    /// The time that generation takes.
    fn time(&self, params: &GenerationParams, segmentation: Segmentation) -> Result<Duration, Invalid> {
        match (self, params) {
            (Self::Group(group), GenerationParams::Vdi(params)) => group.time(params, segmentation),
            _ => Ok(self.represent(params, segmentation)?.1),
        }
    }

    fn represent_all(
        &self,
        params: &GenerationParams,
        gammas: &[f64],
        segmentation: Segmentation,
    ) -> Result<Vec<Generated>, Invalid> {
        match (self, params) {
            (Self::Own(backend, field), _) => {
                let all = backend.represent_all(field, params, gammas, segmentation)?;
                Ok(all.into_iter().map(Generated::Here).collect())
            }
            // A volume does not depend on its error bound before it is encoded.
            (Self::Group(group), GenerationParams::Volume(params)) => {
                let (volume, _) = group.reduce(params)?;
                let bounded = |&gamma: &f64| volume.clone().with_error_bound(gamma);
                gammas.iter().map(|g| Ok(Generated::Here(Intermediate::Volume(Box::new(bounded(g)?))))).collect()
            }
            (Self::Group(_), GenerationParams::Vdi(_)) => {
                gammas.iter().map(|&g| Ok(self.represent(&params.with_gamma(g)?, segmentation)?.0)).collect()
            }
        }
    }

    fn longest_side(&self) -> u32 {
        match self {
            Self::Own(_, field) => most_points(field),
            Self::Group(group) => group.longest_side(),
        }
    }

    fn reference(&self, plan: &SamplePlan, step: u64, batches: Range<u32>) -> Result<ReferenceSamples, Invalid> {
        match self {
            Self::Own(backend, field) => backend.reference_slice(field, plan, step, batches),
            Self::Group(group) => group.reference_slice(plan, batches),
        }
    }

    /// Voxels that are NaN or infinite.
    pub(crate) fn empty_voxels(&self) -> u64 {
        match self {
            Self::Own(_, field) => field.empty_voxels(),
            Self::Group(group) => group.empty_voxels(),
        }
    }
}

/// A step ready to be generated from: kept for trials until a newer one comes.
pub(crate) struct Step {
    /// What is being simulated.
    pub run: Arc<RunInfo>,
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    lost_ranks: Vec<u32>,
    diagnostics: Diagnostics,
    derivation: Duration,
    segmentation: Segmentation,
    source: FieldSource,
    reference: OnceLock<Result<ReferenceSamples, Invalid>>,
}

impl Step {
    /// The step of `run` that `source` holds.
    pub(crate) fn new(
        run: Arc<RunInfo>,
        (step, time): (u64, f64),
        segmentation: Segmentation,
        source: FieldSource,
    ) -> Self {
        let (lost_ranks, diagnostics, derivation) = (Vec::new(), Diagnostics::default(), Duration::ZERO);
        Self { run, step, time, lost_ranks, diagnostics, derivation, segmentation, source, reference: OnceLock::new() }
    }

    /// The same, without the bricks of these ranks.
    #[must_use]
    pub(crate) fn without(self, lost_ranks: Vec<u32>) -> Self {
        Self { lost_ranks, ..self }
    }

    /// The same, with what the simulation told of it.
    #[must_use]
    pub(crate) fn with_diagnostics(self, diagnostics: Diagnostics) -> Self {
        Self { diagnostics, ..self }
    }

    /// What the simulation told of it.
    pub(crate) fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// The same, whose field was computed from the run's in that time.
    #[must_use]
    pub(crate) fn derived_in(self, derivation: Duration) -> Self {
        Self { derivation, ..self }
    }

    /// The step generated and encoded, a volume after `before` if that saves bytes, and what that cost.
    pub(crate) fn measure(
        &self,
        params: &GenerationParams,
        options: &EncodeOptions,
        before: Option<&ReferenceVolume>,
        laps: &mut Laps,
    ) -> Result<EncodedStep, Invalid> {
        let (made, generation_time) = self.source.represent(params, self.segmentation)?;
        laps.lap(Activity::Generate);
        let encoded = made.encode(generation_time, options, before);
        laps.lap(Activity::Encode);
        encoded
    }

    /// The same as a trial, whose time decides what many steps are generated with: a quick generation is timed three times,
    /// unless what it takes is `known`. (The coding of a volume, which is a part of it, is timed once.)
    pub(crate) fn measure_trial(
        &self,
        params: &GenerationParams,
        options: &EncodeOptions,
        known: Option<Duration>,
        laps: &mut Laps,
    ) -> Result<EncodedStep, Invalid> {
        let (made, first) = self.source.represent(params, self.segmentation)?;
        let generation_time = known.map_or_else(|| self.median_time(params, first), Ok)?;
        laps.lap(Activity::Generate);
        let encoded = made.encode(generation_time, options, None);
        laps.lap(Activity::Encode);
        encoded
    }

    /// What generation alone takes as a trial.
    pub(crate) fn time(&self, params: &GenerationParams) -> Result<Cost, Invalid> {
        let first = self.source.time(params, self.segmentation)?;
        Ok(Cost { generation: self.median_time(params, first)?, ..Cost::default() })
    }

    /// What generation takes that took `first` at first.
    fn median_time(&self, params: &GenerationParams, first: Duration) -> Result<Duration, Invalid> {
        median_of_three(first, || self.source.time(params, self.segmentation))
    }

    /// The step generated with each of `gammas`, and the time that making them all took.
    pub(crate) fn represent_all(
        &self,
        params: &GenerationParams,
        gammas: &[f64],
    ) -> Result<(Vec<Generated>, Duration), Invalid> {
        let start = Instant::now();
        let all = self.source.represent_all(params, gammas, self.segmentation)?;
        Ok((all, start.elapsed()))
    }

    /// The most sample points on a side of a reduced volume of the step; 0 if none can stand for it.
    pub(crate) fn longest_side(&self) -> u32 {
        self.source.longest_side()
    }

    /// A slice of the reference samples, for the quality of the live step: `batches` of them, other ones from step to step; 0 for
    /// all.
    pub(crate) fn live_reference(&self, plan: &SamplePlan, batches: u32) -> Result<Delivery, Invalid> {
        if batches == 0 || batches >= plan.batches {
            return self.reference(plan);
        }
        let slice = plan.rotating_slice(self.step, batches);
        let samples = self.source.reference(plan, self.step, slice)?;
        Ok(Delivery::reference(&self.run, &samples))
    }

    /// All of the step's reference samples, cast once.
    pub(crate) fn reference(&self, plan: &SamplePlan) -> Result<Delivery, Invalid> {
        let cast = || self.source.reference(plan, self.step, 0..plan.batches);
        let samples = self.reference.get_or_init(cast).as_ref().map_err(Clone::clone)?;
        Ok(Delivery::reference(&self.run, samples))
    }

    /// A picture of the step, ray-cast from its scene's camera turned about the y axis by `angle_deg`, `side` pixels a side.
    pub(crate) fn picture(&self, angle_deg: f64, side: u32) -> Result<Image, Invalid> {
        match &self.source {
            FieldSource::Own(backend, field) => {
                backend.raycast(field, &field.scene().camera.rotated_about_y(angle_deg)?, side, side)
            }
            FieldSource::Group(of_members) => of_members.picture(angle_deg, side),
        }
    }

    /// Announces the encoded step.
    pub(crate) fn frame(
        &self,
        params: &GenerationParams,
        cost: Cost,
        bytes: impl Into<Bytes>,
        purpose: Purpose,
    ) -> Delivery {
        let bytes = bytes.into();
        let purpose = match purpose {
            Purpose::Trial(trial_id) => Frame { trial_id: Some(trial_id), ..Frame::default() },
            Purpose::Live { after_step, dropped_steps, setting, overhead, throttle, triggers } => Frame {
                after_step,
                dropped_steps,
                limits: setting.limits,
                tuning: setting.tuning,
                overhead,
                throttle,
                triggers,
                ..Frame::default()
            },
        };
        let frame = Frame {
            run_id: self.run.id.clone(),
            step: self.step,
            time: self.time,
            params: *params,
            cost,
            bytes: bytes.len() as u64,
            empty_voxels: self.source.empty_voxels(),
            lost_ranks: self.lost_ranks.clone(),
            diagnostics: self.diagnostics.clone(),
            derivation: self.derivation,
            ..purpose
        };
        Delivery::frame(&self.run, frame, bytes)
    }
}

/// What takes less is timed again.
const QUICK: Duration = Duration::from_millis(20);

/// `first`, or if it was quick the middle of it and two more: a machine does other things, too, and what takes milliseconds
/// takes a multiple now and then.
fn median_of_three(first: Duration, mut again: impl FnMut() -> Result<Duration, Invalid>) -> Result<Duration, Invalid> {
    if first >= QUICK {
        return Ok(first);
    }
    let mut times = [first, again()?, again()?];
    times.sort();
    Ok(times[1])
}

/// The use of a frame.
pub(crate) enum Purpose<'a> {
    /// A trial of this number.
    Trial(u64),
    /// A live step.
    Live {
        /// The step that it was coded after.
        after_step: Option<u64>,
        /// Steps of the run dropped so far.
        dropped_steps: u64,
        /// The setting in force.
        setting: &'a Setting,
        /// What the node costs the simulation, a share of its time, if that is known.
        overhead: Option<f64>,
        /// Share of its processor time that the node allows itself.
        throttle: f64,
        /// Triggers that fired at it.
        triggers: Vec<String>,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quick_generation_is_timed_three_times_and_the_middle_counts() {
        let ms = Duration::from_millis;
        let mut more = [ms(3), ms(90)].into_iter();
        assert_eq!(median_of_three(ms(4), || Ok(more.next().unwrap())), Ok(ms(4)));
        assert_eq!(more.next(), None);
        let mut more = [ms(5), ms(4)].into_iter();
        assert_eq!(
            median_of_three(ms(19), || Ok(more.next().unwrap())),
            Ok(ms(5)),
            "not the one that something else disturbed"
        );
        assert_eq!(median_of_three(ms(20), || unreachable!("slow enough")), Ok(ms(20)));
        let broken = || Err(Invalid::new("gamma", "is broken"));
        assert_eq!(median_of_three(ms(1), broken), broken());
    }
}
