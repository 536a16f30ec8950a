//! The viz-nodes that measure: those the generator-node lists, but for those that failed during this study.

use super::error::{node_error, words};
use crate::evaluator::TrialError;
use futures::FutureExt;
use futures::future::BoxFuture;
use lamina_model::Quality;
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient, quality_client::QualityClient};
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OnceCell;
use tokio::time::{Instant, timeout, timeout_at};
use tonic::transport::Channel;
use tonic::{Code, Status, Streaming};

/// How long a viz-node is waited for where there is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long one is waited for whose connection was lost while the generator-node still lists it.
const LOST_PATIENCE: Duration = Duration::from_secs(60);
/// A viz-node that is at work says so every second; one that says nothing for so long makes no progress.
const SILENCE: Duration = Duration::from_secs(5);

/// A viz-node that measures.
#[derive(Debug)]
pub(super) struct Viewer {
    /// Its name at the generator-node.
    pub name: String,
    /// Where its Quality service is.
    pub address: String,
    /// Trials it was given in this study.
    pub given: u64,
    /// It made no progress with the last one: others come first.
    pub stalled: bool,
    client: Arc<OnceCell<QualityClient<Channel>>>,
    credentials: Option<Credentials>,
}

/// Why there is no measurement.
pub(super) enum Fault {
    /// It does not have the VDI (any more).
    Missing(String),
    /// This VDI cannot be measured.
    Refused(String),
    /// It makes no progress.
    Stalled(String),
    /// Its connection was lost.
    Lost(String),
    /// The viz-node cannot be trusted with another.
    Failed(String),
}

/// Those present.
#[derive(Debug)]
pub(super) struct Viewers {
    generator: String,
    credentials: Option<Credentials>,
    list: Streaming<v1::ViewerList>,
    present: Vec<Viewer>,
    /// Addresses of those that failed.
    left_out: Vec<String>,
    /// Names of those whose connection was lost: they come back under others.
    lost: Vec<String>,
    last_failure: Option<TrialError>,
    /// Until when one that went without failing may come back.
    hope: Option<Instant>,
}

impl Viewers {
    /// Follows the generator-node's list.
    ///
    /// # Errors
    /// If it does not answer, or lists nobody for some seconds.
    pub(super) async fn open(
        control: &ControlClient<Channel>,
        generator: &str,
        credentials: Option<Credentials>,
    ) -> Result<Self, TrialError> {
        let failed = |status: Status| node_error("generator-node", generator, &words(&status));
        let list = control.clone().viewers(v1::ViewersRequest {}).await.map_err(failed)?.into_inner();
        let generator = generator.to_owned();
        let (present, left_out, lost) = (Vec::new(), Vec::new(), Vec::new());
        let mut viewers =
            Self { generator, credentials, list, present, left_out, lost, last_failure: None, hope: None };
        let deadline = Instant::now() + PATIENCE;
        while viewers.present.is_empty() {
            match timeout_at(deadline, viewers.changed()).await {
                Ok(changed) => changed?,
                Err(_) => return Err(viewers.none_left()),
            }
        }
        Ok(viewers)
    }

    /// The next list from the generator-node. Nothing is lost if the wait is given up.
    ///
    /// # Errors
    /// If that one does not answer any more.
    pub(super) async fn changed(&mut self) -> Result<(), TrialError> {
        let list = self
            .list
            .message()
            .await
            .map_err(|status| node_error("generator-node", &self.generator, &words(&status)))?;
        self.update(list.ok_or_else(|| {
            node_error("generator-node", &self.generator, "ended the list of viz-nodes; its log says why")
        })?);
        Ok(())
    }

    /// Takes in all lists that have come.
    ///
    /// # Errors
    /// As [`Self::changed`].
    pub(super) fn catch_up(&mut self) -> Result<(), TrialError> {
        while let Some(changed) = self.changed().now_or_never() {
            changed?;
        }
        Ok(())
    }

    fn update(&mut self, list: v1::ViewerList) {
        let gone = |v: &Viewer| !list.viewers.iter().any(|listed| listed.viewer == v.name);
        for name in self.present.iter().filter(|v| gone(v)).map(|v| v.name.clone()).collect::<Vec<_>>() {
            self.gone(&name);
        }
        // One that is not listed either was not only cut off.
        if list.viewers.is_empty() {
            self.hope = self.hope.map(|until| until.min(Instant::now() + PATIENCE));
        }
        for v1::Viewer { viewer: name, address } in list.viewers {
            if !self.left_out.contains(&address) && !self.lost.contains(&name) && self.get(&name).is_none() {
                self.present.push(Viewer {
                    name,
                    address,
                    given: 0,
                    stalled: false,
                    client: Arc::default(),
                    credentials: self.credentials.clone(),
                });
            }
        }
    }

    /// The viewer of this name, if it is present.
    pub(super) fn get(&mut self, name: &str) -> Option<&mut Viewer> {
        self.present.iter_mut().find(|v| v.name == name)
    }

