//! The cycle: every complete step becomes a VDI, in order, one at a time.

use crate::ingest::{CompleteStep, Ingest};
use crate::publish::{Item, Publisher};
use crate::schedule::{Schedule, Setting};
use lamina_cast::{Backend, Field, most_points};
use lamina_model::{
    GenerationParams, Intermediate, Invalid, ReferenceSamples, Representation, SamplePlan, Scene, Segmentation,
    suggest::suggest,
};
use lamina_wire::codec::{self, EncodeOptions};
use lamina_wire::reference;
use lamina_wire::v1::{self, delivery::Part};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, broadcast};
use tonic::codegen::Bytes;

/// A step ready to be looked at: kept for trials until a newer one comes.
pub struct Prepared {
    /// What is being simulated.
    pub run: Arc<v1::Run>,
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    backend: Backend,
    segmentation: Segmentation,
    field: Field,
    reference: OnceLock<Result<ReferenceSamples, Invalid>>,
}

impl Prepared {
    /// What stands for the step, encoded, and what it cost.
    pub fn measure(&self, params: &GenerationParams, options: &EncodeOptions) -> Result<(Vec<u8>, v1::Cost), Invalid> {
        let (intermediate, generation_time) = self.backend.represent(&self.field, params, self.segmentation)?;
        encode(&intermediate, generation_time, options)
    }

    /// The same as a trial, whose time decides what many steps are generated with: a quick generation is timed three times,
    /// unless what it takes is `known`. (The coding of a volume, which is a part of it, is timed once.)
    pub fn try_out(
        &self,
        params: &GenerationParams,
        options: &EncodeOptions,
        known: Option<Duration>,
    ) -> Result<(Vec<u8>, v1::Cost), Invalid> {
        let (intermediate, generation_time) = match known {
            Some(time) => (self.backend.represent(&self.field, params, self.segmentation)?.0, time),
            None => self.timed(params)?,
        };
        encode(&intermediate, generation_time, options)
    }

    /// What generation alone takes as a trial.
    pub fn time(&self, params: &GenerationParams) -> Result<v1::Cost, Invalid> {
        let (_, generation_time) = self.timed(params)?;
        Ok(v1::Cost { generation_ns: generation_time.as_nanos() as u64, ..Default::default() })
    }

    fn timed(&self, params: &GenerationParams) -> Result<(Intermediate, Duration), Invalid> {
        let represent = || self.backend.represent(&self.field, params, self.segmentation);
        let (intermediate, first) = represent()?;
        let time = middle(first, || represent().map(|(_, time)| time))?;
        Ok((intermediate, time))
    }

    /// What stands for the step with each of `gammas`, and the time that making them all took.
    pub fn represent_all(
        &self,
        params: &GenerationParams,
        gammas: &[f64],
    ) -> Result<(Vec<Intermediate>, Duration), Invalid> {
        let start = Instant::now();
        let all = self.backend.represent_all(&self.field, params, gammas, self.segmentation)?;
        Ok((all, start.elapsed()))
    }

    /// The most sample points on a side of a reduced volume of the step; 0 if none can stand for it.
    pub fn longest_side(&self) -> u32 {
        most_points(&self.field)
    }

    /// The step's reference samples, cast once.
    pub fn reference(&self, plan: &SamplePlan) -> Result<Item, Invalid> {
        let cast = || self.backend.reference_samples(&self.field, plan, self.step);
        let samples = self.reference.get_or_init(cast).as_ref().map_err(Clone::clone)?;
        let (announcement, payload) = reference::encode(&self.run.run_id, samples);
        Ok(Item::new(&self.run, Part::Reference(announcement), payload))
    }

