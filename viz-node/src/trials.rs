//! Trials that arrived, kept for as long as there is room, and what those measured came to.

use crate::store::StepRow;
use lamina_codec::{CodecError, DecodeLimits};
use lamina_model::{Frame, Quality, ReferenceSamples};
use lamina_vdi_render::Drawable;
use parking_lot::{Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};
use tokio::sync::watch;
use tonic::Status;

/// Trials kept at once, the newest.
const KEPT: usize = 8;
/// Bytes of what was decoded kept at once; the newest one stays whatever it weighs.
const KEPT_BYTES: usize = 512 << 20;
/// Measurements remembered for the page, the newest.
const MEASURED: usize = 256;

/// A trial that can be measured.
pub(crate) struct ArrivedTrial {
    /// As announced.
    pub frame: Frame,
    /// With what it is compared.
    pub reference: Arc<ReferenceSamples>,
    payload: Vec<u8>,
    limits: DecodeLimits,
    shown: OnceLock<Result<Drawable, CodecError>>,
}

impl ArrivedTrial {
    /// Not decoded yet.
    pub(crate) fn new(frame: Frame, payload: Vec<u8>, reference: Arc<ReferenceSamples>, limits: DecodeLimits) -> Self {
        Self { frame, reference, payload, limits, shown: OnceLock::new() }
    }

    /// What is measured; decoded by the first call.
    ///
    /// # Errors
    /// If its bytes are damaged or decode to too much.
    pub(crate) fn shown(&self) -> Result<&Drawable, &CodecError> {
        let decode = || lamina_codec::decode_any(&self.payload, &self.limits).map(Drawable::new);
        self.shown.get_or_init(decode).as_ref()
    }

    fn size_bytes(&self) -> usize {
        let decoded = self.shown.get().and_then(|shown| shown.as_ref().ok());
        self.payload.len() + decoded.map_or(0, Drawable::size_bytes)
    }
}

pub(crate) type Arrived = Result<Arc<ArrivedTrial>, Status>;

#[derive(Default)]
struct Held {
    kept: VecDeque<(u64, Arrived)>,
    /// Counts subscriptions: what was on its way on an earlier one does not come any more.
    subscription: u64,
    subscribed: bool,
    /// The newest trial that has come on this subscription: they come in the order of their numbers.
    newest: u64,
}

impl Held {
    /// What is known of the trial; `None` if it may still come to those who ask since `subscription`.
    fn find(&self, trial_id: u64, subscription: u64) -> Option<Arrived> {
        if let Some((_, arrived)) = self.kept.iter().find(|(id, _)| *id == trial_id) {
            return Some(arrived.clone());
        }
        let gone = |why: &str| Some(Err(Status::not_found(format!("trial {trial_id} {why}; send it again"))));
        if !self.subscribed || subscription != self.subscription {
            return gone("cannot arrive: this viz-node's subscription to the generator-node ended");
        }
        if trial_id <= self.newest { gone("had to make room for newer ones, or was overtaken by them") } else { None }
    }

    fn bytes(&self) -> usize {
        self.kept.iter().filter_map(|(_, arrived)| arrived.as_ref().ok()).map(|r| r.size_bytes()).sum()
    }
}

/// How far the newest study is that asked here.
#[derive(Default, Clone, Copy)]
pub(crate) struct StudyStatus {
    /// The step it is of.
    pub step: u64,
    /// True for a run's first study.
    pub first: bool,
    /// Trials begun.
    pub trials: u32,
    /// Quality of the best trial that keeps the contract so far, decibels.
    pub best_psnr_db: Option<f64>,
    /// Its encoded bytes.
    pub best_size_bytes: u64,
}

/// The trials kept, and what those measured came to.
#[derive(Default)]
pub(crate) struct ShownTrials {
    held: watch::Sender<Held>,
    measured: Mutex<VecDeque<(Frame, Quality)>>,
    study: Mutex<Option<StudyStatus>>,
}

impl ShownTrials {
    /// A subscription began (true) or ended.
    pub(crate) fn subscribed(&self, subscribed: bool) {
        self.held.send_modify(|held| {
            held.subscription += u64::from(subscribed);
            (held.subscribed, held.newest) = (subscribed, 0);
        });
    }

    /// Keeps what arrived as trial `trial_id`, or why it cannot be measured.
    pub(crate) fn keep(&self, trial_id: u64, arrived: Arrived) {
        self.held.send_modify(|held| {
            held.newest = held.newest.max(trial_id);
            held.kept.push_back((trial_id, arrived));
            while held.kept.len() > KEPT || (held.kept.len() > 1 && held.bytes() > KEPT_BYTES) {
                held.kept.pop_front();
            }
        });
    }

