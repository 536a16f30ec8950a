//! Admission of steps, as a plain state machine: no lock, no waiting, no sockets.
//!
//! Memory is decided before a byte is copied: a step is admitted with its whole grid's bytes or not at all.

use super::brick::{BrickBytes, BrickOffer};
use super::run::{IngestRun, RunSpec};
use super::{CompleteStep, IngestError, Remarks, assembly::Assembly};
use lamina_field_expression::ShownFields;
use lamina_model::FullPolicy;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The answer to a rank that wants to push.
#[derive(Debug, PartialEq, Eq)]
pub enum Admit {
    /// Send this many bytes.
    Granted(usize),
    /// Memory is full and the run blocks: ask again when some is free.
    Wait,
    /// Memory is full and the run drops this step.
    Dropped,
}

/// A step that has waited for longer is passed over for the newest, where the run's policy is to drop the oldest.
const STALE: Duration = Duration::from_secs(1);

/// All ingest state.
#[derive(Debug)]
pub struct Core {
    memory_bytes: u64,
    waiting_steps: usize,
    idle: Duration,
    used_bytes: u64,
    pub(super) run: Option<IngestRun>,
    queue: VecDeque<CompleteStep>,
    /// Of a group's node: how many ranks of which run come here.
    pub(super) told: Option<(String, u32)>,
    /// Of a group's node: the run that its root has opened last.
    pub(super) root_run: Option<String>,
    received_bytes: u64,
    /// Steps dropped of the runs before.
    dropped_before: u64,
}

/// How much has come and waits, for metrics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IngestFigures {
    /// Bytes of bricks received.
    pub received_bytes: u64,
    /// Steps dropped.
    pub dropped_steps: u64,
    /// Bytes of time steps held, and how many there may be.
    pub memory_bytes: (u64, u64),
    /// Whole steps that wait for their turn.
    pub waiting_steps: usize,
    /// Ranks that fell silent while the others went on.
    pub lost_ranks: usize,
}

impl Core {
    /// No run yet; `memory_bytes` for steps, of which `waiting_steps` may wait whole; a run silent for `idle` may be replaced.
    pub fn new(memory_bytes: u64, waiting_steps: usize, idle: Duration) -> Self {
        let (used_bytes, received_bytes, dropped_before) = (0, 0, 0);
        let (run, queue, told, root_run) = (None, VecDeque::new(), None, None);
        Self {
            memory_bytes,
            waiting_steps,
            idle,
            used_bytes,
            run,
            queue,
            told,
            root_run,
            received_bytes,
            dropped_before,
        }
    }

    /// Other limits from now on, as of [`Core::new`].
    pub fn set_limits(&mut self, memory_bytes: u64, waiting_steps: usize, idle: Duration) {
        (self.memory_bytes, self.waiting_steps, self.idle) = (memory_bytes, waiting_steps, idle);
    }

    /// How much has come and waits.
    pub fn figures(&self) -> IngestFigures {
        let run = self.run.as_ref();
        IngestFigures {
            received_bytes: self.received_bytes,
            dropped_steps: self.dropped_before + run.map_or(0, |run| run.dropped_steps),
            memory_bytes: (self.used_bytes, self.memory_bytes),
            waiting_steps: self.queue.len(),
            lost_ranks: run.map_or(0, |run| run.lost.len()),
        }
    }

    /// Attaches `rank` to the run it describes; `resume` is the id it had before this node was restarted, or empty, and
    /// `fresh_id` the one it gets if it is new.
    pub fn open(
        &mut self,
        spec: RunSpec,
        rank: u32,
        resume: &str,
        fresh_id: String,
        now: Instant,
    ) -> Result<String, IngestError> {
        let working_bytes = spec.working_bytes(&spec.check(rank, self.memory_bytes)?);
        if let Some(run) = &mut self.run
            && run.is_of(&spec, rank, resume, now.duration_since(run.last_heard), self.idle)?
        {
            run.attached.insert(rank);
            run.closed.remove(&rank);
            run.last_heard = now;
            run.called(rank, None, now);
            return Ok(run.id.clone());
        }
        self.abandon_run();
        let id = if resume.is_empty() { fresh_id } else { resume.to_owned() };
        let told_ranks = self.told.as_ref().filter(|(run, _)| *run == id).map(|(_, ranks)| *ranks);
        let mut run = IngestRun::new(id.clone(), spec, working_bytes, rank, now);
        run.told_ranks = told_ranks;
        self.run = Some(run);
        Ok(id)
    }

    /// Another field of the run that `spec` describes is to be shown: admits fewer steps where that takes more memory.
    ///
    /// # Errors
    /// If there is not the memory that this takes.
    pub fn show(&mut self, spec: &RunSpec, shown: &ShownFields) -> Result<(), IngestError> {
        spec.check_memory(shown, self.memory_bytes)?;
        if let Some(run) = self.run.as_mut().filter(|run| run.spec == *spec) {
            run.working_bytes = spec.working_bytes(shown);
        }
        Ok(())
    }

