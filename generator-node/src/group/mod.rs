//! A group of generator-nodes under MPI: each holds the bricks of some ranks, and all together make one VDI (sort-last, direct-send).
//!
//! The root commands, all members (the root among them) obey, in the order of the commands. Nothing here is in a simulation's way:
//! its ranks hand their bricks to one member each, and go on.

mod convert;
mod door;
mod ghosts;
mod lists;
mod member;
mod root;
mod statistics;
mod sums;
#[cfg(test)]
mod tests;
mod tiles;
mod window;

pub(crate) use door::{Door, GroupArrived};
pub(crate) use member::{HeldStep, HeldSteps, Member};
pub(crate) use root::{GroupField, GroupVdi, Root};

use crate::Config;
use crate::ingest::{Ingest, Remarks};
use lamina_mpi::{Inbox, MpiError, Outbox};
use lamina_rpc::daemon::Access;
use lamina_rpc::v1;
use lamina_rpc::v1::group_message::Kind;
use prost::Message as _;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// Hands a member's whole steps over to the group: they are held here, and the root is told. For ever.
pub(crate) async fn announce(ingest: Arc<Ingest>, held: HeldSteps, outbox: Outbox) {
    loop {
        ingest.complete().await;
        // Where the simulation is to wait, it waits for the group's work on the steps before.
        while ingest.blocks() && held.lock().len() >= MOST_WAITING {
            tokio::time::sleep(WHILE_FULL).await;
        }
        let Some(complete) = ingest.take() else { continue };
        let boxes = complete.boxes().map(convert::box_message).collect();
        let (run_id, step, time) = (complete.run_id.clone(), complete.step, complete.time);
        let (lost_ranks, Remarks { diagnostics, pace }) = (complete.lost_ranks.clone(), complete.remarks.clone());
        let [interval_ns, push_ns] = pace.unwrap_or_default().map(|time| time.as_nanos() as u64);
        let diagnostics = diagnostics.into();
        let (spec, bricks) = complete.into_bricks();
        {
            let mut held = held.lock();
            // Those of a run that ended are never asked for.
            held.retain(|(of_run, _), _| *of_run == run_id);
            held.insert((run_id.clone(), step), HeldStep { spec, bricks });
            while held.len() > MOST_HELD {
                held.pop_first();
            }
        }
        let arrival = v1::GroupArrival { run_id, step, time, boxes, lost_ranks, diagnostics, interval_ns, push_ns };
        send(&outbox, 0, 0, Kind::Arrival(arrival));
    }
}

/// Where this member can be reached.
pub(crate) fn ready(config: &Config, listener: &tokio::net::TcpListener, access: &Access) -> v1::GroupReady {
    let host = lamina_rpc::connect::host_name();
    let address = listener.local_addr().unwrap_or(config.listen);
    v1::GroupReady { address: access.reached_at(address).to_string(), host }
}

/// Pause before a full member looks again.
const WHILE_FULL: Duration = Duration::from_millis(2);

/// Whole steps that wait at a member where the simulation is to wait for them.
const MOST_WAITING: usize = 4;

/// Whole steps that a member holds at most: until the root asks for one, or tells that it does not. It is not to let go of one
/// before the root's word of it has come.
const MOST_HELD: usize = 32;

/// What the root hears of members unasked.
#[derive(Debug)]
pub(crate) enum MemberEvent {
    /// A member can be reached.
    Ready(u32, v1::GroupReady),
    /// A member has all bricks of its ranks.
    Arrival(u32, v1::GroupArrival),
    /// The root tells this member which run was opened.
    Run(v1::GroupRun),
    /// The root tells this member why bricks cannot make up a step.
    Refusal(v1::GroupRefusal),
    /// The root tells this member that nothing is made of a step that it may hold.
    Dropped(v1::GroupStep),
    /// The root tells this member how many ranks it has.
    Ranks(v1::GroupRanks),
    /// The root tells this member that all others are past a step.
    Overdue(v1::GroupOverdue),
    /// The root tells this member which steps its ranks push: those whose number is a multiple of this.
    Cadence(u32),
}

/// Where messages go in this process.
pub(crate) struct Channels {
    /// Commands, and what members tell each other.
    pub member: Receiver<(u32, v1::GroupMessage)>,
    /// Answers to the root.
    pub replies: Receiver<root::Answer>,
    /// What the root hears unasked, and the other way round.
    pub events: tokio::sync::mpsc::UnboundedReceiver<MemberEvent>,
}

/// Sends a message; one that cannot be sent is waited for in vain, and that is said where it is waited for.
pub(crate) fn send(outbox: &Outbox, to: u32, sequence: u64, kind: Kind) {
    let message = v1::GroupMessage { sequence, kind: Some(kind) };
    if let Err(error) = outbox.send(to, message.encode_to_vec()) {
        tracing::warn!(to, %error, "group");
    }
}

/// Sorts what comes, on a thread of its own, until the world ends.
pub(crate) fn receive(inbox: Inbox) -> Channels {
    let (to_member, member) = channel();
    let (to_root, replies) = channel();
    let (to_node, events) = tokio::sync::mpsc::unbounded_channel();
    std::thread::spawn(move || {
        loop {
            match inbox.receive(Duration::from_secs(3600)) {
                Ok((from, bytes)) => {
                    let Ok(message) = v1::GroupMessage::decode(&bytes[..]) else {
                        tracing::error!(from, "group: a message of another version");
                        continue;
                    };
                    if !sort(from, message, &to_member, &to_root, &to_node) {
                        return;
                    }
                }
                Err(MpiError::Timeout(_)) => {}
                Err(_) => return,
            }
        }
    });
    Channels { member, replies, events }
}

/// Passes one message on; false if nobody is there any more.
fn sort(
    from: u32,
    message: v1::GroupMessage,
    member: &Sender<(u32, v1::GroupMessage)>,
    root: &Sender<root::Answer>,
    node: &tokio::sync::mpsc::UnboundedSender<MemberEvent>,
) -> bool {
    match message.kind {
        Some(Kind::Reply(reply)) => root.send((from, message.sequence, reply)).is_ok(),
        Some(Kind::Ready(ready)) => node.send(MemberEvent::Ready(from, ready)).is_ok(),
        Some(Kind::Arrival(arrival)) => node.send(MemberEvent::Arrival(from, arrival)).is_ok(),
        Some(Kind::Run(run)) => node.send(MemberEvent::Run(run)).is_ok(),
        Some(Kind::Refusal(refusal)) => node.send(MemberEvent::Refusal(refusal)).is_ok(),
        Some(Kind::Dropped(step)) => node.send(MemberEvent::Dropped(step)).is_ok(),
        Some(Kind::Ranks(ranks)) => node.send(MemberEvent::Ranks(ranks)).is_ok(),
        Some(Kind::Overdue(overdue)) => node.send(MemberEvent::Overdue(overdue)).is_ok(),
        Some(Kind::Cadence(cadence)) => node.send(MemberEvent::Cadence(cadence)).is_ok(),
        _ => member.send((from, message)).is_ok(),
    }
}
