//! The root's door: which member takes the bricks of which rank.

use super::convert::boxes;
use super::{HeldSteps, Kind, MemberEvent, send};
use crate::ingest::{AssignMember, GridBox, Ingest, LOST_AFTER, Remarks, RunSpec};
use lamina_model::{Diagnostics, FullPolicy};
use lamina_mpi::Outbox;
use lamina_rpc::v1;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// A step of which all members together have all bricks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GroupArrived {
    /// The run's id.
    pub run_id: String,
    /// The run's description.
    pub spec: RunSpec,
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// Steps of the run that were never whole, or overtaken, so far.
    pub dropped_steps: u64,
    /// Ranks whose bricks it lacks, because they fell silent.
    pub lost_ranks: Vec<u32>,
    /// What ranks told of it beside the field.
    pub diagnostics: Diagnostics,
    /// Each member's boxes.
    pub members: Vec<Vec<GridBox>>,
}

/// How often steps that wait for a member are looked at.
const LOOK: Duration = Duration::from_millis(500);

/// Steps of which not all bricks have come, remembered.
const MOST_STEPS: usize = 64;

/// A step of which some members have all their bricks.
struct PartialStep {
    /// Simulation time.
    time: f64,
    members: BTreeMap<u32, Vec<GridBox>>,
    lost_ranks: Vec<u32>,
    diagnostics: Diagnostics,
    /// When one last said so.
    changed: Instant,
}

/// What the bricks of a step that have come make up.
enum Coverage {
    /// All of the grid.
    Whole,
    /// A part of it: others are to come.
    Partial,
    /// Never the grid, and why.
    Refused(String),
}

struct GroupRun {
    id: String,
    spec: RunSpec,
    /// Member of each rank that has come.
    ranks: BTreeMap<u32, u32>,
    steps: BTreeMap<u64, PartialStep>,
    /// Members all of whose ranks are lost: they are told of every step.
    absent: BTreeSet<u32>,
    /// The newest step that was whole.
    newest: Option<u64>,
    /// Whole steps that wait for the pipeline.
    queue: VecDeque<GroupArrived>,
    dropped_steps: u64,
}

impl GroupRun {
    fn coverage(&self, step: u64) -> Coverage {
        let Some(partial) = self.steps.get(&step) else { return Coverage::Partial };
        let all = || partial.members.values().flatten();
        let (covered, voxels): (usize, usize) = (all().map(GridBox::voxels).sum(), self.spec.grid.voxels());
        let are_all_in = self.ranks.len() == self.spec.ranks as usize
            && self.ranks.values().all(|member| partial.members.contains_key(member));
        // Of many boxes that takes a while: it is looked at once they could be all.
        if covered < voxels && !are_all_in {
            return Coverage::Partial;
        }
        if let Some((a, b)) = all().enumerate().find_map(|(n, a)| Some((a, all().skip(n + 1).find(|b| a.overlaps(b))?)))
        {
            let (a, b) = (range(a), range(b));
            return Coverage::Refused(format!(
                "step {step}: the bricks {a} and {b} overlap; each voxel belongs to one rank"
            ));
        }
        if covered == voxels {
            return Coverage::Whole;
        }
        if partial.lost_ranks.is_empty() {
            let ranks = self.spec.ranks;
            return Coverage::Refused(format!(
                "step {step}: the bricks of all {ranks} ranks cover {covered} of {voxels} voxels"
            ));
        }
        Coverage::Partial
    }
}

/// Members, ranks and steps of a group.
pub(crate) struct Door {
    outbox: Outbox,
    members: Mutex<Vec<Option<v1::GroupReady>>>,
    run: Mutex<Option<GroupRun>>,
    whole: Notify,
}

impl std::fmt::Debug for Door {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Door").field("members", &self.members).finish_non_exhaustive()
    }
}

impl Door {
    pub(crate) fn new(outbox: Outbox) -> Self {
        let members = Mutex::new(vec![None; outbox.size() as usize]);
        Self { outbox, members, run: Mutex::default(), whole: Notify::new() }
    }

    /// Waits until there is a whole step.
    pub(crate) async fn whole(&self) {
        loop {
            let whole = self.whole.notified();
            if self.run.lock().as_ref().is_some_and(|run| !run.queue.is_empty()) {
                return;
            }
            whole.await;
        }
    }

    /// The next whole step.
    pub(crate) fn take(&self) -> Option<GroupArrived> {
        let mut run = self.run.lock();
        let run = run.as_mut()?;
        let step = run.queue.pop_front()?;
        Some(GroupArrived { dropped_steps: run.dropped_steps, ..step })
    }

