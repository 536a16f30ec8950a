//! Contracts that people at viz-nodes ask for, and what those are told of the tuner.

use super::error::words;
use super::viewer_streams::{ViewerStream, viewer_error};
use crate::config::keepable_live;
use crate::evaluator::TrialError;
use crate::status::Status;
use crate::{Config, Contract};
use lamina_model::Invalid;
use lamina_rpc::v1::{self, quality_client::QualityClient};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;

/// What changed within so long is told at once.
const INTERVAL: Duration = Duration::from_millis(100);
/// Updates that wait for a viz-node's connection.
const WAITING: usize = 4;

/// The stream to one viz-node.
#[derive(Clone)]
pub(crate) struct Negotiator {
    pub status: Arc<Status>,
    /// The contract that was asked for last.
    pub wanted: watch::Sender<Contract>,
}

impl Negotiator {
    /// Takes a contract asked for.
    fn take(&self, request: &v1::ContractRequest) -> Result<(), Invalid> {
        let contract: Contract = request.contract.parse()?;
        keepable_live(&contract)?;
        self.want(contract, &request.asked_by);
        Ok(())
    }

    fn want(&self, contract: Contract, asked_by: &str) {
        tracing::info!(%contract, asked_by, "another contract is asked for");
        self.status.contract(&contract);
        self.wanted.send_replace(contract);
    }

    /// Takes the contract of the configuration whenever that states another.
    pub(crate) async fn follow_configuration(self, mut settings: watch::Receiver<Config>) {
        let mut stated = settings.borrow_and_update().contract.clone();
        while settings.changed().await.is_ok() {
            let contract = settings.borrow_and_update().contract.clone();
            if contract != stated {
                self.want(contract.clone(), "configuration");
                stated = contract;
            }
        }
    }
}

impl ViewerStream for Negotiator {
    const MISSED: &'static str = "nobody can ask for another contract";

    async fn follow(&self, mut client: QualityClient<Channel>, address: &str) -> Result<Infallible, TrialError> {
        let failed = |reason: String| viewer_error(address, reason);
        let (updates, stream) = mpsc::channel(WAITING);
        let mut changes = self.status.changes();
        changes.mark_changed();
        let requests = client.negotiate(ReceiverStream::new(stream)).await.map_err(|s| failed(words(&s)))?;
        let mut requests = requests.into_inner();
        loop {
            let answer = tokio::select! {
                Ok(()) = changes.changed() => {
                    tokio::time::sleep(INTERVAL).await;
                    changes.mark_unchanged();
                    v1::TunerUpdate::default()
                }
                request = requests.message() => match request.map_err(|s| failed(words(&s)))? {
                    Some(request) => {
                        let refusal = self.take(&request).err().map(|e| e.to_string()).unwrap_or_default();
                        v1::TunerUpdate { request_id: request.request_id, refusal, ..Default::default() }
                    }
                    None => return Err(failed("ended the stream of contracts".to_owned())),
                },
            };
            let update = v1::TunerUpdate { status: Some(self.status.summary()), ..answer };
            updates.send(update).await.map_err(|_| failed("takes no more updates".to_owned()))?;
        }
    }
}
