//! One question for many parameters: the generator-node makes VDI after VDI, and every viz-node measures what it was given.

use super::generator::Generator;
use super::known::Known;
use super::progress::Progress;
use super::viewers::{Fault, Viewers};
use crate::evaluator::TrialError;
use futures::StreamExt;
use futures::future::BoxFuture;
use futures::stream::FuturesUnordered;
use lamina_model::{Invalid, ParamsKey, Quality};
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace};
use lamina_rpc::v1;
use std::collections::{HashMap, HashSet, VecDeque};
use tokio::time::{Instant, sleep_until};

/// Trials a viewer has before it: the one it measures, and one that is on its way meanwhile.
const AHEAD: usize = 2;
/// How often in a row a trial that was sent may be missing, for reasons of room or of the way.
const MISSES: u32 = 2;

/// What the generator-node is at: the parameters, and the viewer they are for, if any.
#[derive(Debug)]
pub(super) struct Generating {
    key: ParamsKey,
    viewer: Option<String>,
}

/// A viewer's answer about some parameters.
pub(super) struct Answer {
    key: ParamsKey,
    viewer: String,
    address: String,
    outcome: Result<Quality, Fault>,
}

/// What is under way.
pub(super) struct Round<'a> {
    pub(super) generator: &'a mut Generator,
    pub(super) viewers: &'a mut Viewers,
    pub(super) known: &'a mut HashMap<ParamsKey, Known>,
    pub(super) generating: &'a mut Option<Generating>,
    pub(super) progress: &'a Progress,
    pub(super) batches: u32,
    pub(super) asked: HashSet<ParamsKey>,
    /// To be generated.
    pub(super) todo: VecDeque<ParamsKey>,
    /// To be measured by the viewer that has them.
    pub(super) ready: VecDeque<(ParamsKey, String)>,
    /// Viewers that measure.
    pub(super) busy: HashSet<String>,
    pub(super) measuring: FuturesUnordered<BoxFuture<'static, Answer>>,
}

/// Sends the trace of a trial on `step`, from the request to the last number, to a collector if there is one.
pub(super) fn send(trial_id: u64, timeline: Timeline, step: u64) {
    let number = |n: u64| (n as i64).into();
    let said = [("lamina.trial_id", number(trial_id)), ("lamina.step", number(step))];
    timeline.send_first(Trace::of_trial(Role::Tuner, trial_id), "trial", said);
}

impl<'a> Round<'a> {
    /// With what `keys` lack as work.
    pub(super) fn with_work(mut self, keys: &[ParamsKey]) -> Self {
        let mut seen: HashSet<ParamsKey> = self.generating.iter().map(|g| g.key).collect();
        for key in keys.iter().filter(|k| seen.insert(**k)) {
            self.place(*key);
        }
        // In the order asked for; `place` puts what comes back first.
        self.todo.make_contiguous().reverse();
        self
    }

    /// Finds out what is lacking.
    ///
    /// # Errors
    /// If the generator-node fails, or no viewer is left. What was measured until then is known.
    pub(super) async fn run(mut self) -> Result<(), TrialError> {
        self.viewers.catch_up()?;
        self.recall();
        loop {
            self.start_measuring();
            self.start_generating().await?;
            let due = self.generating.as_ref().is_some_and(|g| self.asked.contains(&g.key));
            if !due && self.todo.is_empty() && self.ready.is_empty() && self.busy.is_empty() {
                return Ok(());
            }
            let alone = self.batches > 0 && self.viewers.present().is_empty() && self.busy.is_empty();
            let hope = self.viewers.hope();
            if alone && hope.is_none() {
                return Err(self.viewers.none_left());
            }
            tokio::select! {
                reply = self.generator.reply() => self.generated(reply?)?,
                Some(answer) = self.measuring.next(), if !self.busy.is_empty() => self.measured(answer),
                changed = self.viewers.changed() => changed?,
                () = sleep_until(hope.unwrap_or_else(Instant::now)), if alone => {}
            }
            self.recall();
        }
    }

    /// Puts parameters where they go next, if anything of them is lacking.
    fn place(&mut self, key: ParamsKey) {
        let known = &self.known[&key];
        if !self.asked.contains(&key) || !known.lacks(self.batches) {
            return;
        }
        match &known.held {
            Some((viewer, _)) if self.viewers.get(viewer).is_some() => self.ready.push_back((key, viewer.clone())),
            _ => self.todo.push_front(key),
        }
    }

    /// What waits for a viewer that is no longer there goes to another.
    fn recall(&mut self) {
        let viewers = &mut *self.viewers;
        let (stay, orphans) = self.ready.drain(..).partition(|(_, viewer)| viewers.get(viewer).is_some());
        self.ready = stay;
        let orphans: VecDeque<(ParamsKey, String)> = orphans;
        for (key, _) in orphans.into_iter().rev() {
            self.todo.push_front(key);
        }
    }

