//! The root's door: which member takes the bricks of which rank.

use super::convert::boxes;
use super::{Kind, MemberEvent, send};
use crate::ingest::{AssignMember, GridBox, Ingest, RunSpec};
use lamina_model::FullPolicy;
use lamina_mpi::Outbox;
use lamina_rpc::v1;
use parking_lot::Mutex;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
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
    /// Each member's boxes.
    pub members: Vec<Vec<GridBox>>,
}

/// Steps of which not all bricks have come, remembered.
const MOST_STEPS: usize = 64;

struct GroupRun {
    id: String,
    spec: RunSpec,
    /// Member of each rank that has come.
    ranks: BTreeMap<u32, u32>,
    /// Simulation time of a step, and what members have of it.
    steps: BTreeMap<u64, (f64, BTreeMap<u32, Vec<GridBox>>)>,
    /// The newest step that was whole.
    newest: Option<u64>,
    /// Whole steps that wait for the pipeline.
    queue: VecDeque<GroupArrived>,
    dropped_steps: u64,
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
        ingest: Arc<Ingest>,
        mut events: tokio::sync::mpsc::UnboundedReceiver<MemberEvent>,
    ) {
        while let Some(event) = events.recv().await {
            match event {
                MemberEvent::Ready(member, ready) => {
                    tracing::info!(member, address = ready.address, host = ready.host, "member of the group");
                    self.members.lock()[member as usize] = Some(ready);
                }
                MemberEvent::Arrival(member, arrival) => {
                    ingest.heard(&arrival.run_id);
                    self.arrive(member, &arrival);
                }
                MemberEvent::Ranks(v1::GroupRanks { run_id, ranks }) => ingest.tell_ranks(&run_id, ranks),
            }
        }
    }

    /// A member has all its bricks of a step.
    fn arrive(&self, member: u32, arrival: &v1::GroupArrival) {
        let mut run = self.run.lock();
        let Some(run) = run.as_mut().filter(|run| run.id == arrival.run_id) else { return };
        let boxes = match boxes(&arrival.boxes, &run.spec.grid) {
            Ok(boxes) => boxes,
            Err(error) => return tracing::error!(member, %error, "group"),
        };
        let step = arrival.step;
        if run.newest.is_some_and(|newest| step <= newest) {
            return;
        }
        let (_, of_step) = run.steps.entry(step).or_insert_with(|| (arrival.time, BTreeMap::new()));
        of_step.insert(member, boxes);
        let all = || of_step.values().flatten();
        let covered: usize = all().map(GridBox::voxels).sum();
        let overlap = all().enumerate().any(|(n, a)| all().skip(n + 1).any(|b| a.overlaps(b)));
        if overlap {
            tracing::error!(step, "bricks of different members overlap; each voxel belongs to one rank");
            return;
        }
        if covered == run.spec.grid.voxels() {
            let members = (0..self.outbox.size()).map(|m| of_step.get(&m).cloned().unwrap_or_default()).collect();
            let later = run.steps.split_off(&(step + 1));
            // Those before it, and never this one.
            run.dropped_steps += run.steps.len() as u64 - 1;
            run.steps = later;
            run.newest = Some(step);
            let (run_id, spec) = (run.id.clone(), run.spec.clone());
            let whole = GroupArrived { run_id, spec, step, time: arrival.time, dropped_steps: 0, members };
            run.queue.push_back(whole);
            // Who watches sees the present, unless the simulation is to wait.
            while run.spec.full_policy != FullPolicy::Block && run.queue.len() > 1 {
                run.queue.pop_front();
                run.dropped_steps += 1;
            }
            self.whole.notify_one();
        } else if run.steps.len() > MOST_STEPS {
            run.steps.pop_first();
            run.dropped_steps += 1;
        }
    }
}

impl AssignMember for Door {
    /// Where `rank` of a run is to bring its bricks: the address of a member, on its own host if one is there; empty for the root.
    fn assign(&self, run_id: &str, spec: &RunSpec, rank: u32, host: &str) -> String {
        let members = self.members.lock().clone();
        let mut run = self.run.lock();
        if run.as_ref().is_none_or(|run| run.id != run_id) {
            *run = Some(GroupRun {
                id: run_id.to_owned(),
                spec: spec.clone(),
                ranks: BTreeMap::new(),
                steps: BTreeMap::new(),
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
