//! Intake: live steps into the store as they arrive, the newest of them decoded and measured as processor time allows; trials to
//! where they are measured when asked for.

use crate::store::{Run, StepRow, Store, StoreError};
use crate::trials::{Arrived, ArrivedTrial, ShownTrials};
use lamina_codec::DecodeLimits;
use lamina_compute::{Activity, CpuShare, Priority};
use lamina_model::{Frame, Invalid, ReferenceSamples, RunInfo};
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Histogram, Timeline, Trace};
use lamina_rpc::reference;
use lamina_rpc::v1::{self, delivery::Part};
use lamina_vdi_render::{Backend, Detail};
use parking_lot::{Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::watch;
use tonic::Status;

/// Reference samples remembered of live steps, and of trials' steps.
const REFERENCES: usize = 8;

/// Counters for `/metrics`.
pub(crate) struct Counters {
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
    /// Live steps whose quality was not measured for want of processor time.
    pub unmeasured: AtomicU64,
    /// Encoded bytes of live steps.
    pub size_bytes: Histogram,
    /// Generation times of live steps, seconds.
    pub generation_secs: Histogram,
    /// Encoding times of live steps, seconds.
    pub encode_secs: Histogram,
    /// Quality of measured live steps, decibels.
    pub psnr_db: Histogram,
}

impl Default for Counters {
    fn default() -> Self {
        let zero = || AtomicU64::new(0);
        Self {
            frames: zero(),
            frame_bytes: zero(),
            trials: zero(),
            refused: zero(),
            connections: zero(),
            unmeasured: zero(),
            size_bytes: Histogram::new(Histogram::BYTES),
            generation_secs: Histogram::new(Histogram::SECONDS),
            encode_secs: Histogram::new(Histogram::SECONDS),
            psnr_db: Histogram::new(&[20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 60.0, 70.0, 80.0, 100.0]),
        }
    }
}

/// Recorded, and to be decoded and measured.
#[derive(Clone)]
struct LiveStep {
    run_id: String,
    step: u64,
    reference: Option<Arc<ReferenceSamples>>,
}

type References = VecDeque<(String, Arc<ReferenceSamples>)>;

/// Takes deliveries in.
pub(crate) struct Intake {
    /// Where live steps are recorded.
    pub store: Arc<Store>,
    /// What draws.
    pub backend: Backend,
    /// Processor time.
    pub share: CpuShare,
    limits: DecodeLimits,
    /// What was done so far.
    pub counters: Counters,
    live_references: Mutex<References>,
    trial_references: Mutex<References>,
    newest: watch::Sender<Option<LiveStep>>,
    /// Trials that can be asked for.
    pub trials: ShownTrials,
}

fn lock(references: &Mutex<References>) -> MutexGuard<'_, References> {
    references.lock()
}

/// Why the subscription is to begin anew.
fn unrecorded(error: &StoreError) -> Status {
    Status::unavailable(format!("not recorded: {error}; the steps from there on are asked for again"))
}

fn keep(references: &Mutex<References>, announcement: v1::Reference, payload: &[u8]) -> Result<(), String> {
    let run_id = announcement.run_id.clone();
    let samples = reference::decode(announcement, payload).map_err(|e| e.to_string())?;
    let mut references = lock(references);
    references.retain(|(run, r)| !(*run == run_id && r.step == samples.step));
    references.push_back((run_id, Arc::new(samples)));
    if references.len() > REFERENCES {
        references.pop_front();
    }
    Ok(())
}

fn find(references: &Mutex<References>, frame: &Frame) -> Option<Arc<ReferenceSamples>> {
    let references = lock(references);
    let found = references.iter().find(|(run, r)| *run == frame.run_id && r.step == frame.step);
    found.map(|(_, samples)| samples.clone())
}

impl Intake {
    /// Records into `store`; draws with `backend` within `share`; refuses what decodes to more than `limits` allow.
    pub(crate) fn new(store: Arc<Store>, backend: Backend, share: CpuShare, limits: DecodeLimits) -> Self {
        Self {
            store,
            backend,
            share,
            limits,
            counters: Counters::default(),
            live_references: Mutex::default(),
            trial_references: Mutex::default(),
            newest: watch::Sender::new(None),
            trials: ShownTrials::default(),
        }
    }

    /// Takes one whole delivery of live steps. Blocking: writes files.
    ///
    /// # Errors
    /// If a step cannot be recorded. The generator-node has it still: it is to be asked for again.
    pub(crate) fn take_live(&self, part: Part, payload: Vec<u8>) -> Result<(), Status> {
        match part {
            Part::Run(run) => match RunInfo::try_from(run) {
                Ok(run) => return self.begin(run.into()).map_err(|e| unrecorded(&e)),
                Err(invalid) => self.log(Err(invalid.to_string())),
            },
            Part::Reference(announcement) => self.log(keep(&self.live_references, announcement, &payload)),
            Part::Frame(frame) => {
                let (step, mut timeline) = (frame.step, Timeline::begin());
                let checked = Frame::try_from(frame).map_err(|e| e.to_string()).and_then(|frame| {
                    lamina_codec::check_any(&payload, &self.limits).map(|_| frame).map_err(|e| e.to_string())
                });
                match checked {
                    Ok(frame) => {
                        let size = [("lamina.size_bytes", (payload.len() as i64).into())];
                        self.record(&frame, payload).map_err(|e| unrecorded(&e))?;
                        timeline.lap("record", size);
                        timeline.send(Trace::of_step(Role::Viewer, &frame.run_id, step));
                        return Ok(());
                    }
                    Err(error) => self.log(Err(format!("step {step}: {error}"))),
                }
            }
            Part::Chunk(_) => {}
        }
        Ok(())
    }

