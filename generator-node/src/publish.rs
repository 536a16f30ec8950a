//! Frames out: a bounded history that every subscriber reads at its own pace, and trials to the one they are meant for.
//!
//! Nothing here waits for a subscriber: one that falls behind what is held skips to the oldest held.

use crate::viewers::{Viewers, reachable, trim};
use futures::{Stream, StreamExt, stream};
use lamina_wire::chunks::deliver;
use lamina_wire::invalid;
use lamina_wire::v1::{self, delivery::Part, frames_server};
use std::collections::VecDeque;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;
use tonic::codegen::Bytes;
use tonic::{Request, Response, Status};

/// Something to deliver: an announcement and its payload, of one run.
#[derive(Clone)]
pub struct Item {
    run: Arc<v1::Run>,
    announcement: Part,
    payload: Bytes,
}

impl Item {
    /// Reference samples or a frame of `run`.
    pub fn new(run: &Arc<v1::Run>, announcement: Part, payload: impl Into<Bytes>) -> Self {
        Self { run: run.clone(), announcement, payload: payload.into() }
    }

    /// Bytes of the payload.
    pub fn bytes(&self) -> u64 {
        self.payload.len() as u64
    }

    /// True for a VDI, false for what it is compared with.
    pub fn is_frame(&self) -> bool {
        matches!(self.announcement, Part::Frame(_))
    }

    /// True for live steps and their references up to `step` of run `run_id`.
    fn is_recorded(&self, run_id: &str, step: u64) -> bool {
        self.run.run_id == run_id
            && match &self.announcement {
                Part::Frame(f) => f.step <= step,
                Part::Reference(r) => r.step <= step,
                Part::Run(_) | Part::Chunk(_) => false,
            }
    }
}

#[derive(Default)]
struct Held {
    next: u64,
    live: VecDeque<(u64, Item)>,
    viewers: Viewers,
}

impl Held {
    /// Where run `run_id` begins, for one that has recorded part of it; the oldest held for all others.
    fn first_of(&self, run_id: &str) -> u64 {
        self.live.iter().find(|(_, item)| item.run.run_id == run_id).map_or(0, |(seq, _)| *seq)
    }

    /// What comes next for `viewer` from `cursor` on: a live item, or a trial (true) taken out of what waits for it.
    fn take_from(&mut self, cursor: u64, viewer: Option<&str>) -> Option<(u64, Item, bool)> {
        let live = self.live.get(self.live.partition_point(|(seq, _)| *seq < cursor));
        let before = |seq: u64| live.is_none_or(|(live, _)| seq < *live);
        let waiting = viewer.and_then(|v| self.viewers.waiting(v));
        match waiting.and_then(|w| w.pop_front_if(|(seq, _)| before(*seq))) {
            Some((seq, item)) => Some((seq, item, true)),
            None => live.cloned().map(|(seq, item)| (seq, item, false)),
        }
    }

    fn number(&mut self) -> u64 {
        self.next += 1;
        self.next - 1
    }
}

/// The history and its subscribers.
pub struct Publisher {
    history_bytes: u64,
    held: Mutex<Held>,
    newest: watch::Sender<u64>,
}

/// A viewer's place among those present; it leaves when this is dropped.
struct Seat {
    publisher: Arc<Publisher>,
    viewer: String,
}

impl Drop for Seat {
    fn drop(&mut self) {
        tracing::info!(viewer = self.viewer, "viz-node left");
        self.publisher.held().viewers.leave(&self.viewer);
    }
}