    /// Takes what members say unasked; for ever.
    pub(crate) async fn listen(
        self: Arc<Self>,
        (ingest, held): (Arc<Ingest>, HeldSteps),
        mut events: tokio::sync::mpsc::UnboundedReceiver<MemberEvent>,
    ) {
        let (mut looks, mut cadence) = (tokio::time::interval(LOOK), 1);
        loop {
            let event = tokio::select! {
                event = events.recv() => event,
                _ = looks.tick() => {
                    self.find_overdue(Instant::now());
                    continue;
                }
            };
            let Some(event) = event else { return };
            match event {
                MemberEvent::Ready(member, ready) => {
                    tracing::info!(member, address = ready.address, host = ready.host, "member of the group");
                    self.members.lock()[member as usize] = Some(ready);
                }
                MemberEvent::Arrival(member, arrival) => {
                    ingest.heard(&arrival.run_id);
                    let times = [arrival.interval_ns, arrival.push_ns];
                    let remarks = Remarks::new(arrival.diagnostics.clone(), times).unwrap_or_default();
                    // The root's own ranks have told it their times already; those of a run before tell nothing of this one.
                    let counts = member > 0 && self.is_of_run(&arrival.run_id);
                    if let Some([interval, push]) = remarks.pace.filter(|_| counts) {
                        ingest.time_step(interval, push);
                    }
                    self.arrive(member, &arrival, &remarks.diagnostics);
                    if std::mem::replace(&mut cadence, ingest.cadence()) != cadence {
                        self.tell_cadence(cadence);
                    }
                }
                MemberEvent::Run(v1::GroupRun { run_id }) => ingest.follow(&run_id),
                MemberEvent::Refusal(v1::GroupRefusal { run_id, reason }) => ingest.refuse(&run_id, &reason),
                MemberEvent::Dropped(v1::GroupStep { run_id, step }) => {
                    ingest.drop_step(&run_id, step);
                    held.lock().remove(&(run_id, step));
                }
                MemberEvent::Ranks(v1::GroupRanks { run_id, ranks }) => ingest.tell_ranks(&run_id, ranks),
                MemberEvent::Cadence(cadence) => ingest.set_cadence(cadence),
                MemberEvent::Overdue(v1::GroupOverdue { run_id, step, time }) => ingest.overdue(&run_id, step, time),
            }
        }
    }

    fn is_of_run(&self, run_id: &str) -> bool {
        self.run.lock().as_ref().is_some_and(|run| run.id == run_id)
    }

    /// A member has all its bricks of a step.
    fn arrive(&self, member: u32, arrival: &v1::GroupArrival, diagnostics: &Diagnostics) {
        let mut run = self.run.lock();
        let Some(run) = run.as_mut().filter(|run| run.id == arrival.run_id) else { return };
        let boxes = match boxes(&arrival.boxes, &run.spec.grid) {
            Ok(boxes) => boxes,
            Err(error) => return tracing::error!(member, %error, "group"),
        };
        let mut ranks = run.ranks.iter().filter(|(_, of)| **of == member).map(|(rank, _)| rank);
        if ranks.all(|rank| arrival.lost_ranks.contains(rank)) {
            run.absent.insert(member);
        } else {
            run.absent.remove(&member);
        }
        let (step, time, now) = (arrival.step, arrival.time, Instant::now());
        if run.newest.is_some_and(|newest| step <= newest) {
            return self.tell_dropped(&run.id, step, [member]);
        }
        let first = || PartialStep {
            time,
            members: BTreeMap::new(),
            lost_ranks: Vec::new(),
            diagnostics: Diagnostics::default(),
            changed: now,
        };
        let partial = run.steps.entry(step).or_insert_with(first);
        partial.changed = now;
        partial.lost_ranks.extend(&arrival.lost_ranks);
        partial.members.insert(member, boxes);
        if !partial.diagnostics.merge(diagnostics) {
            tracing::warn!(step, "more than {} diagnostics; some are left out", Diagnostics::MOST);
        }
        match run.coverage(step) {
            Coverage::Refused(reason) => self.refuse(run, step, reason),
            Coverage::Whole => self.queue(run, step),
            Coverage::Partial => {
                let has_it = |member: &&u32| run.steps.get(&step).is_some_and(|s| s.members.contains_key(member));
                for member in run.absent.iter().filter(|member| !has_it(member)) {
                    self.tell_overdue(*member, &run.id, step, time);
                }
                if run.steps.len() > MOST_STEPS
                    && let Some((oldest, partial)) = run.steps.pop_first()
                {
                    self.drop_step(run, oldest, partial.members.into_keys());
                }
            }
        }
    }

    /// Bricks that cannot make up a step: all ranks hear why.
    fn refuse(&self, run: &mut GroupRun, step: u64, reason: String) {
        tracing::warn!(reason, "step refused");
        let refusal = v1::GroupRefusal { run_id: run.id.clone(), reason };
        (0..self.outbox.size()).for_each(|to| send(&self.outbox, to, 0, Kind::Refusal(refusal.clone())));
        if let Some(partial) = run.steps.remove(&step) {
            self.drop_step(run, step, partial.members.into_keys());
        }
    }