    fn begin(&self, run: Run) -> Result<(), StoreError> {
        // The same run is announced again after a connection was lost; its study goes on.
        if self.store.run().is_none_or(|known| known.id != run.id) {
            self.trials.forget_study();
        }
        self.store.begin(run)
    }

    /// Takes one whole delivery of trials.
    pub(crate) fn take_trial(&self, part: Part, payload: Vec<u8>) -> Result<(), Status> {
        match part {
            Part::Reference(announcement) => self.log(keep(&self.trial_references, announcement, &payload)),
            Part::Frame(frame) => {
                let (trial_id, frame) = (frame.trial_id, Frame::try_from(frame));
                self.trials.keep(trial_id, self.arrived(frame, payload));
            }
            Part::Run(_) | Part::Chunk(_) => {}
        }
        Ok(())
    }

    fn arrived(&self, frame: Result<Frame, Invalid>, payload: Vec<u8>) -> Arrived {
        let frame = frame.map_err(|e| lamina_rpc::invalid(&e))?;
        let missing =
            || Status::failed_precondition(format!("no reference samples of step {} have arrived", frame.step));
        let reference = find(&self.trial_references, &frame).ok_or_else(missing)?;
        Ok(Arc::new(ArrivedTrial::new(frame, payload, reference, self.limits)))
    }

    fn log(&self, outcome: Result<(), String>) {
        if let Err(error) = outcome {
            self.counters.refused.fetch_add(1, Ordering::Relaxed);
            tracing::error!("{error}");
        }
    }

    fn record(&self, frame: &Frame, payload: Vec<u8>) -> Result<(), StoreError> {
        let step = frame.step;
        let reference = find(&self.live_references, frame);
        let (row, bytes) = (StepRow::live(frame, reference.is_some()), payload.len() as u64);
        self.counters.size_bytes.observe(bytes as f64);
        self.counters.generation_secs.observe(row.generation_ms / 1e3);
        self.counters.encode_secs.observe(row.encode_ms / 1e3);
        self.store.record(row, payload)?;
        self.counters.frames.fetch_add(1, Ordering::Relaxed);
        self.counters.frame_bytes.fetch_add(bytes, Ordering::Relaxed);
        tracing::info!(step, bytes, "recorded");
        self.newest.send_replace(Some(LiveStep { run_id: frame.run_id.clone(), step, reference }));
        Ok(())
    }

    /// Decodes and measures the newest step, again and again. Steps that newer ones overtake are left out, and say so.
    pub(crate) async fn follow_newest(self: Arc<Self>) {
        let mut newest = self.newest.subscribe();
        while newest.changed().await.is_ok() {
            let mut timeline = Timeline::begin();
            let permit = self.share.acquire(Priority::LiveStep).await;
            // By now a newer one may be there.
            let Some(LiveStep { run_id, step, reference }) = newest.borrow_and_update().clone() else { continue };
            timeline.lap("wait", []);
            self.pass_over(step);
            let store = self.store.clone();
            let decoded = permit.run(Activity::Decode, move |_| store.prepared(step)).await;
            let shown = match decoded {
                Ok(Ok(shown)) => shown,
                Ok(Err(error)) => {
                    self.log(Err(error.to_string()));
                    continue;
                }
                Err(panic) => {
                    self.log(Err(format!("step {step}: not decoded: {panic}")));
                    continue;
                }
            };
            timeline.lap("decode", []);
            let trace = Trace::of_step(Role::Viewer, &run_id, step);
            timeline.send(trace);
            let Some(reference) = reference else { continue };
            let mut timeline = Timeline::begin();
            let permit = tokio::select! {
                biased;
                permit = self.share.acquire(Priority::Quality) => permit,
                _ = newest.changed() => {
                    newest.mark_changed();
                    self.share.skip(Priority::Quality);
                    self.pass_over(step + 1);
                    continue;
                }
            };
            timeline.lap("wait", []);
            let backend = self.backend.clone();
            let measure = move |_: &mut _| backend.estimate(&shown, &reference, Detail::Cubic);
            match permit.run(Activity::Measure, measure).await {
                Ok(Ok(estimate)) => {
                    tracing::info!(step, psnr_db = estimate.quality.psnr_db(), "measured");
                    self.counters.psnr_db.observe(estimate.quality.psnr_db());
                    timeline.lap("measure", [("lamina.psnr_db", estimate.quality.psnr_db().into())]);
                    timeline.send(trace);
                    self.log(self.store.measured(step, &estimate).map_err(|e| e.to_string()));
                }
                Ok(Err(error)) => self.log(Err(format!("step {step}: {error}"))),
                Err(panic) => self.log(Err(format!("step {step}: not measured: {panic}"))),
            }
        }
    }

    /// Marks what waits for its measurement before `step` as left out.
    fn pass_over(&self, step: u64) {
        match self.store.pass_over(step) {
            Ok(passed) => drop(self.counters.unmeasured.fetch_add(passed, Ordering::Relaxed)),
            Err(error) => self.log(Err(error.to_string())),
        }
    }
}