    /// Announces what stands for this step.
    pub fn frame(&self, params: &GenerationParams, cost: v1::Cost, bytes: impl Into<Bytes>, purpose: Purpose) -> Item {
        let bytes = bytes.into();
        let (trial_id, dropped_steps, setting) = match purpose {
            Purpose::Trial(id) => (id, 0, None),
            Purpose::Live { dropped_steps, setting } => (0, dropped_steps, Some(setting)),
        };
        let frame = v1::Frame {
            run_id: self.run.run_id.clone(),
            step: self.step,
            time: self.time,
            params: Some(params.into()),
            cost: Some(cost),
            trial_id,
            dropped_steps,
            bytes: bytes.len() as u64,
            empty_voxels: self.field.empty_voxels(),
            limits: setting.map(|s| s.limits),
        };
        Item::new(&self.run, Part::Frame(frame), bytes)
    }
}

/// What takes less is timed again.
const QUICK: Duration = Duration::from_millis(20);

/// `first`, or if it was quick the middle of it and two more: a machine does other things, too, and what takes milliseconds
/// takes a multiple now and then.
fn middle(first: Duration, mut again: impl FnMut() -> Result<Duration, Invalid>) -> Result<Duration, Invalid> {
    if first >= QUICK {
        return Ok(first);
    }
    let mut times = [first, again()?, again()?];
    times.sort();
    Ok(times[1])
}

/// The bytes of what stands for a step, and what they cost.
pub fn encode(
    intermediate: &Intermediate,
    generation_time: Duration,
    options: &EncodeOptions,
) -> Result<(Vec<u8>, v1::Cost), Invalid> {
    let (bytes, [generation_time, encode_time]) = codec::encode_timed(intermediate, generation_time, options)?;
    let cost = v1::Cost {
        size_bytes: bytes.len() as u64,
        generation_ns: generation_time.as_nanos() as u64,
        encode_ns: encode_time.as_nanos() as u64,
        supersegments: intermediate.elements(),
    };
    Ok((bytes, cost))
}

/// VDIs as the node starts with, then ever coarser ones.
fn last_resort(start: &GenerationParams) -> impl Iterator<Item = GenerationParams> {
    let start = start.with_representation(Representation::Vdi);
    (0..12).filter_map(move |k| {
        let resolution = (f64::from(start.resolution()) * 0.8_f64.powi(k)).round().max(1.0) as u32;
        start.with_resolution(resolution).ok()?.with_gamma(start.gamma() * 1.25_f64.powi(k)).ok()
    })
}

/// What it was made for.
pub enum Purpose<'a> {
    /// The tuner's question.
    Trial(u64),
    /// To be looked at.
    Live {
        /// Steps of the run dropped so far.
        dropped_steps: u64,
        /// The setting in force.
        setting: &'a Setting,
    },
}

/// What the cycle shares with the control service.
pub struct Shared {
    /// Parameters before any are set.
    params: GenerationParams,
    /// How VDIs are encoded.
    pub options: EncodeOptions,
    /// What casts the rays.
    pub backend: Backend,
    /// How samples become supersegments.
    pub segmentation: Segmentation,
    /// Which pixels are reference samples.
    pub plan: SamplePlan,
    /// One generation at a time, live or trial, so that each is timed with all cores to itself.
    pub kernel: Semaphore,
    /// Finished steps, as numbers.
    pub reports: broadcast::Sender<v1::StepReport>,
    /// Where frames go.
    pub publisher: Arc<Publisher>,
    state: Mutex<State>,
}

struct State {
    schedule: Schedule,
    newest: Option<Arc<Prepared>>,
    last_report: Option<v1::StepReport>,
}

