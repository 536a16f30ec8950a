//! Frames out: a bounded history that every subscriber reads at its own pace, and trials to the one they are meant for.
//!
//! Nothing here waits for a subscriber: one that falls behind what is held skips to the oldest held, or from there to the next key frame, which is
//! asked for.

use crate::delivery::Delivery;
use crate::ingest::Ingest;
use crate::steering::SteeringError;
use crate::subscribers::{Subscribers, reachable, trim};
use crate::triggers::{Measured, Triggers};
use futures::{Stream, StreamExt, stream};
use lamina_model::{RunInfo, SceneChange, Steering, TriggerChange};
use lamina_rpc::chunks::deliver;
use lamina_rpc::daemon::peer_of;
use lamina_rpc::v1::{self, delivery::Part, frames_server};
use lamina_rpc::{invalid, required};
use parking_lot::{Mutex, MutexGuard};
use std::collections::VecDeque;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;
use tokio_stream::wrappers::WatchStream;
use tonic::{Request, Response, Status, Streaming};

#[derive(Default)]
struct History {
    /// Live deliveries are held up to so many bytes.
    most_bytes: u64,
    next: u64,
    live: VecDeque<(u64, Delivery)>,
    subscribers: Subscribers,
}

impl History {
    /// Where run `run_id` begins, for one that has recorded part of it; the oldest held for all others.
    fn first_of(&self, run_id: &str) -> u64 {
        self.live.iter().find(|(_, delivery)| delivery.run.id == run_id).map_or(0, |(number, _)| *number)
    }

    /// The first delivery from number `cursor` on.
    fn from(&self, cursor: u64) -> Option<(u64, Delivery)> {
        self.live.get(self.live.partition_point(|(number, _)| *number < cursor)).cloned()
    }
}

/// The history and its subscribers.
pub(crate) struct Publisher {
    history: Mutex<History>,
    newest: watch::Sender<u64>,
    /// A subscriber lacks what steps are coded after.
    key_wanted: AtomicBool,
    /// Counts trials sent.
    trials: watch::Sender<u64>,
}

/// A viewer's place among those present; it leaves when this is dropped.
struct SubscriptionGuard {
    publisher: Arc<Publisher>,
    viewer: String,
}

impl Drop for SubscriptionGuard {
    fn drop(&mut self) {
        tracing::info!(viewer = self.viewer, "viz-node left");
        self.publisher.history().subscribers.leave(&self.viewer);
    }
}

impl Publisher {
    /// Holds up to `history_bytes` of live frames.
    pub(crate) fn new(history_bytes: u64) -> Self {
        let (newest, trials) = (watch::Sender::new(0), watch::Sender::new(0));
        let history = Mutex::new(History { most_bytes: history_bytes, ..History::default() });
        Self { history, newest, key_wanted: AtomicBool::new(false), trials }
    }

    /// Holds up to `history_bytes` of live frames from the next step on.
    pub(crate) fn set_history_bytes(&self, history_bytes: u64) {
        self.history().most_bytes = history_bytes;
    }

