//! What arrives, measured: live steps into the store, trials to whoever asked.

use crate::kernel::{Backend, PreparedVdi};
use crate::store::{Run, StepRow, Store};
use lamina_model::{Quality, ReferenceSamples};
use lamina_wire::codec::{self, DecodeLimits};
use lamina_wire::reference;
use lamina_wire::v1::{self, delivery::Part, quality_server};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use tonic::{Request, Response, Status};

/// Reference samples remembered.
const REFERENCES: usize = 8;
/// Trial results remembered until they are asked for.
const TRIALS: usize = 1024;
/// How long a question for a trial waits for its VDI to arrive.
const TRIAL_WAIT: Duration = Duration::from_secs(60);

type TrialResult = (u64, Result<Quality, Status>);

/// Counters for `/metrics`.
#[derive(Default)]
pub struct Counters {
    /// Live frames recorded.
    pub frames: AtomicU64,
    /// Bytes of live frames.
    pub frame_bytes: AtomicU64,
    /// Trials measured.
    pub trials: AtomicU64,
    /// Frames that could not be used.
    pub refused: AtomicU64,
    /// Connections made to the generator-node.
    pub connections: AtomicU64,
}

/// Measures quality and keeps results.
pub struct Meter {
    store: Arc<Store>,
    backend: Backend,
    limits: DecodeLimits,
    /// What was done so far.
    pub counters: Counters,
    references: Mutex<VecDeque<(String, Arc<ReferenceSamples>)>>,
    trials: watch::Sender<VecDeque<TrialResult>>,
}

impl Meter {
    /// Records into `store`; draws with `backend`; refuses VDIs beyond `limits`.
    pub fn new(store: Arc<Store>, backend: Backend, limits: DecodeLimits) -> Self {
        let trials = watch::Sender::new(VecDeque::new());
        Self { store, backend, limits, counters: Counters::default(), references: Mutex::default(), trials }
    }

    /// Takes one whole delivery. Blocking: decodes, renders, writes.
    pub fn take(&self, part: Part, payload: Vec<u8>) {
        let outcome = match part {
            Part::Run(run) => self.store.begin(Run::from(&run)).map_err(|e| e.to_string()),
            Part::Reference(announcement) => self.keep_reference(announcement, &payload),
            Part::Frame(frame) if frame.trial_id != 0 => {
                self.measure_trial(&frame, &payload);
                Ok(())
            }
            Part::Frame(frame) => self.record(&frame, payload),
            Part::Chunk(_) => Ok(()),
        };
        if let Err(error) = outcome {
            self.counters.refused.fetch_add(1, Ordering::Relaxed);
            tracing::error!("{error}");
        }
    }

    fn keep_reference(&self, announcement: v1::Reference, payload: &[u8]) -> Result<(), String> {
        let run_id = announcement.run_id.clone();
        let samples = reference::decode(announcement, payload).map_err(|e| e.to_string())?;
        let mut references = self.references.lock().unwrap_or_else(PoisonError::into_inner);
        references.retain(|(run, r)| !(*run == run_id && r.step == samples.step));
        references.push_back((run_id, Arc::new(samples)));
        if references.len() > REFERENCES {
            references.pop_front();
        }
        Ok(())
    }

    fn reference_of(&self, frame: &v1::Frame) -> Option<Arc<ReferenceSamples>> {
        let mut references = self.references.lock().unwrap_or_else(PoisonError::into_inner);
        let found = references.iter().position(|(run, r)| *run == frame.run_id && r.step == frame.step)?;
        let (run, samples) = references.remove(found)?;
        // A live frame is measured once; what a study uses stays the youngest while steps go on arriving.
        if frame.trial_id != 0 {
            references.push_back((run, samples.clone()));
        }
        Some(samples)
    }

    fn record(&self, frame: &v1::Frame, payload: Vec<u8>) -> Result<(), String> {
        let step = frame.step;
        let vdi = codec::decode(&payload, &self.limits).map_err(|e| format!("step {step}: {e}"))?;
        let vdi = PreparedVdi::new(Arc::new(vdi));
        let quality = self.reference_of(frame).map(|r| self.backend.quality(&vdi, &r, 0..r.plan.batches)).transpose();
        let quality = quality.map_err(|e| format!("step {step}: {e}"))?;
        let row = StepRow::new(frame, quality.as_ref());
        let bytes = row.size_bytes;
        self.store.record(row, payload, Arc::new(vdi)).map_err(|e| format!("step {step}: not recorded: {e}"))?;
        self.counters.frames.fetch_add(1, Ordering::Relaxed);
        self.counters.frame_bytes.fetch_add(bytes, Ordering::Relaxed);
        tracing::info!(step, bytes, psnr_db = quality.as_ref().map_or(f64::NAN, Quality::psnr_db), "recorded");
        Ok(())
    }

    fn measure_trial(&self, frame: &v1::Frame, payload: &[u8]) {
        let refused = |reason: String| Status::invalid_argument(reason);
        let result = codec::decode(payload, &self.limits).map_err(|e| refused(e.to_string())).and_then(|vdi| {
            let missing =
                || Status::failed_precondition(format!("no reference samples of step {} have arrived", frame.step));
            let reference = self.reference_of(frame).ok_or_else(missing)?;
            self.backend.quality(&PreparedVdi::new(&vdi), &reference).map_err(|e| refused(e.to_string()))
        });
        self.counters.trials.fetch_add(1, Ordering::Relaxed);
        self.trials.send_modify(|trials| {
            trials.push_back((frame.trial_id, result));
            if trials.len() > TRIALS {
                trials.pop_front();
            }
        });
    }
}

/// The gRPC face of [`Meter`] towards the tuner.
pub struct QualityService(pub Arc<Meter>);

#[tonic::async_trait]
impl quality_server::Quality for QualityService {
    async fn measure(&self, request: Request<v1::QualityRequest>) -> Result<Response<v1::QualityReply>, Status> {
        let id = request.into_inner().trial_id;
        let mut trials = self.0.trials.subscribe();
        let find =
            |trials: &VecDeque<TrialResult>| trials.iter().find(|(trial, _)| *trial == id).map(|(_, r)| r.clone());
        let arrived = tokio::time::timeout(TRIAL_WAIT, trials.wait_for(|t| find(t).is_some())).await;
        let found = match arrived {
            Ok(Ok(trials)) => find(&trials),
            Ok(Err(_)) => return Err(Status::unavailable("stopping")),
            Err(_) => None,
        };
        match found {
            Some(Ok(quality)) => Ok(Response::new((&quality).into())),
            Some(Err(status)) => Err(status),
            None => Err(Status::deadline_exceeded(format!(
                "trial {id}: its VDI did not arrive within {TRIAL_WAIT:?}; is this viz-node subscribed to the generator-node?"
            ))),
        }
    }
}