impl Shared {
    /// Nothing generated yet.
    pub fn new(
        params: GenerationParams,
        options: EncodeOptions,
        backend: Backend,
        segmentation: Segmentation,
        plan: SamplePlan,
        publisher: Arc<Publisher>,
    ) -> Self {
        let state = State { schedule: Schedule::new(params), newest: None, last_report: None };
        let reports = broadcast::Sender::new(256);
        Self {
            params,
            options,
            backend,
            segmentation,
            plan,
            kernel: Semaphore::new(1),
            reports,
            publisher,
            state: Mutex::new(state),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest step, held for as long as the caller keeps it.
    pub fn newest(&self) -> Option<Arc<Prepared>> {
        self.state().newest.clone()
    }

    /// The newest finished step, as numbers.
    pub fn last_report(&self) -> Option<v1::StepReport> {
        self.state().last_report.clone()
    }

    /// Gives what is scheduled other limits; says from which step on they hold.
    pub fn limit(&self, limits: v1::Limits) -> u64 {
        self.state().schedule.limit(limits)
    }

    /// Schedules parameters; says from which step on they hold.
    pub fn set(&self, from_step: u64, setting: Setting) -> u64 {
        self.state().schedule.set(from_step, setting)
    }
}

/// The cycle's own memory from step to step.
struct Cycle {
    shared: Arc<Shared>,
    reference_every: u64,
    run: Option<(Arc<v1::Run>, Scene)>,
}

/// Turns steps into frames for ever.
pub async fn run(ingest: Arc<Ingest>, shared: Arc<Shared>, reference_every: u64) {
    let cycle = Arc::new(Mutex::new(Cycle { shared: shared.clone(), reference_every, run: None }));
    loop {
        let step = ingest.next().await;
        let number = step.step;
        let Ok(_permit) = shared.kernel.acquire().await else { return };
        let cycle = cycle.clone();
        let work = move || cycle.lock().unwrap_or_else(PoisonError::into_inner).process(step);
        match tokio::task::spawn_blocking(work).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(step = number, %error, "step not generated"),
            Err(panic) => tracing::error!(step = number, %panic, "step not generated"),
        }
    }
}

impl Cycle {
    fn process(&mut self, step: CompleteStep) -> Result<(), Invalid> {
        let (number, dropped_steps) = (step.step, step.dropped_steps);
        let prepared = Arc::new(self.prepare(step)?);
        let setting = {
            let mut state = self.shared.state();
            state.newest = Some(prepared.clone());
            state.schedule.begin(number)
        };
        let (params, bytes, cost) = self.generate_within(&prepared, &setting)?;
        let (mut items, mut has_reference) = (Vec::new(), false);
        if self.reference_every > 0 && number.is_multiple_of(self.reference_every) {
            match prepared.reference(&self.shared.plan) {
                Ok(reference) => {
                    items.push(reference);
                    has_reference = true;
                }
                Err(error) => tracing::error!(step = number, %error, "no reference samples"),
            }
        }
        items.push(prepared.frame(&params, cost, bytes, Purpose::Live { dropped_steps, setting: &setting }));
        self.shared.publisher.publish(items);
        let report = v1::StepReport {
            run_id: prepared.run.run_id.clone(),
            step: number,
            time: prepared.time,
            params: Some((&params).into()),
            cost: Some(cost),
            has_reference,
        };
        tracing::info!(
            step = number,
            resolution = params.resolution(),
            gamma = params.gamma(),
            bytes = cost.size_bytes,
            ms = cost.generation_ns / 1_000_000,
            "generated"
        );
        self.shared.state().last_report = Some(report.clone());
        // No tuner listening is not an error.
        let _ = self.shared.reports.send(report);
        Ok(())
    }

    fn prepare(&mut self, step: CompleteStep) -> Result<Prepared, Invalid> {
        let (run_id, number, time) = (step.run_id.clone(), step.step, step.time);
        let description = v1::Run {
            run_id: run_id.clone(),
            name: step.spec.name.clone(),
            field: step.spec.field.clone(),
            grid: Some((&step.spec.grid).into()),
        };
        let stated = step.spec.scene.clone();
        let volume = step.into_volume()?;
        let known = self.run.take().filter(|(run, _)| run.run_id == run_id);
        let (run, scene) = match known {
            Some(known) => known,
            None => {
                self.shared.state().schedule.restart();
                // One scene for the whole run, so that its steps can be compared.
                let scene = stated.map_or_else(|| suggest(&[&volume]), Ok)?;
                (Arc::new(description), scene)
            }
        };
        self.run = Some((run.clone(), scene.clone()));
        let field = Field::new(volume, &scene);
        if field.empty_voxels() > 0 {
            tracing::warn!(step = number, voxels = field.empty_voxels(), "NaN or infinite voxels, drawn as empty");
        }
        let (backend, segmentation) = (self.shared.backend.clone(), self.shared.segmentation);
        Ok(Prepared { run, step: number, time, backend, segmentation, field, reference: OnceLock::new() })
    }

