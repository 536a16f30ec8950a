//! Frames out: a bounded history that every subscriber reads at its own pace.
//!
//! Nothing here waits for a subscriber: one that falls behind what is held skips to the oldest held.

use futures::{Stream, StreamExt, stream};
use lamina_wire::chunks::deliver;
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
    pub fn new(run: &Arc<v1::Run>, announcement: Part, payload: Vec<u8>) -> Self {
        Self { run: run.clone(), announcement, payload: payload.into() }
    }

    /// True for steps and references up to `step` of run `run_id`.
    fn is_recorded(&self, run_id: &str, step: u64) -> bool {
        self.run.run_id == run_id
            && match &self.announcement {
                Part::Frame(f) => f.trial_id == 0 && f.step <= step,
                Part::Reference(r) => r.step <= step,
                Part::Run(_) | Part::Chunk(_) => false,
            }
    }
}

#[derive(Default)]
struct Held {
    next: u64,
    live: VecDeque<(u64, Item)>,
    trials: VecDeque<(u64, Item)>,
}

impl Held {
    /// Where run `run_id` begins, for one that has recorded part of it; the oldest held for all others.
    fn first_of(&self, run_id: &str) -> u64 {
        self.live.iter().find(|(_, item)| item.run.run_id == run_id).map_or(0, |(seq, _)| *seq)
    }

    fn first_from(&self, cursor: u64) -> Option<(u64, Item)> {
        let find = |queue: &VecDeque<(u64, Item)>| queue.get(queue.partition_point(|(seq, _)| *seq < cursor)).cloned();
        match (find(&self.live), find(&self.trials)) {
            (Some(a), Some(b)) => Some(if a.0 < b.0 { a } else { b }),
            (a, b) => a.or(b),
        }
    }
}

/// Bytes of trial VDIs held for subscribers to fetch.
const TRIAL_BYTES: u64 = 128 << 20;

/// The history and its subscribers.
pub struct Publisher {
    history_bytes: u64,
    held: Mutex<Held>,
    newest: watch::Sender<u64>,
}

impl Publisher {
    /// Holds up to `history_bytes` of live frames.
    pub fn new(history_bytes: u64) -> Self {
        Self { history_bytes, held: Mutex::default(), newest: watch::Sender::new(0) }
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a step's items to the history.
    pub fn publish(&self, items: Vec<Item>) {
        self.add(items, |held| &mut held.live, self.history_bytes);
    }

    /// Adds a trial's items, for those subscribed now.
    pub fn publish_trial(&self, items: Vec<Item>) {
        self.add(items, |held| &mut held.trials, TRIAL_BYTES);
    }

    fn add(&self, items: Vec<Item>, queue: impl Fn(&mut Held) -> &mut VecDeque<(u64, Item)>, max_bytes: u64) {
        let mut held = self.held();
        for item in items {
            let seq = held.next;
            held.next += 1;
            queue(&mut held).push_back((seq, item));
        }
        let queue = queue(&mut held);
        let mut bytes: u64 = queue.iter().map(|(_, i)| i.payload.len() as u64).sum();
        while bytes > max_bytes && queue.len() > 1 {
            bytes -= queue.pop_front().map_or(0, |(_, i)| i.payload.len() as u64);
        }
        let next = held.next;
        drop(held);
        self.newest.send_replace(next);
    }

    /// All items from `request` on, then live ones for ever.
    fn follow(self: Arc<Self>, request: v1::SubscribeRequest) -> impl Stream<Item = Item> + Send {
        // Trials of the past are nobody's business any more.
        let trials_from = self.held().next;
        let first = self.held().first_of(&request.run_id);
        let follower = (self.newest.subscribe(), first, self);
        let all = stream::unfold(follower, |(mut newest, cursor, publisher)| async move {
            loop {
                let found = publisher.held().first_from(cursor);
                if let Some((seq, item)) = found {
                    return Some(((seq, item), (newest, seq + 1, publisher)));
                }
                newest.wait_for(|&next| next > cursor).await.ok()?;
            }
        });
        all.filter_map(move |(seq, item)| {
            let past_trial = matches!(&item.announcement, Part::Frame(f) if f.trial_id != 0) && seq < trials_from;
            let recorded = request.after_step.is_some_and(|step| item.is_recorded(&request.run_id, step));
            std::future::ready((!past_trial && !recorded).then_some(item))
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
        tracing::info!("viz-node subscribed");
        let mut announced: Option<Arc<v1::Run>> = None;
        let deliveries = self.0.clone().follow(request.into_inner()).flat_map(move |item| {
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

    async fn steps(publisher: &Arc<Publisher>, request: v1::SubscribeRequest, n: usize) -> Vec<(u64, u64)> {
        let number = |item: Item| match item.announcement {
            Part::Frame(f) => (f.step, f.trial_id),
            _ => unreachable!(),
        };
        publisher.clone().follow(request).take(n).map(number).collect().await
    }

    #[tokio::test]
    async fn late_subscribers_get_what_is_held_and_returning_ones_what_they_lack() {
        let publisher = Arc::new(Publisher::new(25));
        for step in 0..4 {
            publisher.publish(vec![item("a", step, 10, 0)]);
            publisher.publish_trial(vec![item("a", step, 1, 7)]);
        }
        let all = v1::SubscribeRequest::default();
        assert_eq!(
            steps(&publisher, all.clone(), 2).await,
            [(2, 0), (3, 0)],
            "the oldest two went, past trials are not told"
        );
        let after = v1::SubscribeRequest { run_id: "a".into(), after_step: Some(2) };
        assert_eq!(steps(&publisher, after, 1).await, [(3, 0)]);
        let other = v1::SubscribeRequest { run_id: "b".into(), after_step: Some(9) };
        assert_eq!(steps(&publisher, other, 2).await, [(2, 0), (3, 0)]);
        let live = tokio::spawn({
            let publisher = publisher.clone();
            async move { steps(&publisher, all, 4).await }
        });
        tokio::task::yield_now().await;
        publisher.publish_trial(vec![item("a", 3, 1, 8)]);
        publisher.publish(vec![item("a", 4, 1, 0)]);
        assert_eq!(live.await.unwrap(), [(2, 0), (3, 0), (3, 8), (4, 0)]);
    }
}