    /// The trial, waited for as long as it may come.
    pub(crate) async fn find(&self, trial_id: u64) -> Arrived {
        let mut held = self.held.subscribe();
        let subscription = held.borrow().subscription;
        let known = held.wait_for(|held| held.find(trial_id, subscription).is_some()).await;
        let known = known.map_err(|_| Status::unavailable("stopping"))?;
        known.find(trial_id, subscription).unwrap_or_else(|| Err(Status::internal("trials")))
    }

    fn measured(&self) -> MutexGuard<'_, VecDeque<(Frame, Quality)>> {
        self.measured.lock()
    }

    /// Remembers what some batches of a trial came to; with those before, if it was asked about again.
    pub(crate) fn remember(&self, frame: &Frame, quality: &Quality) {
        let mut measured = self.measured();
        if let Some((_, known)) = measured.iter_mut().find(|(f, _)| f.trial_id == frame.trial_id) {
            if known.extend(quality).is_err() {
                *known = quality.clone();
            }
            return;
        }
        measured.push_back((frame.clone(), quality.clone()));
        if measured.len() > MEASURED {
            measured.pop_front();
        }
    }

    /// The numbers of the trials of run `run_id` that were measured, the oldest first.
    pub(crate) fn rows(&self, run_id: &str) -> Vec<StepRow> {
        let measured = self.measured();
        let of_run = measured.iter().filter(|(frame, _)| frame.run_id == run_id);
        of_run.map(|(frame, quality)| StepRow::trial(frame, quality)).collect()
    }

    /// A study asks.
    pub(crate) fn set_study(&self, study: StudyStatus) {
        *self.study.lock() = Some(study);
    }

    /// A run began: the study before was of another.
    pub(crate) fn forget_study(&self) {
        *self.study.lock() = None;
    }

    /// How far the newest study is.
    pub(crate) fn study(&self) -> Option<StudyStatus> {
        *self.study.lock()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::ViewError;
    use tonic::Code;

    fn code(arrived: Arrived) -> Code {
        arrived.err().unwrap().code()
    }

    fn damaged() -> Arrived {
        Err(Status::data_loss("made up"))
    }

    #[tokio::test]
    async fn trials_are_waited_for_and_known_to_be_gone() {
        let trials = Arc::new(ShownTrials::default());
        assert_eq!(code(trials.find(1).await), Code::NotFound, "nothing can come without a subscription");
        trials.subscribed(true);
        let ask = |id| {
            let trials = trials.clone();
            tokio::spawn(async move { trials.find(id).await })
        };
        let asked = ask(1);
        tokio::task::yield_now().await;
        for trial_id in 1..=1 + KEPT as u64 {
            trials.keep(trial_id, damaged());
            tokio::task::yield_now().await;
        }
        assert_eq!(code(asked.await.unwrap()), Code::DataLoss);
        assert_eq!(code(trials.find(1).await), Code::NotFound, "made room");
        assert_eq!(code(trials.find(2).await), Code::DataLoss);
        // One that a later one overtakes, and one that was on its way when the connection was lost, are not waited for.
        let (overtaken, lost) = (ask(20), ask(30));
        tokio::task::yield_now().await;
        trials.keep(21, damaged());
        assert_eq!(code(overtaken.await.unwrap()), Code::NotFound);
        trials.subscribed(false);
        trials.subscribed(true);
        assert_eq!(code(lost.await.unwrap()), Code::NotFound);
        let again = ask(31);
        tokio::task::yield_now().await;
        trials.keep(31, damaged());
        assert_eq!(code(again.await.unwrap()), Code::DataLoss);
    }

    #[test]
    fn what_trials_came_to_is_remembered_by_run_and_batches_add_up() {
        let trials = ShownTrials::default();
        let quality =
            |mse: &[f64]| Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: mse.to_vec(), ssim: None }] };
        let frame =
            |trial_id, run_id: &str| Frame { trial_id: Some(trial_id), run_id: run_id.into(), ..Frame::default() };
        trials.remember(&frame(1, "a"), &quality(&[1e-4]));
        trials.remember(&frame(2, "b"), &quality(&[1e-3]));
        trials.remember(&frame(1, "a"), &quality(&[3e-4, 2e-4]));
        let decibels = |run: &str| trials.rows(run).iter().map(|r| r.psnr_db.unwrap().into()).collect::<Vec<f64>>();
        // The mean of three batches is 2e-4.
        assert!((decibels("a")[0] - 36.9897).abs() < 1e-4 && decibels("a").len() == 1, "{:?}", decibels("a"));
        assert!((decibels("b")[0] - 30.0).abs() < 1e-9);
        for id in 3..3 + MEASURED as u64 {
            trials.remember(&frame(id, "b"), &quality(&[1e-3]));
        }
        assert_eq!((trials.rows("a").len(), trials.rows("b").len()), (0, MEASURED));
    }
}