    /// A step is whole: those before it are not waited for any more.
    fn queue(&self, run: &mut GroupRun, step: u64) {
        let later = run.steps.split_off(&(step + 1));
        let mut before = std::mem::replace(&mut run.steps, later);
        let Some(mut whole) = before.remove(&step) else { return };
        for (overtaken, partial) in before {
            self.drop_step(run, overtaken, partial.members.into_keys());
        }
        run.newest = Some(step);
        let members = (0..self.outbox.size()).map(|m| whole.members.remove(&m).unwrap_or_default()).collect();
        let (run_id, spec, time) = (run.id.clone(), run.spec.clone(), whole.time);
        let PartialStep { lost_ranks, diagnostics, .. } = whole;
        let arrived = GroupArrived { run_id, spec, step, time, dropped_steps: 0, lost_ranks, diagnostics, members };
        run.queue.push_back(arrived);
        // Who watches sees the present, unless the simulation is to wait.
        while run.spec.full_policy != FullPolicy::Block && run.queue.len() > 1 {
            let Some(old) = run.queue.pop_front() else { break };
            self.drop_step(run, old.step, (0..).zip(&old.members).filter(|(_, b)| !b.is_empty()).map(|(m, _)| m));
        }
        self.whole.notify_one();
    }

    /// Counts a step that nothing is made of; the `members` that hold it let go of it.
    fn drop_step(&self, run: &mut GroupRun, step: u64, members: impl IntoIterator<Item = u32>) {
        run.dropped_steps += 1;
        self.tell_dropped(&run.id, step, members);
    }

    fn tell_dropped(&self, run_id: &str, step: u64, members: impl IntoIterator<Item = u32>) {
        for member in members {
            send(&self.outbox, member, 0, Kind::Dropped(v1::GroupStep { run_id: run_id.to_owned(), step }));
        }
    }

    /// Tells members of steps that lack their bricks, and that all others are past.
    fn find_overdue(&self, now: Instant) {
        let run = self.run.lock();
        let Some(run) = run.as_ref() else { return };
        let with_ranks: BTreeSet<u32> = run.ranks.values().copied().collect();
        for (step, partial) in run.steps.iter().filter(|(_, p)| now.saturating_duration_since(p.changed) >= LOST_AFTER)
        {
            let (have, lack): (Vec<u32>, Vec<u32>) =
                with_ranks.iter().copied().partition(|member| partial.members.contains_key(member));
            let is_past = |m: &u32| run.steps.range(step + 1..).any(|(_, later)| later.members.contains_key(m));
            if !have.is_empty() && have.iter().all(is_past) {
                lack.iter().for_each(|member| self.tell_overdue(*member, &run.id, *step, partial.time));
            }
        }
    }

    /// Ranks of all members push the same steps.
    fn tell_cadence(&self, cadence: u32) {
        (1..self.outbox.size()).for_each(|member| send(&self.outbox, member, 0, Kind::Cadence(cadence)));
    }

    fn tell_overdue(&self, member: u32, run_id: &str, step: u64, time: f64) {
        let overdue = v1::GroupOverdue { run_id: run_id.to_owned(), step, time };
        send(&self.outbox, member, 0, Kind::Overdue(overdue));
    }
}

/// A brick's indices, first to last of each axis.
fn range(brick: &GridBox) -> String {
    let axis = |a: usize| format!("{}..{}", brick.start()[a], brick.start()[a] + brick.dims()[a]);
    format!("[{}, {}, {}]", axis(0), axis(1), axis(2))
}

impl AssignMember for Door {
    /// Where `rank` of a run is to bring its bricks: the address of a member, on its own host if one is there; empty for the root.
    fn assign(&self, run_id: &str, spec: &RunSpec, rank: u32, host: &str) -> String {
        let members = self.members.lock().clone();
        let mut run = self.run.lock();
        if run.as_ref().is_none_or(|run| run.id != run_id) {
            for member in 1..self.outbox.size() {
                send(&self.outbox, member, 0, Kind::Run(v1::GroupRun { run_id: run_id.to_owned() }));
            }
            *run = Some(GroupRun {
                id: run_id.to_owned(),
                spec: spec.clone(),
                ranks: BTreeMap::new(),
                steps: BTreeMap::new(),
                absent: BTreeSet::new(),
                newest: None,
                queue: VecDeque::new(),
                dropped_steps: 0,
            });
        }
        let Some(run) = run.as_mut() else { return String::new() };
        let ready: Vec<u32> = (0..members.len() as u32).filter(|&m| members[m as usize].is_some()).collect();
        let is_near = |m: &u32| !host.is_empty() && members[*m as usize].as_ref().is_some_and(|r| r.host == host);
        let near: Vec<u32> = ready.iter().copied().filter(is_near).collect();
        let among = if near.is_empty() { &ready } else { &near };
        let ranks = spec.ranks.max(1);
        let chosen =
            among.get((u64::from(rank) * among.len() as u64 / u64::from(ranks)) as usize).copied().unwrap_or(0);
        let before = run.ranks.len();
        let member = *run.ranks.entry(rank).or_insert(chosen);
        if run.ranks.len() == ranks as usize && before < run.ranks.len() {
            for member in 0..self.outbox.size() {
                let ranks = run.ranks.values().filter(|&&m| m == member).count() as u32;
                send(&self.outbox, member, 0, Kind::Ranks(v1::GroupRanks { run_id: run_id.to_owned(), ranks }));
            }
        }
        let address = members.get(member as usize).and_then(|m| m.as_ref()).map(|ready| ready.address.clone());
        address.filter(|_| member > 0).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests;
