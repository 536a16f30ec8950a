//! Steps received: their numbers, and their VDIs in memory or in a folder.
//!
//! A recorded step is never lost: its bytes are whole in their file before its row is written, and rows are appended.

mod decoded_steps;
mod decoding;
mod earlier_run;
mod error;
mod folder;
mod request_log;
mod row;
mod run;
mod steps_csv;

pub use error::StoreError;
pub use row::{Number, QualityStatus, StepRow, ViewPsnr};
pub use run::Run;

use decoded_steps::DecodedSteps;
use folder::Folder;
use lamina_codec::DecodeLimits;
use lamina_vdi_render::QualityEstimate;
use parking_lot::{Mutex, MutexGuard};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::broadcast;
use tokio_stream::wrappers::BroadcastStream;
use tokio_stream::{Stream, StreamExt};

/// What changed, for those who watch.
#[derive(Debug, Clone)]
pub enum Event {
    /// Another run began.
    Run(Run),
    /// A step of the run of this id was recorded, or measured, or passed over.
    Step(String, Box<StepRow>),
    /// A trial was measured.
    Trial,
    /// The tuner came, went, or says something else.
    Tuner,
    /// The simulation can be asked for something else.
    Steerable,
}

#[derive(Debug, Default)]
struct StoreState {
    run: Option<Run>,
    rows: BTreeMap<u64, StepRow>,
    /// Steps whose quality is to be measured.
    pending: BTreeSet<u64>,
    in_memory: BTreeMap<u64, Arc<Vec<u8>>>,
    folder: Option<Folder>,
    decoded: DecodedSteps,
}

/// All steps of the current run.
#[derive(Debug)]
pub struct Store {
    root: Option<std::path::PathBuf>,
    memory_bytes: u64,
    limits: DecodeLimits,
    state: Mutex<StoreState>,
    events: broadcast::Sender<Event>,
}

impl Store {
    /// An empty store, or the one that was last recorded in `root`.
    ///
    /// # Errors
    /// If the folder cannot be made, read or written.
    pub fn open(root: Option<&Path>, memory_bytes: u64, limits: DecodeLimits) -> Result<Self, StoreError> {
        let mut state = StoreState::default();
        if let Some(root) = root
            && let Some((run, folder, rows)) = Folder::newest(root)?
        {
            tracing::info!(run = run.id, steps = rows.len(), "found recorded steps");
            state = StoreState {
                run: Some(run),
                rows: rows.into_iter().map(|r| (r.step, r)).collect(),
                folder: Some(folder),
                ..StoreState::default()
            };
        }
        let root = root.map(Path::to_owned);
        Ok(Self { root, memory_bytes, limits, state: Mutex::new(state), events: broadcast::Sender::new(1024) })
    }