    fn history(&self) -> MutexGuard<'_, History> {
        self.history.lock()
    }

    /// The subscribers that measure trials, now and at every change.
    pub(crate) fn viewers(&self) -> watch::Receiver<v1::ViewerList> {
        self.history().subscribers.list()
    }

    /// How many there are.
    pub(crate) fn viewer_count(&self) -> usize {
        self.history().subscribers.count()
    }

    /// Adds a step's deliveries to the history.
    pub(crate) fn publish(&self, deliveries: Vec<Delivery>) {
        let mut history = self.history();
        for delivery in deliveries {
            let number = history.next;
            history.next += 1;
            history.live.push_back((number, delivery));
        }
        let mut bytes: u64 = history.live.iter().map(|(_, d)| d.bytes()).sum();
        while bytes > history.most_bytes && history.live.len() > 1 {
            bytes -= history.live.pop_front().map_or(0, |(_, d)| d.bytes());
        }
        let next = history.next;
        drop(history);
        self.newest.send_replace(next);
    }

    /// Sends a trial's deliveries to `viewer`; false if it is not there.
    pub(crate) fn publish_trial(&self, viewer: &str, deliveries: Vec<Delivery>) -> bool {
        {
            let mut history = self.history();
            let Some(waiting) = history.subscribers.waiting(viewer) else { return false };
            waiting.extend(deliveries);
            trim(waiting);
        }
        self.trials.send_modify(|sent| *sent += 1);
        true
    }

    /// True if the next step is to be a key frame, for a subscriber that joined or skipped some; until the next one does.
    pub(crate) fn take_key_wanted(&self) -> bool {
        self.key_wanted.swap(false, Ordering::Relaxed)
    }

    fn join(self: &Arc<Self>, address: String) -> SubscriptionGuard {
        let viewer = self.history().subscribers.join(address);
        SubscriptionGuard { publisher: self.clone(), viewer }
    }

    /// All live deliveries from `request` on, for ever.
    fn follow(self: Arc<Self>, request: v1::SubscribeRequest) -> impl Stream<Item = Delivery> + Send {
        let first = self.history().first_of(&request.run_id);
        let mut chain =
            Chain { publisher: self.clone(), recorded: request.after_step.map(|step| (request.run_id.clone(), step)) };
        let follower = (self.newest.subscribe(), first, self);
        let all = stream::unfold(follower, |(mut newest, cursor, publisher)| async move {
            loop {
                let found = publisher.history().from(cursor);
                if let Some((number, delivery)) = found {
                    return Some((delivery, (newest, number + 1, publisher)));
                }
                newest.wait_for(|&newest| newest > cursor).await.ok()?;
            }
        });
        all.filter_map(move |delivery| {
            let recorded = request.after_step.is_some_and(|step| delivery.is_recorded(&request.run_id, step));
            std::future::ready((!recorded && chain.takes(&delivery)).then_some(delivery))
        })
    }

    /// The trials for the holder of `guard`, for ever.
    fn follow_trials(self: Arc<Self>, guard: SubscriptionGuard) -> impl Stream<Item = Delivery> + Send {
        stream::unfold((self.trials.subscribe(), self, guard), |(mut trials, publisher, guard)| async move {
            loop {
                trials.mark_unchanged();
                let next = publisher.history().subscribers.waiting(&guard.viewer)?.pop_front();
                if let Some(delivery) = next {
                    return Some((delivery, (trials, publisher, guard)));
                }
                trials.changed().await.ok()?;
            }
        })
    }
}

/// What a subscriber has of the steps that others are coded after.
struct Chain {
    publisher: Arc<Publisher>,
    /// The newest step of its run.
    recorded: Option<(String, u64)>,
}

impl Chain {
    /// True if the subscriber can decode what is delivered; else it waits for a key frame.
    fn takes(&mut self, delivery: &Delivery) -> bool {
        let Part::Frame(frame) = &delivery.announcement else { return true };
        let has =
            |before: u64| self.recorded.as_ref().is_some_and(|(run, step)| *run == delivery.run.id && *step == before);
        if !frame.after_step.is_none_or(has) {
            self.publisher.key_wanted.store(true, Ordering::Relaxed);
            return false;
        }
        self.recorded = Some((delivery.run.id.clone(), frame.step));
        true
    }
}

type Deliveries = Pin<Box<dyn Stream<Item = Result<v1::Delivery, Status>> + Send>>;

/// As messages, each run announced before its first delivery.
fn messages(deliveries: impl Stream<Item = Delivery> + Send + 'static) -> Deliveries {
    let mut announced: Option<Arc<RunInfo>> = None;
    let messages = deliveries.flat_map(move |delivery| {
        let new_run = announced.as_ref().is_none_or(|run| run.id != delivery.run.id);
        announced = Some(delivery.run.clone());
        let run = new_run.then(|| v1::Delivery { part: Some(Part::Run((&*delivery.run).into())) });
        stream::iter(run.into_iter().chain(deliver(delivery.announcement, &delivery.payload)).map(Ok))
    });
    messages.boxed()
}

/// The gRPC face of [`Publisher`] and of steering.
pub(crate) struct FramesService {
    pub publisher: Arc<Publisher>,
    pub ingest: Arc<Ingest>,
    /// Those of the pipeline.
    pub triggers: Arc<Mutex<Triggers>>,
}

impl From<SteeringError> for Status {
    fn from(error: SteeringError) -> Self {
        match error {
            SteeringError::OtherRun(_) => Self::not_found(error.to_string()),
            SteeringError::Ingest(error) => error.into(),
            _ => Self::failed_precondition(error.to_string()),
        }
    }
}

#[tonic::async_trait]
impl frames_server::Frames for FramesService {
    type SubscribeStream = Deliveries;

