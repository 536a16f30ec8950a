//! The contract between the people at the page and the tuner: they ask for another, it answers and says what it is doing.

use crate::store::{Event, Number, Store};
use futures::StreamExt;
use lamina_rpc::v1;
use parking_lot::Mutex;
use serde::Serialize;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};
use tonic::{Status, Streaming};

/// How long an answer is waited for: a tuner answers at once, also amid a study.
const PATIENCE: Duration = Duration::from_secs(5);
/// Requests that wait for a tuner's connection; further ones are refused.
const WAITING: usize = 16;

/// Why a contract asked for is not in force.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NegotiationError {
    /// Nobody tunes.
    #[error(
        "no tuner follows this viz-node; start one for the same generator-node, `tuner --generator http://HOST:7101`"
    )]
    NoTuner,
    /// The tuner does not take it.
    #[error("{0}")]
    Refused(String),
    /// It has not said so.
    #[error("the tuner has not answered for {PATIENCE:?}; its log says what it is doing")]
    Silent,
}

/// What the tuner says, for the page.
#[derive(Debug, Serialize)]
pub(crate) struct TunerSummary {
    /// The contract in force, as users write it.
    contract: String,
    /// A step is being dealt with.
    busy: bool,
    /// Studies that have measured something.
    studies: u64,
    /// What the trial of the parameters in use came to, decibels; none yet.
    chosen_psnr_db: Option<Number>,
    /// Why the last study failed; empty if it did not.
    last_error: String,
}

impl From<v1::TunerStatus> for TunerSummary {
    fn from(status: v1::TunerStatus) -> Self {
        let v1::TunerStatus { contract, busy, studies, chosen_psnr_db, last_error, .. } = status;
        Self { contract, busy, studies, chosen_psnr_db: chosen_psnr_db.map(Number::from), last_error }
    }
}

/// The tuner that connected last.
#[derive(Debug)]
struct Tuner {
    /// Tells its connection from others.
    connection: u64,
    requests: mpsc::Sender<v1::ContractRequest>,
    status: Option<v1::TunerStatus>,
}

#[derive(Debug, Default)]
struct NegotiationState {
    tuner: Option<Tuner>,
    waiting: HashMap<u64, oneshot::Sender<String>>,
    /// Numbers of connections and requests given so far.
    given: u64,
}

impl NegotiationState {
    fn number(&mut self) -> u64 {
        self.given += 1;
        self.given
    }
}

/// Between the page and the tuner.
#[derive(Debug)]
pub(crate) struct Negotiation {
    store: Arc<Store>,
    state: Mutex<NegotiationState>,
}

impl Negotiation {
    /// No tuner yet; pages are told through `store`.
    pub(crate) fn new(store: Arc<Store>) -> Self {
        Self { store, state: Mutex::default() }
    }

    /// What the tuner says; `None` where there is none.
    pub(crate) fn tuner(&self) -> Option<TunerSummary> {
        self.state.lock().tuner.as_ref()?.status.clone().map(TunerSummary::from)
    }

    /// Asks the tuner for `contract`, which is in force when this returns.
    ///
    /// # Errors
    /// If there is no tuner, or it refuses.
    pub(crate) async fn ask(&self, contract: String, asked_by: String) -> Result<(), NegotiationError> {
        let (request_id, answer) = {
            let mut state = self.state.lock();
            let request_id = state.number();
            let Some(tuner) = &state.tuner else { return Err(NegotiationError::NoTuner) };
            let request = v1::ContractRequest { request_id, contract, asked_by };
            tuner.requests.try_send(request).map_err(|_| NegotiationError::Silent)?;
            let (sender, answer) = oneshot::channel();
            state.waiting.insert(request_id, sender);
            (request_id, answer)
        };
        let answered = tokio::time::timeout(PATIENCE, answer).await;
        self.state.lock().waiting.remove(&request_id);
        match answered {
            Ok(Ok(refusal)) if refusal.is_empty() => Ok(()),
            Ok(Ok(refusal)) => Err(NegotiationError::Refused(refusal)),
            _ => Err(NegotiationError::Silent),
        }
    }

    /// Listens to a tuner, in place of one before, until its stream ends; what it is asked for comes out.
    pub(crate) fn listen(
        self: &Arc<Self>,
        mut updates: Streaming<v1::TunerUpdate>,
    ) -> impl futures::Stream<Item = Result<v1::ContractRequest, Status>> + Send + use<> {
        let (requests, asked) = mpsc::channel(WAITING);
        let connection = {
            let mut state = self.state.lock();
            let connection = state.number();
            state.tuner = Some(Tuner { connection, requests, status: None });
            connection
        };
        let own = self.clone();
        tokio::spawn(async move {
            while let Ok(Some(update)) = updates.message().await {
                own.take(connection, update);
            }
            own.forget(connection);
        });
        tokio_stream::wrappers::ReceiverStream::new(asked).map(Ok)
    }

    fn take(&self, connection: u64, update: v1::TunerUpdate) {
        let v1::TunerUpdate { status, request_id, refusal } = update;
        let mut state = self.state.lock();
        let Some(tuner) = state.tuner.as_mut().filter(|tuner| tuner.connection == connection) else { return };
        tuner.status = status.or(tuner.status.take());
        if let Some(waiting) = state.waiting.remove(&request_id) {
            // Who asked may have gone.
            let _ = waiting.send(refusal);
        }
        drop(state);
        self.store.announce(Event::Tuner);
    }

    fn forget(&self, connection: u64) {
        let mut state = self.state.lock();
        if state.tuner.as_ref().is_some_and(|tuner| tuner.connection == connection) {
            state.tuner = None;
            state.waiting.clear();
        }
        drop(state);
        self.store.announce(Event::Tuner);
    }
}
