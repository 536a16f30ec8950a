//! What the tuner asks for: trials that arrived, decoded and kept for as long as there is room, of which batches are measured;
//! and the quality of live steps.

use crate::kernel::{Detail, Prepared};
use crate::measure::Meter;
use crate::store::{Event, StepRow};
use lamina_model::{Quality, ReferenceSamples};
use lamina_wire::v1::{self, quality_server};
use std::collections::VecDeque;
use std::pin::Pin;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status};

/// Trials kept at once, the newest.
const KEPT: usize = 8;
/// Bytes of what was decoded kept at once; the newest one stays whatever it weighs.
const KEPT_BYTES: usize = 512 << 20;
/// Trials remembered as gone.
const GONE: usize = 1024;
/// How long a question for a trial waits for its VDI to arrive.
const TRIAL_WAIT: Duration = Duration::from_secs(60);

/// Measurements remembered for the page, the newest.
const MEASURED: usize = 256;

/// A trial that can be measured.
pub struct Ready {
    /// As announced.
    pub frame: v1::Frame,
    /// What is measured.
    pub shown: Prepared,
    /// With what it is compared.
    pub reference: Arc<ReferenceSamples>,
}

type Arrived = Result<Arc<Ready>, Status>;

#[derive(Default)]
struct Held {
    kept: VecDeque<(u64, Arrived)>,
    gone: VecDeque<u64>,
}

impl Held {
    /// What is known of the trial; `None` if it may still come.
    fn find(&self, trial_id: u64) -> Option<Arrived> {
        if let Some((_, arrived)) = self.kept.iter().find(|(id, _)| *id == trial_id) {
            return Some(arrived.clone());
        }
        let gone =
            || Err(Status::not_found(format!("trial {trial_id} had to make room for newer ones; send it again")));
        self.gone.contains(&trial_id).then(gone)
    }

    fn bytes(&self) -> usize {
        let ready = self.kept.iter().filter_map(|(_, arrived)| arrived.as_ref().ok());
        ready.map(|r| r.shown.size_bytes()).sum()
    }
}

/// The trials kept, and what those measured came to.
#[derive(Default)]
pub struct Trials {
    held: watch::Sender<Held>,
    measured: Mutex<VecDeque<(v1::Frame, Quality)>>,
}

impl Trials {
    /// Keeps what arrived as trial `trial_id`, or why it cannot be measured.
    pub fn keep(&self, trial_id: u64, arrived: Arrived) {
        self.held.send_modify(|held| {
            held.kept.push_back((trial_id, arrived));
            while held.kept.len() > KEPT || (held.kept.len() > 1 && held.bytes() > KEPT_BYTES) {
                held.gone.extend(held.kept.pop_front().map(|(id, _)| id));
            }
            let excess = held.gone.len().saturating_sub(GONE);
            held.gone.drain(..excess);
        });
    }

    /// The trial, waited for.
    async fn find(&self, trial_id: u64) -> Arrived {
        let mut held = self.held.subscribe();
        let late = || {
            Err(Status::not_found(format!(
                "trial {trial_id} did not arrive within {TRIAL_WAIT:?}; is this viz-node subscribed to the generator-node?"
            )))
        };
        match tokio::time::timeout(TRIAL_WAIT, held.wait_for(|held| held.find(trial_id).is_some())).await {
            Ok(Ok(held)) => held.find(trial_id).unwrap_or_else(late),
            Ok(Err(_)) => Err(Status::unavailable("stopping")),
            Err(_) => late(),
        }
    }

    fn measured(&self) -> MutexGuard<'_, VecDeque<(v1::Frame, Quality)>> {
        self.measured.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Remembers what some batches of a trial came to; with those before, if it was asked about again.
    fn remember(&self, frame: &v1::Frame, quality: &Quality) {
        let mut measured = self.measured();
        if let Some((_, known)) = measured.iter_mut().find(|(f, _)| f.trial_id == frame.trial_id) {
            if known.extend(quality).is_err() {
                *known = quality.clone();
            }
            return;
        }
        measured.push_back((frame.clone(), quality.clone()));
        if measured.len() > MEASURED {
            measured.pop_front();
        }
    }