    fn state(&self) -> MutexGuard<'_, StoreState> {
        self.state.lock()
    }

    /// Changes from now on; who falls behind misses some.
    pub fn events(&self) -> impl Stream<Item = Event> + Send + use<> {
        BroadcastStream::new(self.events.subscribe()).filter_map(Result::ok)
    }

    /// Turns to `run`; a run already recorded is gone on with.
    ///
    /// # Errors
    /// If its folder cannot be made or read.
    pub fn begin(&self, run: Run) -> Result<(), StoreError> {
        if self.state().run.as_ref().is_some_and(|r| r.id == run.id) {
            return Ok(());
        }
        let (folder, rows) = match &self.root {
            Some(root) => {
                let (folder, rows) = Folder::open(root, &run)?;
                (Some(folder), rows)
            }
            None => (None, Vec::new()),
        };
        let rows = rows.into_iter().map(|r| (r.step, r)).collect();
        *self.state() = StoreState { run: Some(run.clone()), rows, folder, ..StoreState::default() };
        // Nobody watching is not an error.
        let _ = self.events.send(Event::Run(run));
        Ok(())
    }

    /// Records a step: its bytes, then its row. A step recorded before stays as it was.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn record(&self, row: StepRow, bytes: Vec<u8>) -> Result<(), StoreError> {
        let mut state = self.state();
        if state.rows.contains_key(&row.step) {
            return Ok(());
        }
        if let Some(folder) = &mut state.folder {
            folder.record(&row, &bytes)?;
        } else {
            state.in_memory.insert(row.step, Arc::new(bytes));
            let mut held: u64 = state.in_memory.values().map(|b| b.len() as u64).sum();
            while held > self.memory_bytes && state.in_memory.len() > 1 {
                held -= state.in_memory.pop_first().map_or(0, |(_, b)| b.len() as u64);
            }
        }
        self.insert(&mut state, row);
        Ok(())
    }

    fn insert(&self, state: &mut StoreState, row: StepRow) {
        let run_id = state.run.as_ref().map(|r| r.id.clone()).unwrap_or_default();
        if row.measured == QualityStatus::Pending {
            state.pending.insert(row.step);
        } else {
            state.pending.remove(&row.step);
        }
        state.rows.insert(row.step, row.clone());
        // Nobody watching is not an error.
        let _ = self.events.send(Event::Step(run_id, Box::new(row)));
    }

    /// Adds what a recorded step's quality came to.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn measured(&self, step: u64, estimate: &QualityEstimate) -> Result<(), StoreError> {
        let mut state = self.state();
        let Some(row) = state.rows.get(&step).map(|row| row.with_quality(estimate)) else { return Ok(()) };
        self.update(&mut state, row)
    }

    /// Marks steps before `step` whose quality was to be measured as passed over; says how many.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn pass_over(&self, step: u64) -> Result<u64, StoreError> {
        let mut state = self.state();
        let pending = state.pending.range(..step).filter_map(|step| state.rows.get(step));
        let skipped = |row: &StepRow| StepRow { measured: QualityStatus::Skipped, ..row.clone() };
        let passed: Vec<StepRow> = pending.map(skipped).collect();
        let count = passed.len() as u64;
        passed.into_iter().try_for_each(|row| self.update(&mut state, row))?;
        Ok(count)
    }

    fn update(&self, state: &mut StoreState, row: StepRow) -> Result<(), StoreError> {
        let written = state.folder.as_mut().map_or(Ok(()), |folder| folder.settle(&row));
        self.insert(state, row);
        written
    }

    /// Tells pages what changed.
    pub fn announce(&self, event: Event) {
        // Nobody watching is not an error.
        let _ = self.events.send(event);
    }

    /// Takes down what somebody asked for, where the run is recorded.
    pub fn record_request(&self, asked_by: &str, request: &str) {
        let state = self.state();
        let Some(folder) = &state.folder else { return };
        let step = state.rows.last_key_value().map(|(step, _)| *step);
        if let Err(error) = request_log::append(folder.path(), step, asked_by, request) {
            tracing::error!("requests.csv: {error}; {asked_by} asked for: {request}");
        }
    }

    /// The current run.
    pub fn run(&self) -> Option<Run> {
        self.state().run.clone()
    }

    /// All recorded steps of the current run, by number.
    pub fn rows(&self) -> Vec<StepRow> {
        self.state().rows.values().cloned().collect()
    }

    /// Those of them after step `step`; all, if it is `None`.
    pub fn rows_after(&self, step: Option<u64>) -> Vec<StepRow> {
        let after = step.map_or(Bound::Unbounded, Bound::Excluded);
        self.state().rows.range((after, Bound::Unbounded)).map(|(_, row)| row.clone()).collect()
    }

    /// One recorded step.
    pub fn row(&self, step: u64) -> Option<StepRow> {
        self.state().rows.get(&step).cloned()
    }

    /// The newest step's number.
    pub fn newest_step(&self) -> Option<u64> {
        self.state().rows.keys().next_back().copied()
    }

    /// The bytes of `step`.
    ///
    /// # Errors
    /// If it is not held, or its file cannot be read.
    pub fn encoded(&self, step: u64) -> Result<Arc<Vec<u8>>, StoreError> {
        let state = self.state();
        if !state.rows.contains_key(&step) {
            return Err(StoreError::NoStep(step));
        }
        match &state.folder {
            Some(folder) => folder.read(step).map(Arc::new),
            None => state.in_memory.get(&step).cloned().ok_or(StoreError::NoStep(step)),
        }
    }
}