impl Publisher {
    /// Holds up to `history_bytes` of live frames.
    pub fn new(history_bytes: u64) -> Self {
        Self { history_bytes, held: Mutex::default(), newest: watch::Sender::new(0) }
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The subscribers that measure trials, now and at every change.
    pub fn viewers(&self) -> watch::Receiver<v1::ViewerList> {
        self.held().viewers.list()
    }

    /// Adds a step's items to the history.
    pub fn publish(&self, items: Vec<Item>) {
        let mut held = self.held();
        for item in items {
            let seq = held.number();
            held.live.push_back((seq, item));
        }
        let mut bytes: u64 = held.live.iter().map(|(_, i)| i.bytes()).sum();
        while bytes > self.history_bytes && held.live.len() > 1 {
            bytes -= held.live.pop_front().map_or(0, |(_, i)| i.bytes());
        }
        self.announce(held);
    }

    /// Sends a trial's items to `viewer`; false if it is not there.
    pub fn publish_trial(&self, viewer: &str, items: Vec<Item>) -> bool {
        let mut held = self.held();
        for item in items {
            let seq = held.number();
            let Some(waiting) = held.viewers.waiting(viewer) else { return false };
            waiting.push_back((seq, item));
            trim(waiting);
        }
        self.announce(held);
        true
    }

    fn announce(&self, held: MutexGuard<'_, Held>) {
        let next = held.next;
        drop(held);
        self.newest.send_replace(next);
    }

    fn seat(self: &Arc<Self>, address: String) -> Seat {
        let viewer = self.held().viewers.join(address);
        Seat { publisher: self.clone(), viewer }
    }

    /// All items from `request` on, then live ones for ever, and the trials for `seat`.
    fn follow(self: Arc<Self>, request: v1::SubscribeRequest, seat: Option<Seat>) -> impl Stream<Item = Item> + Send {
        let first = self.held().first_of(&request.run_id);
        let follower = (self.newest.subscribe(), first, self, seat);
        let all = stream::unfold(follower, |(mut newest, mut cursor, publisher, seat)| async move {
            loop {
                let next = {
                    let mut held = publisher.held();
                    let found = held.take_from(cursor, seat.as_ref().map(|s| s.viewer.as_str()));
                    if let Some((seq, item, trial)) = found {
                        drop(held);
                        return Some(((item, trial), (newest, seq + 1, publisher, seat)));
                    }
                    held.next
                };
                // What is numbered below is for others.
                cursor = next;
                newest.wait_for(|&newest| newest > next).await.ok()?;
            }
        });
        all.filter_map(move |(item, trial)| {
            // A trial is about a step that may long be recorded.
            let recorded = !trial && request.after_step.is_some_and(|step| item.is_recorded(&request.run_id, step));
            std::future::ready((!recorded).then_some(item))
        })
    }
}

/// The gRPC face of [`Publisher`].
pub struct FramesService(pub Arc<Publisher>);

#[tonic::async_trait]
impl frames_server::Frames for FramesService {
    type SubscribeStream = Pin<Box<dyn Stream<Item = Result<v1::Delivery, Status>> + Send>>;