    pub(super) fn abandon_run(&mut self) {
        if let Some(run) = self.run.take() {
            self.dropped_before += run.dropped_steps;
            self.used_bytes -= run.steps.len() as u64 * run.spec.step_bytes();
        }
    }

    /// The run of this id, if it is the one that is served.
    pub(super) fn run(&mut self, id: &str) -> Result<&mut IngestRun, IngestError> {
        self.run.as_mut().filter(|r| r.id == id).ok_or_else(|| IngestError::UnknownRun(id.to_owned()))
    }

    /// Decides on a brick, and reserves its memory if granted.
    pub fn admit(&mut self, run_id: &str, offer: &BrickOffer, now: Instant) -> Result<Admit, IngestError> {
        let BrickOffer { step, rank, .. } = *offer;
        let run = self.run(run_id)?;
        run.last_heard = now;
        let brick = run.check_push(offer)?;
        run.called(rank, Some(step), now);
        // Who is not past the oldest step that waits cannot say that others hold it up.
        if run.steps.first_key_value().is_some_and(|(&oldest, _)| step > oldest) {
            self.give_up_lost(run_id, now);
        }
        let run = self.run(run_id)?;
        if let Some(reason) = run.refusals.remove(&rank) {
            run.last_step[rank as usize] = Some(step);
            self.forget(step);
            self.run(run_id)?.drop_step(step);
            return Err(IngestError::Refused(reason));
        }
        let bytes = brick.map_or(0, |brick| brick.voxels()) * run.spec.point_bytes();
        if run.cannot_complete(step) {
            run.last_step[rank as usize] = Some(step);
            run.drop_step(step);
            return Ok(Admit::Dropped);
        }
        let (need, working, policy) = (run.spec.step_bytes(), run.working_bytes, run.spec.full_policy);
        while let Some(passed) = self.run(run_id)?.passed_by(rank, step) {
            self.forget(passed);
            self.run(run_id)?.drop_step(passed);
        }
        if !self.run(run_id)?.steps.contains_key(&step) {
            while self.used_bytes + need + working > self.memory_bytes || self.queue.len() >= self.waiting_steps {
                if policy == FullPolicy::DropNewest {
                    let run = self.run(run_id)?;
                    run.last_step[rank as usize] = Some(step);
                    run.drop_step(step);
                    return Ok(Admit::Dropped);
                }
                if policy != FullPolicy::DropOldest || !self.drop_oldest() {
                    return Ok(Admit::Wait);
                }
            }
            self.used_bytes += need;
            self.run(run_id)?.steps.insert(step, Assembly::new(offer.time));
        }
        let run = self.run(run_id)?;
        // A group's nodes cover the grid together.
        let ranks = if run.spec.members == 1 { run.spec.ranks } else { u32::MAX };
        let voxels = run.spec.grid.voxels();
        if let Some(assembly) = run.steps.get_mut(&step)
            && let Err(refusal) = assembly.reserve(offer, ranks, brick, voxels)
        {
            // Bricks that disagree can never make a step; a second push of the same brick harms nothing.
            if !matches!(refusal, IngestError::Repeated { .. }) {
                self.forget(step);
                self.run(run_id)?.drop_step(step);
            }
            return Err(refusal);
        }
        Ok(Admit::Granted(bytes))
    }

    /// Drops the oldest waiting step, complete or not; false if there is none.
    fn drop_oldest(&mut self) -> bool {
        if let Some(old) = self.queue.pop_front() {
            self.used_bytes -= old.spec.step_bytes();
            if let Some(run) = self.run.as_mut().filter(|r| r.id == old.run_id) {
                run.drop_step(old.step);
            }
            return true;
        }
        let oldest = self.run.as_ref().and_then(|r| r.steps.keys().next().copied());
        oldest.is_some_and(|step| {
            self.forget(step);
            self.run.as_mut().is_some_and(|r| {
                r.drop_step(step);
                true
            })
        })
    }

    /// Makes room for a step that nothing came of, where there is some.
    pub(super) fn begin_step(&mut self, run_id: &str, step: u64, time: f64) {
        let (used_bytes, memory_bytes) = (self.used_bytes, self.memory_bytes);
        let Ok(run) = self.run(run_id) else { return };
        let need = run.spec.step_bytes();
        if !run.steps.contains_key(&step) && used_bytes + need + run.working_bytes <= memory_bytes {
            run.steps.insert(step, Assembly::new(time));
            self.used_bytes += need;
        }
    }

    /// Frees an incomplete step.
    pub(super) fn forget(&mut self, step: u64) {
        if let Some(run) = &mut self.run
            && run.steps.remove(&step).is_some()
        {
            self.used_bytes -= run.spec.step_bytes();
        }
    }

    /// What a rank tells with a brick that was admitted; false if the ranks tell too many diagnostics, and some are left out.
    pub fn remark(&mut self, run_id: &str, step: u64, remarks: &Remarks) -> bool {
        let assembly = self.run(run_id).ok().and_then(|run| run.steps.get_mut(&step));
        assembly.is_none_or(|assembly| assembly.remarks.merge(remarks))
    }

