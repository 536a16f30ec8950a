//! The stream of trials to the generator-node: one request at a time.

use super::error::{node_error, words};
use crate::evaluator::TrialError;
use lamina_rpc::daemon::Timeline;
use lamina_rpc::v1::{self, control_client::ControlClient};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout, timeout_at};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;
use tonic::{Status, Streaming};

/// What it is called in errors.
const NODE: &str = "generator-node";
/// A node that is at work says so every second; one that says nothing for so long is not.
const SILENCE: Duration = Duration::from_secs(20);

/// The generator-node's end of a study.
#[derive(Debug)]
pub(super) struct Generator {
    address: String,
    requests: mpsc::Sender<v1::TrialRequest>,
    replies: Streaming<v1::TrialReply>,
    /// The question that is not answered yet, and until when something has to be heard of it.
    asked: Option<(u64, Instant)>,
    /// The last question's.
    timeline: Timeline,
    step: u64,
    batches: u32,
    longest_side: u32,
}

impl Generator {
    /// Opens a stream of trials on the newest step.
    ///
    /// # Errors
    /// If the node does not answer, or has no step yet.
    pub(super) async fn open(control: &ControlClient<Channel>, address: &str) -> Result<Self, TrialError> {
        let failed = |status: Status| node_error(NODE, address, &words(&status));
        let (requests, stream) = mpsc::channel(1);
        let mut replies = control.clone().trials(ReceiverStream::new(stream)).await.map_err(failed)?.into_inner();
        let late = |_| node_error(NODE, address, &format!("named no step within {SILENCE:?}"));
        let greeting = timeout(SILENCE, replies.message()).await.map_err(late)?.map_err(failed)?;
        let greeting = greeting.filter(|g| g.trial_id == 0 && g.batches > 0);
        let v1::TrialReply { step, batches, longest_side, .. } =
            greeting.ok_or_else(|| node_error(NODE, address, "named no step; are all nodes of one version?"))?;
        Ok(Self {
            address: address.to_owned(),
            requests,
            replies,
            asked: None,
            timeline: Timeline::begin(),
            step,
            batches,
            longest_side,
        })
    }

    /// The step that all trials are of.
    pub(super) fn step(&self) -> u64 {
        self.step
    }

    /// Batches of sampled pixels that its reference has.
    pub(super) fn batches(&self) -> u32 {
        self.batches
    }

    /// The most sample points on a side of its volume.
    pub(super) fn longest_side(&self) -> u32 {
        self.longest_side
    }

    /// True if no answer is due.
    pub(super) fn is_idle(&self) -> bool {
        self.asked.is_none()
    }

    /// Sends a request under a fresh id, which it gives. The one before must have been answered.
    ///
    /// # Errors
    /// If the stream has ended.
    pub(super) async fn ask(&mut self, request: v1::TrialRequest) -> Result<u64, TrialError> {
        let trial_id = fresh_trial_id();
        let sent = self.requests.send(v1::TrialRequest { trial_id, ..request }).await;
        sent.map_err(|_| self.failed("ended the stream of trials; its log says why".to_owned()))?;
        self.asked = Some((trial_id, Instant::now() + SILENCE));
        self.timeline = Timeline::begin();
        Ok(trial_id)
    }

    /// The answer that is due; waits for ever if none is. Nothing is lost if the wait is given up.
    ///
    /// # Errors
    /// If the stream ends or the answer is late or another one's.
    pub(super) async fn reply(&mut self) -> Result<v1::TrialReply, TrialError> {
        loop {
            let Some((trial_id, deadline)) = self.asked else { return std::future::pending().await };
            let Ok(reply) = timeout_at(deadline, self.replies.message()).await else {
                return Err(self.failed(format!("said nothing of a trial for {SILENCE:?}; its log says why")));
            };
            match reply {
                Ok(Some(reply)) if reply.trial_id != trial_id => {
                    return Err(self.failed(format!("answered trial {} instead of {trial_id}", reply.trial_id)));
                }
                Ok(Some(reply)) if reply.at_work => self.asked = Some((trial_id, Instant::now() + SILENCE)),
                Ok(Some(reply)) => {
                    self.asked = None;
                    return Ok(reply);
                }
                Ok(None) => return Err(self.failed("ended the stream of trials; its log says why".to_owned())),
                Err(status) => return Err(self.failed(words(&status))),
            }
        }
    }

    /// What was waited for until the last answer, which has just come.
    pub(super) fn timeline(&mut self) -> Timeline {
        let mut timeline = std::mem::replace(&mut self.timeline, Timeline::begin());
        timeline.lap("generator-node", []);
        timeline
    }

    /// The error of an answer without a cost.
    pub(super) fn no_cost(&self) -> TrialError {
        self.failed("measured no cost of a trial".to_owned())
    }

    /// An error of this node.
    pub(super) fn failed(&self, reason: String) -> TrialError {
        node_error(NODE, &self.address, &reason)
    }
}

/// Unique over restarts of this tuner: starts at the clock's microseconds.
fn fresh_trial_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |d| d.as_micros() as u64);
    let _ = NEXT.compare_exchange(0, now.max(1), Ordering::Relaxed, Ordering::Relaxed);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