    async fn subscribe(
        &self,
        request: Request<v1::SubscribeRequest>,
    ) -> Result<Response<Self::SubscribeStream>, Status> {
        tracing::info!("viz-node subscribed");
        Ok(Response::new(messages(self.publisher.clone().follow(request.into_inner()))))
    }

    type SubscribeTrialsStream = Deliveries;

    async fn subscribe_trials(
        &self,
        request: Request<v1::SubscribeTrialsRequest>,
    ) -> Result<Response<Self::SubscribeTrialsStream>, Status> {
        let peer = peer_of(&request).map(|peer| peer.address.ip());
        let address = reachable(&request.into_inner().quality_address, peer).map_err(|e| invalid(&e))?;
        let guard = self.publisher.join(address.clone());
        tracing::info!(viewer = guard.viewer, address, "viz-node measures trials");
        Ok(Response::new(messages(self.publisher.clone().follow_trials(guard))))
    }

    type SteerableStream = Pin<Box<dyn Stream<Item = Result<v1::Steerable, Status>> + Send>>;

    async fn steerable(&self, _: Request<v1::SteerableRequest>) -> Result<Response<Self::SteerableStream>, Status> {
        let changes = WatchStream::new(self.ingest.steering().steerable());
        Ok(Response::new(changes.map(|steerable| Ok(steerable.into())).boxed()))
    }

    async fn steer(&self, request: Request<v1::SteerRequest>) -> Result<Response<v1::SteerReply>, Status> {
        let v1::SteerRequest { run_id, steering } = request.into_inner();
        let steering = required(steering, "steering").and_then(Steering::try_from).map_err(|e| invalid(&e))?;
        self.ingest.steering().steer(&run_id, steering)?;
        Ok(Response::new(v1::SteerReply {}))
    }

    async fn show(&self, request: Request<v1::ShowRequest>) -> Result<Response<v1::ShowReply>, Status> {
        let request = request.into_inner();
        let (run_id, asked_by) = (request.run_id.clone(), request.asked_by.clone());
        let change = SceneChange::try_from(request).map_err(|e| invalid(&e))?;
        let asked_for = change.to_string();
        let shown = self.ingest.steering().show(&run_id, change, |spec, shown| self.ingest.show(spec, shown));
        shown.map_err(|error| match error {
            SteeringError::Invalid(e) => invalid(&e),
            other => other.into(),
        })?;
        tracing::info!(run_id, change = asked_for, asked_by, "to be shown otherwise");
        Ok(Response::new(v1::ShowReply {}))
    }

    async fn change_triggers(
        &self,
        request: Request<v1::ChangeTriggersRequest>,
    ) -> Result<Response<v1::ChangeTriggersReply>, Status> {
        let request = request.into_inner();
        let asked_by = request.asked_by.clone();
        let change = TriggerChange::try_from(request).map_err(|e| invalid(&e))?;
        let mut triggers = self.triggers.lock();
        triggers.change(&change).map_err(|e| invalid(&e))?;
        self.ingest.steering().set_triggers(triggers.specs());
        tracing::info!(%change, asked_by, "changed");
        Ok(Response::new(v1::ChangeTriggersReply {}))
    }

    async fn report(&self, request: Request<Streaming<v1::StepQuality>>) -> Result<Response<v1::ReportReply>, Status> {
        let mut reports = request.into_inner();
        while let Some(v1::StepQuality { run_id, step, psnr_db, limit_kept, skipped, .. }) = reports.message().await? {
            if !skipped {
                self.triggers.lock().measured(&run_id, Measured { step, psnr_db, limit_kept });
            }
        }
        Ok(Response::new(v1::ReportReply {}))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Frame, Grid};

