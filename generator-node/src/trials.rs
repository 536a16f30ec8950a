//! One stream of trials: candidate after candidate measured on one step, each VDI to the viewer that is to look at it.

use crate::node_state::NodeState;
use crate::spans;
use crate::step::{Purpose, Step};
use lamina_compute::{Activity, Laps, Permit, Priority};
use lamina_model::{Cost, GenerationParams, Invalid};
use lamina_rpc::Bytes;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace, with_heartbeat};
use lamina_rpc::{required, v1};
use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tonic::{Status, Streaming};

/// Encoded steps kept, so that one whose cost was asked for can be sent without being generated again.
const ENCODED: usize = 4;
/// Times kept for the same reason.
const TIMED: usize = 32;
/// After so long others have their turn.
const TURN: Duration = Duration::from_millis(50);
/// The most gammas of one request.
const MOST_GAMMAS: usize = 1024;

/// What a stream of trials remembers.
pub(crate) struct TrialSession {
    node: Arc<NodeState>,
    held: Arc<Step>,
    /// Viewers that have the step's reference samples.
    informed: HashSet<String>,
    encoded: VecDeque<(GenerationParams, Bytes, Cost)>,
    /// What was timed alone.
    timed: Vec<(GenerationParams, Cost)>,
}

/// Why a request got no numbers.
enum Failure {
    /// It is the request's fault; the next may do better.
    Refused(Invalid),
    /// The node cannot go on.
    Broken(Status),
}

impl From<Invalid> for Failure {
    fn from(invalid: Invalid) -> Self {
        Self::Refused(invalid)
    }
}

impl From<Status> for Failure {
    fn from(status: Status) -> Self {
        Self::Broken(status)
    }
}

impl TrialSession {
    /// TrialSession on the step `held`.
    pub(crate) fn new(node: Arc<NodeState>, held: Arc<Step>) -> Self {
        Self { node, held, informed: HashSet::new(), encoded: VecDeque::new(), timed: Vec::new() }
    }

