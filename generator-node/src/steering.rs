//! Steering: requests from viz-nodes on their way to the simulation.

use crate::ingest::{IngestError, RunSpec};
use lamina_field_expression::ShownFields;
use lamina_model::{Invalid, RunInfo, Scene, SceneChange, Steerable, SteerableNumber, Steering, TriggerSpec};
use parking_lot::Mutex;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tokio::sync::{mpsc, watch};

/// Requests that wait for the simulation's connection.
const WAITING: usize = 64;

/// Between those who ask and the rank that listens.
#[derive(Debug, Default)]
pub(crate) struct SteeringRelay {
    listener: Mutex<Option<mpsc::Sender<Steering>>>,
    steerable: watch::Sender<Steerable>,
    /// The run that is shown.
    shown: Mutex<Option<ShownSpec>>,
}

/// A run of the simulation's, and what people have asked for.
#[derive(Debug)]
struct ShownSpec {
    run_id: String,
    spec: RunSpec,
    /// What it began to be shown under.
    scene: Scene,
    changes: Changes,
}

/// All that was asked for of how a run is shown, in one, and how often.
#[derive(Debug, Clone, Default)]
pub(crate) struct Changes {
    pub count: u32,
    pub all: SceneChange,
}

/// Why a request does not reach the simulation.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SteeringError {
    /// It cannot be asked for.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// It takes more than there is.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// It was meant for another run.
    #[error("run {0} has ended; another is shown")]
    OtherRun(String),
    /// The simulation's connection takes no more.
    #[error("the simulation has not taken the last {WAITING} requests")]
    Full,
}

impl SteeringRelay {
    /// The simulation of `run_id` listens, in place of one before, as long as it keeps what this gives.
    pub(crate) fn listen(self: &Arc<Self>, run_id: String, numbers: Vec<SteerableNumber>) -> Listening {
        let (sender, requests) = mpsc::channel(WAITING);
        *self.listener.lock() = Some(sender);
        self.steerable.send_modify(|now| {
            if !RunInfo::is_same_simulation(&now.run_id, &run_id) {
                *now = Steerable { run_id, triggers: now.triggers.take(), ..Steerable::default() };
            }
            (now.listens, now.paused, now.stopping, now.numbers) = (true, false, false, numbers);
        });
        Listening { requests, relay: self.clone() }
    }

    /// From now on the field of `info` is shown of the simulation's run that `spec` describes, under `scene`.
    pub(crate) fn begin(&self, info: &RunInfo, spec: &RunSpec, scene: &Scene) {
        let mut shown = self.shown.lock();
        let before = shown.take().filter(|shown| RunInfo::is_same_simulation(&shown.run_id, &info.id));
        let changes = before.map(|shown| shown.changes).unwrap_or_default();
        *shown = Some(ShownSpec { run_id: info.id.clone(), spec: spec.clone(), scene: scene.clone(), changes });
        self.steerable.send_modify(|now| {
            // A simulation that began after this run's last steps listens.
            if now.listens && !RunInfo::is_same_simulation(&now.run_id, &info.id) {
                return;
            }
            info.id.clone_into(&mut now.run_id);
            now.fields = spec.fields().map(|(name, _)| name.to_owned()).collect();
            (now.shown, now.transfer) = (info.field.clone(), Some(scene.transfer.clone()));
            now.effects = Some(scene.effects.clone());
        });
    }

    /// What people have asked for of the simulation's run `run_id`.
    pub(crate) fn changes(&self, run_id: &str) -> Option<Changes> {
        let shown = self.shown.lock();
        shown.as_ref().filter(|s| RunInfo::is_same_simulation(&s.run_id, run_id)).map(|s| s.changes.clone())
    }

    /// Remembers `change` for the pipeline's next step, if `has_memory` for the run and what it then reads.
    ///
    /// # Errors
    /// If run `run_id` has ended, has no such field, cannot be drawn so, or there is not the memory that it takes.
    pub(crate) fn show(
        &self,
        run_id: &str,
        change: SceneChange,
        has_memory: impl FnOnce(&RunSpec, &ShownFields) -> Result<(), IngestError>,
    ) -> Result<(), SteeringError> {
        let mut shown = self.shown.lock();
        let other = || SteeringError::OtherRun(run_id.to_owned());
        let of_run = shown.as_mut().filter(|s| RunInfo::is_same_simulation(&s.run_id, run_id)).ok_or_else(other)?;
        if let Some(field) = &change.field {
            has_memory(&of_run.spec, &of_run.spec.shown_fields(field, None)?)?;
        }
        let all = of_run.changes.all.clone().then(change);
        all.apply(of_run.scene.clone()).check()?;
        of_run.changes = Changes { count: of_run.changes.count + 1, all };
        Ok(())
    }