    fn delivery(run_id: &str, step: u64, bytes: usize, trial_id: u64) -> Delivery {
        let grid = Grid::new([1; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap();
        let run = Arc::new(RunInfo { id: run_id.into(), name: String::new(), field: String::new(), grid });
        let trial_id = Some(trial_id).filter(|id| *id > 0);
        Delivery::frame(&run, Frame { step, trial_id, bytes: bytes as u64, ..Frame::default() }, vec![0; bytes])
    }

    /// Step and trial number of `n` deliveries; reference samples are trial 0.
    async fn numbers(deliveries: impl Stream<Item = Delivery>, n: usize) -> Vec<(u64, u64)> {
        let number = |delivery: Delivery| match delivery.announcement {
            Part::Frame(f) => (f.step, f.trial_id),
            Part::Reference(r) => (r.step, 0),
            _ => unreachable!(),
        };
        deliveries.take(n).map(number).collect().await
    }

    #[tokio::test]
    async fn late_subscribers_get_what_is_held_and_returning_ones_what_they_lack() {
        let publisher = Arc::new(Publisher::new(25));
        for step in 0..4 {
            publisher.publish(vec![delivery("a", step, 10, 0)]);
        }
        let steps = |request, n| numbers(publisher.clone().follow(request), n);
        assert_eq!(steps(v1::SubscribeRequest::default(), 2).await, [(2, 0), (3, 0)], "the oldest two went");
        let after = |run_id: &str, step| v1::SubscribeRequest { run_id: run_id.into(), after_step: Some(step) };
        assert_eq!(steps(after("a", 2), 1).await, [(3, 0)]);
        assert_eq!(steps(after("b", 9), 2).await, [(2, 0), (3, 0)]);
    }

    #[tokio::test]
    async fn who_lacks_what_steps_are_coded_after_waits_for_a_key_frame() {
        let publisher = Arc::new(Publisher::new(55));
        let after = |step: u64, after_step: Option<u64>| {
            let delivery = delivery("a", step, 10, 0);
            let Part::Frame(frame) = delivery.announcement else { unreachable!() };
            Delivery { announcement: Part::Frame(v1::Frame { after_step, ..frame }), ..delivery }
        };
        // Step 0, the key frame of the first three, is no longer held.
        for (step, before) in [(0, None), (1, Some(0)), (2, Some(1)), (3, None), (4, Some(3)), (5, Some(4))] {
            publisher.publish(vec![after(step, before)]);
        }
        let steps = |request, n| numbers(publisher.clone().follow(request), n);
        assert!(!publisher.take_key_wanted());
        assert_eq!(steps(v1::SubscribeRequest::default(), 3).await, [(3, 0), (4, 0), (5, 0)]);
        assert!(publisher.take_key_wanted() && !publisher.take_key_wanted());
        let recorded = |step| v1::SubscribeRequest { run_id: "a".into(), after_step: Some(step) };
        assert_eq!(steps(recorded(0), 5).await, [(1, 0), (2, 0), (3, 0), (4, 0), (5, 0)]);
        assert_eq!(steps(recorded(4), 1).await, [(5, 0)]);
        assert!(!publisher.take_key_wanted());
    }

    #[tokio::test]
    async fn a_trial_goes_to_the_viewer_named_and_waits_behind_no_frame() {
        let publisher = Arc::new(Publisher::new(25));
        let [one, two] = ["http://one:1", "http://two:2"].map(|a| publisher.join(a.into()));
        let names = [one.viewer.clone(), two.viewer.clone()];
        let addresses = |list: &v1::ViewerList| list.viewers.iter().map(|v| v.address.clone()).collect::<Vec<_>>();
        let mut list = publisher.viewers();
        assert_eq!(addresses(&list.borrow_and_update()), ["http://one:1", "http://two:2"]);
        let of_one = tokio::spawn(numbers(publisher.clone().follow_trials(one), 2));
        tokio::task::yield_now().await;
        // Frames that nobody takes.
        publisher.publish((0..9).map(|step| delivery("a", step, 1, 0)).collect());
        assert!(publisher.publish_trial(&names[0], vec![delivery("a", 3, 1, 8)]));
        assert!(publisher.publish_trial(&names[1], vec![delivery("a", 3, 1, 9)]));
        tokio::task::yield_now().await;
        assert!(publisher.publish_trial(&names[0], vec![delivery("a", 3, 1, 10)]));
        assert_eq!(of_one.await.unwrap(), [(3, 8), (3, 10)]);
        // The first one's stream has ended, and with it its place.
        list.changed().await.unwrap();
        assert_eq!(addresses(&list.borrow_and_update()), ["http://two:2"]);
        assert!(!publisher.publish_trial(&names[0], vec![delivery("a", 4, 1, 11)]));
        let reference = Part::Reference(v1::Reference { step: 3, ..Default::default() });
        let reference = Delivery { announcement: reference, ..delivery("a", 3, 0, 0) };
        publisher.publish_trial(&names[1], vec![reference, delivery("a", 3, 1, 12)]);
        assert_eq!(numbers(publisher.clone().follow_trials(two), 3).await, [(3, 9), (3, 0), (3, 12)]);
        assert!(addresses(&list.borrow_and_update()).is_empty());
    }
}