    /// The numbers of the trials of run `run_id` that were measured, the oldest first.
    pub fn rows(&self, run_id: &str) -> Vec<StepRow> {
        let measured = self.measured();
        let of_run = measured.iter().filter(|(frame, _)| frame.run_id == run_id);
        of_run.map(|(frame, quality)| StepRow::new(frame, Some(quality))).collect()
    }
}

/// The gRPC face of [`Trials`] towards the tuner.
pub struct QualityService(pub Arc<Meter>);

#[tonic::async_trait]
impl quality_server::Quality for QualityService {
    async fn measure(&self, request: Request<v1::QualityRequest>) -> Result<Response<v1::QualityReply>, Status> {
        let v1::QualityRequest { trial_id, first_batch, batches } = request.into_inner();
        let ready = self.0.trials.find(trial_id).await?;
        let end = if batches == 0 { ready.reference.plan.batches } else { first_batch.saturating_add(batches) };
        let backend = self.0.backend.clone();
        let trial = ready.clone();
        let work = move || backend.quality(&trial.shown, &trial.reference, first_batch..end, Detail::Blended);
        let quality = tokio::task::spawn_blocking(work).await.map_err(|e| Status::internal(e.to_string()))?;
        let quality = quality.map_err(|e| lamina_wire::invalid(&e))?;
        self.0.trials.remember(&ready.frame, &quality);
        self.0.store.tried();
        self.0.counters.trials.fetch_add(1, Ordering::Relaxed);
        Ok(Response::new((&quality).into()))
    }

    type StepsStream = Pin<Box<dyn Stream<Item = Result<v1::StepQuality, Status>> + Send>>;

    async fn steps(&self, _: Request<v1::StepsRequest>) -> Result<Response<Self::StepsStream>, Status> {
        let measured = self.0.store.events().filter_map(|event| match event {
            Event::Step(run_id, row) => {
                Some(Ok(v1::StepQuality { run_id, step: row.step, psnr_db: row.psnr_db?.into() }))
            }
            Event::Run(_) | Event::Trial => None,
        });
        Ok(Response::new(Box::pin(measured)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::ViewError;
    use tonic::Code;

    #[tokio::test]
    async fn trials_are_waited_for_and_known_to_be_gone() {
        let trials = Arc::new(Trials::default());
        let code = |arrived: Arrived| arrived.err().unwrap().code();
        let asked = tokio::spawn({
            let trials = trials.clone();
            async move { trials.find(1).await }
        });
        tokio::task::yield_now().await;
        for trial_id in 1..=1 + KEPT as u64 {
            trials.keep(trial_id, Err(Status::data_loss("made up")));
            tokio::task::yield_now().await;
        }
        assert_eq!(code(asked.await.unwrap()), Code::DataLoss);
        assert_eq!(code(trials.find(1).await), Code::NotFound, "made room");
        assert_eq!(code(trials.find(2).await), Code::DataLoss);
    }

    #[test]
    fn what_trials_came_to_is_remembered_by_run_and_batches_add_up() {
        let trials = Trials::default();
        let quality = |mse: &[f64]| Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: mse.to_vec() }] };
        let frame = |trial_id, run_id: &str| v1::Frame { trial_id, run_id: run_id.into(), ..v1::Frame::default() };
        trials.remember(&frame(1, "a"), &quality(&[1e-4]));
        trials.remember(&frame(2, "b"), &quality(&[1e-3]));
        trials.remember(&frame(1, "a"), &quality(&[3e-4, 2e-4]));
        let decibels = |run: &str| trials.rows(run).iter().map(|r| r.psnr_db.unwrap().into()).collect::<Vec<f64>>();
        // The mean of three batches is 2e-4.
        assert!((decibels("a")[0] - 36.9897).abs() < 1e-4 && decibels("a").len() == 1, "{:?}", decibels("a"));
        assert!((decibels("b")[0] - 30.0).abs() < 1e-9);
        for id in 3..3 + MEASURED as u64 {
            trials.remember(&frame(id, "b"), &quality(&[1e-3]));
        }
        assert_eq!((trials.rows("a").len(), trials.rows("b").len()), (0, MEASURED));
    }
}
