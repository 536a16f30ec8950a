//! What arrives: live steps, measured, into the store; trials to where they are measured when asked for.

use crate::kernel::{Backend, Detail, Prepared};
use crate::store::{Run, StepRow, Store};
use crate::trials::{Ready, Trials};
use lamina_model::{Quality, ReferenceSamples};
use lamina_wire::codec::{self, DecodeLimits};
use lamina_wire::reference;
use lamina_wire::v1::{self, delivery::Part};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tonic::Status;

/// Reference samples remembered.
const REFERENCES: usize = 8;

/// Counters for `/metrics`.
#[derive(Default)]
pub struct Counters {
    /// Live frames recorded.
    pub frames: AtomicU64,
    /// Bytes of live frames.
    pub frame_bytes: AtomicU64,
    /// Questions about trials answered with a measurement.
    pub trials: AtomicU64,
    /// Frames that could not be used.
    pub refused: AtomicU64,
    /// Connections made to the generator-node.
    pub connections: AtomicU64,
}

/// Measures quality and keeps results.
pub struct Meter {
    /// Where live steps are recorded.
    pub store: Arc<Store>,
    /// What draws.
    pub backend: Backend,
    limits: DecodeLimits,
    /// What was done so far.
    pub counters: Counters,
    references: Mutex<VecDeque<(String, Arc<ReferenceSamples>)>>,
    /// Trials that can be asked for.
    pub trials: Trials,
}

impl Meter {
    /// Records into `store`; draws with `backend`; refuses VDIs beyond `limits`.
    pub fn new(store: Arc<Store>, backend: Backend, limits: DecodeLimits) -> Self {
        let (counters, trials) = (Counters::default(), Trials::default());
        Self { store, backend, limits, counters, references: Mutex::default(), trials }
    }

    /// Takes one whole delivery. Blocking: decodes, renders, writes.
    pub fn take(&self, part: Part, payload: Vec<u8>) {
        let outcome = match part {
            Part::Run(run) => self.store.begin(Run::from(&run)).map_err(|e| e.to_string()),
            Part::Reference(announcement) => self.keep_reference(announcement, &payload),
            Part::Frame(frame) if frame.trial_id != 0 => {
                self.trials.keep(frame.trial_id, self.prepare_trial(&frame, &payload));
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
        let decoded = codec::decode_any(&payload, &self.limits).map_err(|e| format!("step {step}: {e}"))?;
        let shown = Prepared::new(decoded);
        let quality = self
            .reference_of(frame)
            .map(|r| self.backend.quality(&shown, &r, 0..r.plan.batches, Detail::Blended))
            .transpose();
        let quality = quality.map_err(|e| format!("step {step}: {e}"))?;
        let row = StepRow::new(frame, quality.as_ref());
        let bytes = row.size_bytes;
        self.store.record(row, payload, Arc::new(shown)).map_err(|e| format!("step {step}: not recorded: {e}"))?;
        self.counters.frames.fetch_add(1, Ordering::Relaxed);
        self.counters.frame_bytes.fetch_add(bytes, Ordering::Relaxed);
        tracing::info!(step, bytes, psnr_db = quality.as_ref().map_or(f64::NAN, Quality::psnr_db), "recorded");
        Ok(())
    }

    /// A trial as it can be measured. What goes wrong is for whoever asks about it.
    fn prepare_trial(&self, frame: &v1::Frame, payload: &[u8]) -> Result<Arc<Ready>, Status> {
        let step = frame.step;
        let missing = || Status::failed_precondition(format!("no reference samples of step {step} have arrived"));
        let reference = self.reference_of(frame).ok_or_else(missing)?;
        let decoded = codec::decode_any(payload, &self.limits).map_err(|e| Status::invalid_argument(e.to_string()))?;
        Ok(Arc::new(Ready { frame: frame.clone(), shown: Prepared::new(decoded), reference }))
    }
}