    /// Hands a request on.
    ///
    /// # Errors
    /// If it cannot reach the simulation, or asks for what it does not offer.
    pub(crate) fn steer(&self, run_id: &str, steering: Steering) -> Result<(), SteeringError> {
        let listener = self.listener.lock();
        let mut steerable = self.steerable.borrow().clone();
        if steerable.listens && !RunInfo::is_same_simulation(&steerable.run_id, run_id) {
            return Err(SteeringError::OtherRun(run_id.to_owned()));
        }
        steerable.take(&steering.request)?;
        tracing::info!(run_id, request = %steering.request, asked_by = steering.asked_by, "steering");
        let sent = listener.as_ref().map(|listener| listener.try_send(steering));
        if !matches!(sent, Some(Ok(()))) {
            return Err(SteeringError::Full);
        }
        self.steerable.send_replace(steerable);
        Ok(())
    }

    /// The node's triggers are these now.
    pub(crate) fn set_triggers(&self, triggers: Vec<TriggerSpec>) {
        self.steerable.send_modify(|now| now.triggers = Some(triggers));
    }

    /// What can be asked for, now and after every change.
    pub(crate) fn steerable(&self) -> watch::Receiver<Steerable> {
        self.steerable.subscribe()
    }
}

/// The simulation's end.
#[derive(Debug)]
pub(crate) struct Listening {
    requests: mpsc::Receiver<Steering>,
    relay: Arc<SteeringRelay>,
}

impl futures::Stream for Listening {
    type Item = Steering;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Steering>> {
        self.requests.poll_recv(context)
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.requests.close();
        let mut listener = self.relay.listener.lock();
        // Another may listen in its place.
        if listener.as_ref().is_some_and(mpsc::Sender::is_closed) {
            *listener = None;
            self.relay.steerable.send_modify(|steerable| (steerable.listens, steerable.paused) = (false, false));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures::StreamExt;
    use glam::DVec3;
    use lamina_model::suggest::suggest;
    use lamina_model::{Effects, Grid, SteeringRequest, Volume, Voxels};

    #[test]
    fn what_cannot_be_drawn_so_is_refused_and_changes_nothing() {
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO).unwrap();
        let values = (0..512).map(|n| n as f32).collect();
        let scene = suggest(&[&Volume::new(grid, Voxels::F32(values)).unwrap()]).unwrap();
        let spec = RunSpec::of_one_rank("f", grid);
        let relay = SteeringRelay::default();
        relay.begin(&RunInfo { id: "r-1".into(), name: "r".into(), field: "f".into(), grid }, &spec, &scene);
        assert_eq!(relay.steerable().borrow().effects, Some(scene.effects));
        let ask = |effects: Effects| {
            let change = SceneChange { effects: Some(effects), ..SceneChange::default() };
            relay.show("r-1", change, |_, _| Ok(()))
        };
        let shadows = Effects { shadows: Some(0.5), ..Effects::default() };
        let refused = ask(shadows.clone()).unwrap_err().to_string();
        assert!(refused.contains("effects.light"), "{refused}");
        assert_eq!(relay.changes("r-1").unwrap().count, 0);
        ask(Effects { light: Some(DVec3::X), ..shadows }).unwrap();
        // What is asked for next leaves what was asked for before.
        relay.show("r-1", SceneChange { camera: Some(scene.camera), ..SceneChange::default() }, |_, _| Ok(())).unwrap();
        let Changes { count, all } = relay.changes("r-1").unwrap();
        assert_eq!((count, all.camera, all.effects.unwrap().shadows), (2, Some(scene.camera), Some(0.5)));
    }

    fn steering(request: SteeringRequest) -> Steering {
        Steering { request, asked_by: "a test".to_owned() }
    }

    #[tokio::test]
    async fn requests_reach_the_one_that_listens_as_long_as_it_does() {
        let relay = Arc::new(SteeringRelay::default());
        assert!(relay.steer("a", steering(SteeringRequest::Pause)).is_err(), "nobody listens");
        let mut first = relay.listen("a".to_owned(), Vec::new());
        relay.steer("a", steering(SteeringRequest::Pause)).unwrap();
        assert!(matches!(relay.steer("b", steering(SteeringRequest::Stop)), Err(SteeringError::OtherRun(_))));
        assert_eq!(first.next().await.unwrap().request, SteeringRequest::Pause);
        assert!(relay.steerable().borrow().paused);
        // A connection made anew listens in place of the one that is about to be missed.
        let second = relay.listen("a".to_owned(), Vec::new());
        assert!(first.next().await.is_none());
        drop(first);
        assert!(relay.steerable().borrow().listens && !relay.steerable().borrow().paused);
        (0..WAITING).for_each(|_| relay.steer("a", steering(SteeringRequest::Pause)).unwrap());
        assert!(matches!(relay.steer("a", steering(SteeringRequest::Stop)), Err(SteeringError::Full)));
        assert!(!relay.steerable().borrow().stopping, "what was not handed on is not shown");
        drop(second);
        assert!(!relay.steerable().borrow().listens && !relay.steerable().borrow().paused);
    }
}
