//! What the tuner is doing and has measured, for those who ask.

use crate::Contract;
use crate::evaluator::TrialError;
use crate::tune::Trial;
use lamina_model::GenerationParams;
use lamina_rpc::daemon::Exposition;
use lamina_rpc::v1::{self, tuning_server};
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::watch;
use tonic::{Request, Response};

/// Trials remembered.
const MOST_TRIALS: usize = 20_000;

/// Shared by the loop, the service and the streams to viz-nodes.
#[derive(Default)]
pub(crate) struct Status {
    state: Mutex<v1::TunerStatus>,
    changed: watch::Sender<()>,
    trials: AtomicU64,
}

impl Status {
    fn change(&self, change: impl FnOnce(&mut v1::TunerStatus)) {
        change(&mut self.state.lock());
        self.changed.send_replace(());
    }

    /// Tells of changes.
    pub(crate) fn changes(&self) -> watch::Receiver<()> {
        self.changed.subscribe()
    }

    /// As it is now, without trials.
    pub(crate) fn summary(&self) -> v1::TunerStatus {
        let state = self.state.lock();
        let (last_error, contract) = (state.last_error.clone(), state.contract.clone());
        v1::TunerStatus { trials: Vec::new(), last_error, contract, ..*state }
    }

    /// A contract is in force.
    pub(crate) fn contract(&self, contract: &Contract) {
        self.change(|state| state.contract = contract.to_string());
    }

    /// A step is being dealt with.
    pub(crate) fn working(&self, busy: bool) {
        self.change(|state| state.busy = busy);
    }

    /// `step` has been dealt with.
    pub(crate) fn seen(&self, step: u64) {
        self.change(|state| (state.busy, state.steps_seen) = (false, step + 1));
    }

    /// A study ended with nothing measured.
    pub(crate) fn lost_study(&self) {
        self.change(|state| state.lost_studies += 1);
    }

    /// A study ended, with or without an error.
    pub(crate) fn failed(&self, error: Option<&TrialError>) {
        self.change(|state| state.last_error = error.map(ToString::to_string).unwrap_or_default());
    }

    /// Parameters whose trial came to `psnr_db` are in use.
    pub(crate) fn chosen(&self, params: Option<GenerationParams>, psnr_db: f64) {
        self.change(|state| (state.chosen, state.chosen_psnr_db) = (params.as_ref().map(Into::into), Some(psnr_db)));
    }

    /// A trial was measured; its step is filled in when the study ends.
    pub(crate) fn tried(&self, row: &Trial) {
        self.trials.fetch_add(1, Ordering::Relaxed);
        tracing::debug!(resolution = row.params.resolution(), gamma = row.params.gamma(), alpha = row.cost, "trial");
    }

    /// A study of `step` ended, with row `chosen` in use or with none.
    pub(crate) fn measured(&self, step: u64, rows: &[Trial], chosen: Option<usize>) {
        let record = |(n, row): (usize, &Trial)| v1::TrialRecord {
            step,
            params: Some((&row.params).into()),
            cost: Some(row.measured.cost.into()),
            psnr_db: row.measured.quality.psnr_db(),
            chosen: Some(n) == chosen,
        };
        self.change(|state| {
            state.studies += 1;
            state.trials.extend(rows.iter().enumerate().map(record));
            let excess = state.trials.len().saturating_sub(MOST_TRIALS);
            state.trials.drain(..excess);
            if let Some(row) = chosen.map(|n| &rows[n]) {
                state.chosen = Some((&row.params).into());
                state.chosen_psnr_db = Some(row.measured.quality.psnr_db());
            }
        });
    }
}

impl Status {
    /// Writes what the tuner says at `/metrics`.
    pub(crate) fn write_metrics(&self, text: &mut Exposition) {
        let state = self.summary();
        text.counter("tuner_studies_total", "Studies that measured something.", state.studies as f64);
        text.counter(
            "tuner_lost_studies_total",
            "Studies that ended with nothing measured.",
            state.lost_studies as f64,
        );
        let trials = self.trials.load(Ordering::Relaxed);
        text.counter("tuner_trials_total", "Trials measured.", trials as f64);
        if let Some(step) = state.steps_seen.checked_sub(1) {
            text.gauge("tuner_step", "The newest step dealt with.", step as f64);
        }
        text.gauge("tuner_busy", "1 while a step is being dealt with.", f64::from(u8::from(state.busy)));
        let failed = !state.last_error.is_empty();
        text.gauge("tuner_failing", "1 if the last study ended with an error.", f64::from(u8::from(failed)));
        if let Some(psnr_db) = state.chosen_psnr_db {
            text.gauge("tuner_chosen_psnr_db", "Quality of the parameters in use, when they were tried.", psnr_db);
        }
    }
}

/// The gRPC face of [`Status`].
pub(crate) struct StatusService(pub Arc<Status>);

#[tonic::async_trait]
impl tuning_server::Tuning for StatusService {
    async fn status(
        &self,
        request: Request<v1::TunerStatusRequest>,
    ) -> Result<Response<v1::TunerStatus>, tonic::Status> {
        let with_trials = request.into_inner().with_trials;
        let trials = if with_trials { self.0.state.lock().trials.clone() } else { Vec::new() };
        Ok(Response::new(v1::TunerStatus { trials, ..self.0.summary() }))
    }
}
