//! What the pipeline and the control service share.

use crate::counters::PipelineCounters;
use crate::overhead::{Coupling, Overhead};
use crate::publish::Publisher;
use crate::schedule::Schedule;
use crate::step::Step;
use lamina_codec::EncodeOptions;
use lamina_compute::CpuShare;
use lamina_model::{GenerationParams, SamplePlan, Segmentation, Setting, StepReport};
use lamina_raycast::Backend;
use parking_lot::{Mutex, MutexGuard};
use std::sync::Arc;
use tokio::sync::broadcast;

/// Configuration in force, the newest step, and what is scheduled.
pub(crate) struct NodeState {
    /// How VDIs are encoded.
    pub options: EncodeOptions,
    /// What casts the rays.
    pub backend: Backend,
    /// How samples become supersegments.
    pub segmentation: Segmentation,
    /// Which pixels are reference samples.
    pub plan: SamplePlan,
    /// Processor time; one generation at a time, live or trial.
    pub share: CpuShare,
    /// What the node costs the simulation.
    pub overhead: Arc<Overhead>,
    /// Finished steps, as numbers.
    pub reports: broadcast::Sender<StepReport>,
    /// Where frames go.
    pub publisher: Arc<Publisher>,
    /// What was done so far.
    pub counters: PipelineCounters,
    state: Mutex<Current>,
}

struct Current {
    schedule: Schedule,
    newest: Option<Arc<Step>>,
    last_report: Option<StepReport>,
}

/// What a node works with.
pub(crate) struct Parts {
    /// Parameters before any are set, if the configuration states them.
    pub params: Option<GenerationParams>,
    /// As [`NodeState::options`].
    pub options: EncodeOptions,
    /// As [`NodeState::backend`].
    pub backend: Backend,
    /// As [`NodeState::segmentation`].
    pub segmentation: Segmentation,
    /// As [`NodeState::plan`].
    pub plan: SamplePlan,
    /// As [`NodeState::share`].
    pub share: CpuShare,
    /// As [`NodeState::overhead`].
    pub overhead: Arc<Overhead>,
    /// As [`NodeState::publisher`].
    pub publisher: Arc<Publisher>,
}

impl NodeState {
    /// Nothing generated yet.
    pub(crate) fn new(parts: Parts) -> Self {
        let Parts { params, options, backend, segmentation, plan, share, overhead, publisher } = parts;
        let schedule = Schedule::new(params);
        let state = Mutex::new(Current { schedule, newest: None, last_report: None });
        let reports = broadcast::Sender::new(256);
        Self {
            options,
            backend,
            segmentation,
            plan,
            share,
            overhead,
            reports,
            publisher,
            counters: PipelineCounters::default(),
            state,
        }
    }

    fn state(&self) -> MutexGuard<'_, Current> {
        self.state.lock()
    }

    /// The newest step, held for as long as the caller keeps it.
    pub(crate) fn newest(&self) -> Option<Arc<Step>> {
        self.state().newest.clone()
    }

    /// The newest finished step, as numbers.
    pub(crate) fn last_report(&self) -> Option<StepReport> {
        self.state().last_report.clone()
    }

    /// Takes `step` as the newest; gives what it is generated with.
    pub(crate) fn begin(&self, step: &Arc<Step>) -> Setting {
        let mut state = self.state();
        state.newest = Some(step.clone());
        state.schedule.begin(step.step)
    }

    /// A step is finished.
    pub(crate) fn report(&self, report: StepReport) {
        self.state().last_report = Some(report.clone());
        // No tuner listening is not an error.
        let _ = self.reports.send(report);
    }

    /// Another run begins.
    pub(crate) fn restart(&self) {
        self.state().schedule.restart();
        self.overhead.restart();
    }

    /// What the node costs the simulation, as far as it is known.
    pub(crate) fn coupling(&self) -> Coupling {
        self.overhead.coupling()
    }

    /// Gives what is scheduled the limits of `contract`; says from which step on they hold.
    pub(crate) fn limit(&self, contract: &Setting) -> u64 {
        self.overhead.limit(contract.limits.overhead);
        self.state().schedule.limit(contract)
    }

    /// Schedules parameters; says from which step on they hold.
    pub(crate) fn set(&self, from_step: u64, setting: Setting) -> u64 {
        self.overhead.limit(setting.limits.overhead);
        self.state().schedule.set(from_step, setting)
    }
}