    /// The step with the setting's parameters, or with the first fallback that keeps the size limit. Where none of them can be
    /// used, as volumes cannot where voxels are missing, or there are no fallbacks yet, a VDI as the node starts with, or the
    /// first that keeps the limit of ever coarser ones.
    fn generate_within(&self, prepared: &Prepared, setting: &Setting) -> Result<Generated, Invalid> {
        let limit = setting.limits.size_bytes;
        let mut attempts =
            Attempts { prepared, options: &self.shared.options, limit, spent_ns: [0; 2], best: Err(None) };
        attempts.until_one_fits(std::iter::once(setting.params).chain(setting.fallbacks.iter().copied()));
        // Before the first study there are no fallbacks; those of a study go as far down as it has found worth sending.
        if attempts.best.is_err() || (setting.fallbacks.is_empty() && !attempts.fits()) {
            attempts.until_one_fits(last_resort(&self.shared.params).filter(|p| *p != setting.params));
        }
        // The step's cost is that of all attempts.
        let [generation_ns, encode_ns] = attempts.spent_ns;
        let none = || Invalid::new("params", "none to generate with");
        let (params, bytes, cost) = attempts.best.map_err(|why| why.unwrap_or_else(none))?;
        Ok((params, bytes, v1::Cost { generation_ns, encode_ns, ..cost }))
    }
}

/// What stands for a step: how it was made, its bytes, what they cost.
type Generated = (GenerationParams, Vec<u8>, v1::Cost);

/// Attempts at one step.
struct Attempts<'a> {
    prepared: &'a Prepared,
    options: &'a EncodeOptions,
    limit: Option<u64>,
    /// Generating and encoding.
    spent_ns: [u64; 2],
    /// The smallest so far; why there is none.
    best: Result<Generated, Option<Invalid>>,
}

impl Attempts<'_> {
    /// True if one of them keeps the limit.
    fn fits(&self) -> bool {
        let kept = |cost: &v1::Cost| self.limit.is_none_or(|limit| cost.size_bytes <= limit);
        self.best.as_ref().is_ok_and(|(_, _, cost)| kept(cost))
    }

    fn until_one_fits(&mut self, all: impl Iterator<Item = GenerationParams>) {
        let step = self.prepared.step;
        for params in all {
            let (bytes, cost) = match self.prepared.measure(&params, self.options) {
                Ok(measured) => measured,
                Err(error) => {
                    tracing::warn!(step, %error, "trying other parameters");
                    if let Err(why) = &mut self.best {
                        *why = Some(error);
                    }
                    continue;
                }
            };
            self.spent_ns[0] += cost.generation_ns;
            self.spent_ns[1] += cost.encode_ns;
            if !matches!(&self.best, Ok((_, smallest, _)) if smallest.len() <= bytes.len()) {
                self.best = Ok((params, bytes, cost));
            }
            if self.limit.is_none_or(|limit| cost.size_bytes <= limit) {
                return;
            }
            tracing::info!(step, bytes = cost.size_bytes, "above the size limit; trying smaller parameters");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quick_generation_is_timed_three_times_and_the_middle_counts() {
        let ms = Duration::from_millis;
        let mut more = [ms(3), ms(90)].into_iter();
        assert_eq!(middle(ms(4), || Ok(more.next().unwrap())), Ok(ms(4)));
        assert_eq!(more.next(), None);
        let mut more = [ms(5), ms(4)].into_iter();
        assert_eq!(middle(ms(19), || Ok(more.next().unwrap())), Ok(ms(5)), "not the one that something else disturbed");
        assert_eq!(middle(ms(20), || unreachable!("slow enough")), Ok(ms(20)));
        let broken = || Err(Invalid::new("gamma", "is broken"));
        assert_eq!(middle(ms(1), broken), broken());
    }
}