    fn start_measuring(&mut self) {
        let mut waiting = VecDeque::new();
        for (key, name) in self.ready.drain(..) {
            let (known, viewer) = (&self.known[&key], self.viewers.get(&name));
            let (Some((_, trial_id)), Some(viewer)) = (&known.held, viewer) else { continue };
            if !self.busy.insert(name.clone()) {
                waiting.push_back((key, name));
                continue;
            }
            let measure = viewer.measure(*trial_id, known.quality.batches() as u32..self.batches, self.progress.get());
            let address = viewer.address.clone();
            let answer = async move { Answer { key, viewer: name, address, outcome: measure.await } };
            self.measuring.push(Box::pin(answer));
        }
        self.ready = waiting;
    }

    async fn start_generating(&mut self) -> Result<(), TrialError> {
        if !self.generator.is_idle() || self.todo.is_empty() {
            return Ok(());
        }
        let viewer = self.least_loaded();
        if self.batches > 0 && viewer.is_none() {
            return Ok(());
        }
        let Some(key) = self.todo.pop_front() else { return Ok(()) };
        let request = v1::TrialRequest {
            params: Some((&self.known[&key].params).into()),
            viewer: viewer.clone().unwrap_or_default(),
            first_study: self.progress.get().is_urgent(),
            ..Default::default()
        };
        *self.generating = Some(Generating { key, viewer });
        self.generator.ask(request).await?;
        Ok(())
    }

    /// Who gets the next VDI; `None` if all have enough before them, or none is wanted.
    fn least_loaded(&mut self) -> Option<String> {
        if self.batches == 0 {
            return None;
        }
        let load = |name: &String| {
            usize::from(self.busy.contains(name)) + self.ready.iter().filter(|(_, viewer)| viewer == name).count()
        };
        let loads = self.viewers.present().iter().map(|v| (v.stalled, load(&v.name), v.given, v.name.clone()));
        let (.., name) = loads.filter(|(_, load, ..)| *load < AHEAD).min()?;
        self.viewers.get(&name)?.given += 1;
        self.progress.begin_trial();
        Some(name)
    }

    /// Takes in what the generator-node says.
    ///
    /// # Errors
    /// If it says nothing.
    pub(super) fn generated(&mut self, reply: v1::TrialReply) -> Result<(), TrialError> {
        let Some(Generating { key, viewer }) = self.generating.take() else { return Ok(()) };
        let timeline = self.generator.timeline();
        let Some(known) = self.known.get_mut(&key) else { return Ok(()) };
        if !reply.refusal.is_empty() {
            known.refusal = Some(Invalid::new("candidate", reply.refusal));
            return Ok(());
        }
        let cost = reply.cost.ok_or_else(|| self.generator.no_cost())?;
        // One that is sent again keeps the cost it had.
        known.cost.get_or_insert(cost.into());
        if let Some(viewer) = viewer {
            if reply.viewer == viewer {
                known.held = Some((viewer, reply.trial_id));
                known.timeline = Some(timeline);
            } else {
                self.viewers.gone(&viewer);
            }
        } else {
            send(reply.trial_id, timeline, self.generator.step());
        }
        self.place(key);
        Ok(())
    }

    fn measured(&mut self, answer: Answer) {
        let Answer { key, viewer, address, outcome } = answer;
        self.busy.remove(&viewer);
        let Some(known) = self.known.get_mut(&key) else { return };
        match outcome.and_then(|q| known.quality.extend(&q).map_err(|e| Fault::Failed(format!("measured {e}")))) {
            Ok(()) => {
                known.missed = 0;
                if let (Some((_, trial_id)), Some(mut timeline)) = (&known.held, known.timeline.take()) {
                    timeline.lap("viz-node", []);
                    send(*trial_id, timeline, self.generator.step());
                }
                if let Some(viewer) = self.viewers.get(&viewer) {
                    viewer.stalled = false;
                }
            }
            Err(Fault::Stalled(reason)) => {
                known.held = None;
                self.viewers.stalled(&viewer, &reason);
            }
            Err(Fault::Lost(reason)) => {
                known.held = None;
                self.viewers.lost(&viewer, &reason);
            }
            Err(Fault::Refused(reason)) => {
                known.refusal = Some(Invalid::new("candidate", format!("viz-node {address}: {reason}")));
            }
            Err(Fault::Missing(reason)) => {
                known.held = None;
                known.missed += 1;
                if known.missed > MISSES {
                    known.missed = 0;
                    self.viewers.leave_out(&address, &reason);
                }
            }
            Err(Fault::Failed(reason)) => {
                known.held = None;
                self.viewers.leave_out(&address, &reason);
            }
        }
        self.place(key);
    }
}
