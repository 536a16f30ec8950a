//! The cycle: every complete step becomes a VDI, in order, one at a time.

use crate::attempts::generate_within;
use crate::ingest::{CompleteStep, Ingest};
use crate::prepared::{Prepared, Purpose};
use crate::publish::Publisher;
use crate::schedule::{Schedule, Setting};
use lamina_cast::{Backend, Field};
use lamina_model::{GenerationParams, Invalid, SamplePlan, Scene, Segmentation, suggest::suggest};
use lamina_wire::codec::EncodeOptions;
use lamina_wire::v1;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Semaphore, broadcast};

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
        let (params, bytes, cost) = generate_within(&prepared, &setting, &self.shared.params, &self.shared.options)?;
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
        Ok(Prepared::new(run, (number, time), (backend, segmentation), field))
    }
}