    /// All of them.
    pub(super) fn present(&self) -> &[Viewer] {
        &self.present
    }

    /// Its subscription has ended: it may come back under another name.
    pub(super) fn gone(&mut self, name: &str) {
        self.remove(name, "is no longer subscribed to the generator-node");
        self.hope = Some(Instant::now() + PATIENCE);
    }

    /// Its connection was lost: it may come back under another name, once the generator-node has noticed, too.
    pub(super) fn lost(&mut self, name: &str, reason: &str) {
        self.remove(name, reason);
        self.lost.push(name.to_owned());
        self.hope = Some(Instant::now() + LOST_PATIENCE);
    }

    /// It made no progress with a trial.
    pub(super) fn stalled(&mut self, name: &str, reason: &str) {
        let Some(viewer) = self.present.iter_mut().find(|v| v.name == name) else { return };
        if !std::mem::replace(&mut viewer.stalled, true) {
            tracing::warn!("viz-node {} {reason}; its trials go to others, if there are any", viewer.address);
        }
    }

    /// It failed, and is asked no more in this study.
    pub(super) fn leave_out(&mut self, address: &str, reason: &str) {
        if !self.left_out.iter().any(|a| a == address) {
            self.left_out.push(address.to_owned());
            tracing::warn!("viz-node {address} is left out of this study: {reason}");
        }
        self.present.retain(|v| v.address != address);
        self.last_failure = Some(node_error("viz-node", address, reason));
        self.hope = None;
    }

    fn remove(&mut self, name: &str, reason: &str) {
        let Some(n) = self.present.iter().position(|v| v.name == name) else { return };
        let address = self.present.remove(n).address;
        tracing::warn!("viz-node {address} {reason}; its trials go to the others");
        self.last_failure = Some(node_error("viz-node", &address, reason));
    }

    /// Until when it is worth waiting for somebody while nobody is present.
    pub(super) fn hope(&self) -> Option<Instant> {
        self.hope.filter(|&until| until > Instant::now())
    }

    /// The error for a study that nobody can measure for.
    pub(super) fn none_left(&self) -> TrialError {
        let remedy = "start a viz-node for it, and give it a quality_address that it can be reached at from elsewhere";
        match &self.last_failure {
            Some(TrialError::Node { node, reason }) => TrialError::Node {
                node: node.clone(),
                reason: format!("{reason}; no viz-node is left to measure quality: see to it, or {remedy}"),
            },
            _ => node_error(
                "generator-node",
                &self.generator,
                &format!("no viz-node that measures quality subscribes to it; {remedy}"),
            ),
        }
    }
}

impl Viewer {
    /// Measures some batches of a trial that was sent there.
    pub(super) fn measure(
        &self,
        trial_id: u64,
        batches: Range<u32>,
        study: v1::StudyProgress,
    ) -> BoxFuture<'static, Result<Quality, Fault>> {
        let (client, address, credentials) = (self.client.clone(), self.address.clone(), self.credentials.clone());
        let silent = |_| Fault::Stalled(format!("said nothing of a trial for {SILENCE:?}"));
        async move {
            let connect =
                || async { connect(&address, Role::Viewer, credentials.as_ref()).await.map(QualityClient::new) };
            let connected = client.get_or_try_init(connect).await;
            let unreachable = |reason| {
                Fault::Failed(format!("{reason}; set quality_address in its configuration to where others reach it"))
            };
            let (first_batch, asked) = (batches.start, batches.end - batches.start);
            let request = v1::QualityRequest { trial_id, first_batch, batches: asked, study: Some(study) };
            let mut client = connected.map_err(unreachable)?.clone();
            let replies = timeout(SILENCE, client.measure(request)).await.map_err(silent)?.map_err(fault)?;
            let mut replies = replies.into_inner();
            let reply = loop {
                let reply = timeout(SILENCE, replies.message()).await.map_err(silent)?.map_err(fault)?;
                match reply {
                    None => return Err(Fault::Failed("ended its answer without a measurement".to_owned())),
                    Some(reply) if reply.trial_id != trial_id => {
                        let other = reply.trial_id;
                        return Err(Fault::Failed(format!("answered trial {other} instead of {trial_id}")));
                    }
                    Some(reply) if !reply.views.is_empty() => break reply,
                    Some(_) => {}
                }
            };
            let quality = Quality::try_from(reply).map_err(|e| Fault::Failed(format!("measured {e}")))?;
            match quality.batches() {
                n if n == asked as usize => Ok(quality),
                n => Err(Fault::Failed(format!("measured {n} batches of {asked} asked for"))),
            }
        }
        .boxed()
    }
}

fn fault(status: Status) -> Fault {
    match status.code() {
        Code::NotFound => Fault::Missing(words(&status)),
        Code::InvalidArgument => Fault::Refused(words(&status)),
        Code::Unavailable | Code::Unknown | Code::Cancelled => Fault::Lost(words(&status)),
        _ => Fault::Failed(words(&status)),
    }
}