    /// Answers request after request; the tuner's hanging up ends it.
    ///
    /// # Errors
    /// If a request has no trial id, or the node is stopping.
    pub(crate) async fn serve(
        mut self,
        mut requests: Streaming<v1::TrialRequest>,
        answers: &mpsc::Sender<Result<v1::TrialReply, Status>>,
    ) -> Result<(), Status> {
        let greeting = v1::TrialReply {
            run_id: self.held.run.id.clone(),
            step: self.held.step,
            batches: self.node.plan.batches,
            longest_side: self.held.longest_side(),
            ..Default::default()
        };
        if answers.send(Ok(greeting.clone())).await.is_err() {
            return Ok(());
        }
        while let Some(request) = requests.message().await? {
            if request.trial_id == 0 {
                return Err(Status::invalid_argument("trial_id: 0 means a live step; choose another number"));
            }
            let mut reply = v1::TrialReply { trial_id: request.trial_id, ..greeting.clone() };
            let at_work = v1::TrialReply { trial_id: request.trial_id, at_work: true, ..Default::default() };
            let mut timeline = Timeline::begin();
            let answered = with_heartbeat(self.answer(&request, &mut reply, &mut timeline), at_work, answers).await;
            timeline.send(Trace::of_trial(Role::Generator, request.trial_id));
            match answered {
                Some(Ok(())) => {}
                Some(Err(Failure::Refused(invalid))) => reply.refusal = invalid.to_string(),
                Some(Err(Failure::Broken(status))) => return Err(status),
                None => return Ok(()),
            }
            if answers.send(Ok(reply)).await.is_err() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Fills in `reply`.
    async fn answer(
        &mut self,
        request: &v1::TrialRequest,
        reply: &mut v1::TrialReply,
        timeline: &mut Timeline,
    ) -> Result<(), Failure> {
        let params: GenerationParams = required(request.params, "params")?.try_into()?;
        let priority = Priority::of_trial(request.first_study);
        if !request.gammas.is_empty() {
            let costs = self.costs(params, &request.gammas, priority).await?;
            reply.costs = costs.into_iter().map(Into::into).collect();
            timeline.lap("costs of several gammas", [("lamina.gammas", (request.gammas.len() as i64).into())]);
            return Ok(());
        }
        if request.time_alone {
            let held = self.held.clone();
            let cost = self.run(priority, move |_| held.time(&params)).await?;
            self.timed.truncate(TIMED - 1);
            self.timed.insert(0, (params, cost));
            reply.cost = Some(cost.into());
            timeline.lap("generate", []);
            return Ok(());
        }
        let (bytes, cost) = self.encoded(params, priority).await?;
        timeline.lap("generate and encode", spans::of_generated(&params, &cost));
        reply.cost = Some(cost.into());
        if !request.viewer.is_empty() {
            let frame = self.held.frame(&params, cost, bytes, Purpose::Trial(request.trial_id));
            let reference = match self.informed.contains(&request.viewer) {
                true => None,
                false => {
                    let (held, plan) = (self.held.clone(), self.node.plan.clone());
                    Some(self.run(priority, move |_| held.reference(&plan)).await?)
                }
            };
            if self.node.publisher.publish_trial(&request.viewer, reference.into_iter().chain([frame]).collect()) {
                self.informed.insert(request.viewer.clone());
                reply.viewer.clone_from(&request.viewer);
            }
            timeline.lap("publish", []);
        }
        Ok(())
    }

    /// The VDI and what it cost, generated now unless it was lately.
    async fn encoded(&mut self, params: GenerationParams, priority: Priority) -> Result<(Bytes, Cost), Failure> {
        if let Some((_, bytes, cost)) = self.encoded.iter().find(|(known, ..)| *known == params) {
            return Ok((bytes.clone(), *cost));
        }
        let (held, options) = (self.held.clone(), self.node.options);
        let known = self.timed.iter().find(|(timed, _)| *timed == params).map(|(_, cost)| cost.generation);
        let trial = self.run(priority, move |laps| held.measure_trial(&params, &options, known, laps)).await?;
        self.node.counters.trials.fetch_add(1, Ordering::Relaxed);
        let (bytes, cost) = (Bytes::from(trial.bytes), trial.cost);
        self.encoded.truncate(ENCODED - 1);
        self.encoded.push_front((params, bytes.clone(), cost));
        Ok((bytes, cost))
    }

    /// What the VDI for each of `gammas` costs; none of them stays.
    async fn costs(&self, params: GenerationParams, gammas: &[f64], priority: Priority) -> Result<Vec<Cost>, Failure> {
        if gammas.len() > MOST_GAMMAS {
            let many = gammas.len();
            return Err(Invalid::new("gammas", format!("{many} in one request; ask for at most {MOST_GAMMAS}")).into());
        }
        for &gamma in gammas {
            params.with_gamma(gamma)?;
        }
        let (held, options, gammas) = (self.held.clone(), self.node.options, gammas.to_vec());
        let (all, march_time) = self.run(priority, move |_| held.represent_all(&params, &gammas)).await?;
        let (mut costs, mut all) = (Vec::new(), all.into_iter());
        while all.len() > 0 {
            // What is more urgent comes in between: encoding dozens takes longer than a simulation should wait.
            let some = move |laps: &mut Laps| {
                let (mut some, begun) = (Vec::new(), Instant::now());
                while begun.elapsed() < TURN {
                    let Some(made) = all.next() else { break };
                    some.push(made.encode(march_time, &options, None)?.cost);
                }
                laps.lap(Activity::Encode);
                Ok((some, all))
            };
            let (some, rest) = self.run(priority, some).await?;
            costs.extend(some);
            all = rest;
        }
        Ok(costs)
    }

    /// Runs `work` when it is its turn, unless the tuner hangs up before.
    async fn run<T: Send + 'static>(
        &self,
        priority: Priority,
        work: impl FnOnce(&mut Laps) -> Result<T, Invalid> + Send + 'static,
    ) -> Result<T, Failure> {
        let permit: Permit = self.node.share.acquire(priority).await;
        let done = permit.run(Activity::Generate, work).await.map_err(|e| Status::internal(e.to_string()))?;
        Ok(done?)
    }
}