    async fn subscribe(
        &self,
        request: Request<v1::SubscribeRequest>,
    ) -> Result<Response<Self::SubscribeStream>, Status> {
        let peer = request.remote_addr().map(|a| a.ip());
        let request = request.into_inner();
        let seat = match request.quality_address.as_str() {
            "" => None,
            address => Some(self.0.seat(reachable(address, peer).map_err(|e| invalid(&e))?)),
        };
        tracing::info!(
            viewer = seat.as_ref().map(|s| s.viewer.as_str()),
            request.quality_address,
            "viz-node subscribed"
        );
        let mut announced: Option<Arc<v1::Run>> = None;
        let deliveries = self.0.clone().follow(request, seat).flat_map(move |item| {
            let new_run = announced.as_ref().is_none_or(|run| run.run_id != item.run.run_id);
            announced = Some(item.run.clone());
            let run = new_run.then(|| v1::Delivery { part: Some(Part::Run((*item.run).clone())) });
            stream::iter(run.into_iter().chain(deliver(item.announcement, &item.payload)).map(Ok))
        });
        Ok(Response::new(deliveries.boxed()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(run_id: &str, step: u64, bytes: usize, trial_id: u64) -> Item {
        let run = Arc::new(v1::Run { run_id: run_id.into(), ..Default::default() });
        Item::new(
            &run,
            Part::Frame(v1::Frame { step, trial_id, bytes: bytes as u64, ..Default::default() }),
            vec![0; bytes],
        )
    }

    async fn steps(
        publisher: &Arc<Publisher>,
        request: v1::SubscribeRequest,
        seat: Option<Seat>,
        n: usize,
    ) -> Vec<(u64, u64)> {
        let number = |item: Item| match item.announcement {
            Part::Frame(f) => (f.step, f.trial_id),
            Part::Reference(r) => (r.step, 0),
            _ => unreachable!(),
        };
        publisher.clone().follow(request, seat).take(n).map(number).collect().await
    }

    #[tokio::test]
    async fn late_subscribers_get_what_is_held_and_returning_ones_what_they_lack() {
        let publisher = Arc::new(Publisher::new(25));
        for step in 0..4 {
            publisher.publish(vec![item("a", step, 10, 0)]);
        }
        let all = v1::SubscribeRequest::default();
        assert_eq!(steps(&publisher, all.clone(), None, 2).await, [(2, 0), (3, 0)], "the oldest two went");
        let request = |run_id: &str, step| v1::SubscribeRequest {
            run_id: run_id.into(),
            after_step: Some(step),
            ..Default::default()
        };
        assert_eq!(steps(&publisher, request("a", 2), None, 1).await, [(3, 0)]);
        assert_eq!(steps(&publisher, request("b", 9), None, 2).await, [(2, 0), (3, 0)]);
    }

    #[tokio::test]
    async fn a_trial_goes_to_the_viewer_named_and_to_nobody_else() {
        let publisher = Arc::new(Publisher::new(25));
        publisher.publish(vec![item("a", 3, 1, 0)]);
        let [one, two] = ["http://one:1", "http://two:2"].map(|a| publisher.seat(a.into()));
        let names = [one.viewer.clone(), two.viewer.clone()];
        let addresses = |list: &v1::ViewerList| list.viewers.iter().map(|v| v.address.clone()).collect::<Vec<_>>();
        let mut list = publisher.viewers();
        assert_eq!(addresses(&list.borrow_and_update()), ["http://one:1", "http://two:2"]);
        let all = v1::SubscribeRequest::default();
        let live = tokio::spawn({
            let publisher = publisher.clone();
            async move { steps(&publisher, all, Some(one), 4).await }
        });
        tokio::task::yield_now().await;
        assert!(publisher.publish_trial(&names[0], vec![item("a", 3, 1, 8)]));
        assert!(publisher.publish_trial(&names[1], vec![item("a", 3, 1, 9)]));
        tokio::task::yield_now().await;
        publisher.publish(vec![item("a", 4, 1, 0)]);
        assert!(publisher.publish_trial(&names[0], vec![item("a", 3, 1, 10)]));
        assert_eq!(live.await.unwrap(), [(3, 0), (3, 8), (4, 0), (3, 10)]);
        // The first one's stream has ended, and with it its place.
        list.changed().await.unwrap();
        assert_eq!(addresses(&list.borrow_and_update()), ["http://two:2"]);
        assert!(!publisher.publish_trial(&names[0], vec![item("a", 4, 1, 11)]));
        // One that has recorded the step needs what its trials are compared with all the same.
        let reference = Part::Reference(v1::Reference { step: 3, ..Default::default() });
        let reference = Item { announcement: reference, ..item("a", 3, 0, 0) };
        publisher.publish_trial(&names[1], vec![reference, item("a", 3, 1, 12)]);
        let recorded = v1::SubscribeRequest { run_id: "a".into(), after_step: Some(4), ..Default::default() };
        assert_eq!(steps(&publisher, recorded, Some(two), 3).await, [(3, 9), (3, 0), (3, 12)]);
        assert!(addresses(&list.borrow_and_update()).is_empty());
    }
}