    /// Takes back a reservation whose bytes never came.
    pub fn abort(&mut self, run_id: &str, step: u64, (rank, index): (u32, u32)) {
        let Ok(run) = self.run(run_id) else { return };
        if run.steps.get_mut(&step).is_some_and(|a| a.release(rank, index)) {
            self.forget(step);
        }
    }

    /// Takes the bytes of brick `index` of `rank` of `step`. `None`: the step was dropped meanwhile. `Some(true)`: the step is complete.
    pub fn receive(
        &mut self,
        run_id: &str,
        step: u64,
        (rank, index): (u32, u32),
        bytes: impl Into<BrickBytes>,
        now: Instant,
    ) -> Result<Option<bool>, IngestError> {
        let run = self.run(run_id)?;
        run.last_heard = now;
        run.called(rank, Some(step), now);
        run.last_step[rank as usize] = Some(step);
        let ranks = run.ranks_here();
        let Some(assembly) = run.steps.get_mut(&step) else { return Ok(None) };
        let bytes = bytes.into();
        let count = bytes.len() as u64;
        assembly.fill(rank, index, bytes);
        let is_complete = assembly.is_complete(ranks, &run.lost);
        self.received_bytes += count;
        if !is_complete {
            return Ok(Some(false));
        }
        self.complete(run_id, step, now);
        Ok(Some(true))
    }

    /// Queues a step whose bricks are all in.
    pub(super) fn complete(&mut self, run_id: &str, step: u64, now: Instant) {
        let Ok(run) = self.run(run_id) else { return };
        // Every rank is past the older steps: what is missing there will not come.
        let older: Vec<u64> = run.steps.range(..step).map(|(s, _)| *s).collect();
        for old in older {
            self.forget(old);
            if let Ok(run) = self.run(run_id) {
                run.drop_step(old);
            }
        }
        let Ok(run) = self.run(run_id) else { return };
        if let Some(assembly) = run.steps.remove(&step) {
            let lost_ranks: Vec<u32> = run.lost.difference(&assembly.ranks_in()).copied().collect();
            let (time, boxes, remarks) = (assembly.time, assembly.boxes(), assembly.remarks.clone());
            let mut bricks = assembly.into_bricks();
            run.newest_whole = Some(step);
            if run.spec.members > 1 {
                bricks.extend(run.holes(&lost_ranks, &bricks));
                run.boxes.extend(boxes.into_iter().filter(|(rank, _)| !lost_ranks.contains(rank)));
            }
            let complete = CompleteStep {
                run_id: run_id.to_owned(),
                spec: run.spec.clone(),
                step,
                time,
                dropped_steps: run.dropped_steps,
                lost_ranks,
                remarks,
                completed: now,
                bricks,
            };
            let drops_oldest = run.spec.full_policy == FullPolicy::DropOldest;
            self.queue.push_back(complete);
            // Steps that were begun are taken whole, many at once where a rank was behind.
            while drops_oldest && self.queue.len() > self.waiting_steps {
                self.drop_oldest();
            }
        }
    }

    /// True if the run's policy is to let the simulation wait.
    pub fn blocks(&self) -> bool {
        self.run.as_ref().is_some_and(|run| run.spec.full_policy == FullPolicy::Block)
    }

    /// True if a complete step waits.
    pub fn has_complete(&self) -> bool {
        !self.queue.is_empty()
    }

    /// The oldest complete step, or the newest where the run drops the oldest and this one is stale: who watches sees the present.
    /// Its memory counts as working memory from here on.
    pub fn take_complete(&mut self, now: Instant) -> Option<CompleteStep> {
        let stale = |s: &CompleteStep| {
            s.spec.full_policy == FullPolicy::DropOldest && now.saturating_duration_since(s.completed) > STALE
        };
        if self.queue.front().is_some_and(stale) {
            while self.queue.len() > 1 {
                self.drop_oldest();
            }
        }
        let mut step = self.queue.pop_front()?;
        self.used_bytes -= step.spec.step_bytes();
        if let Some(run) = self.run.as_ref().filter(|r| r.id == step.run_id) {
            step.dropped_steps = run.dropped_steps;
        }
        Some(step)
    }

    /// Detaches `rank`; gives the number of steps dropped and, once nobody is there, of those that lack a brick.
    pub fn close(&mut self, run_id: &str, rank: u32, now: Instant) -> Result<u64, IngestError> {
        let run = self.run(run_id)?;
        run.last_heard = now;
        // A rank that closed does not join again: who comes in its place is a new start of the simulation.
        if run.attached.contains(&rank) {
            run.closed.insert(rank);
        }
        if run.ended() {
            let incomplete: Vec<u64> = run.steps.keys().copied().collect();
            for step in incomplete {
                self.forget(step);
                self.run(run_id)?.drop_step(step);
            }
        }
        let run = self.run(run_id)?;
        Ok(run.dropped_steps + if run.is_left() { run.steps.len() as u64 } else { 0 })
    }
}
