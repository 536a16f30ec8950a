//! One stream to each viz-node that the generator-node lists, opened again when it is lost.

use super::connect;
use super::error::words;
use crate::evaluator::TrialError;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient, quality_client::QualityClient};
use std::collections::HashMap;
use std::convert::Infallible;
use std::time::Duration;
use tokio::task::{AbortHandle, JoinSet};
use tonic::Status;
use tonic::transport::Channel;

/// Pause before a viz-node that was lost is tried again.
const RETRY: Duration = Duration::from_secs(2);

/// What is done with each viz-node, and what is missed where it does not answer.
pub(crate) trait ViewerStream: Clone + Send + Sync + 'static {
    /// What the log says is not done without it.
    const MISSED: &'static str;

    /// Opens the stream to the viz-node at `address` and follows it until it is lost.
    fn follow(
        &self,
        client: QualityClient<Channel>,
        address: &str,
    ) -> impl Future<Output = Result<Infallible, TrialError>> + Send;
}

/// Follows all viz-nodes that the generator-node behind `control` lists, until its list ends.
pub(crate) async fn follow_all<S: ViewerStream>(
    control: ControlClient<Channel>,
    credentials: Option<Credentials>,
    stream: S,
) {
    if let Err(status) = follow_listed(control, credentials, stream).await {
        tracing::warn!("no list of viz-nodes: {}; {}", words(&status), S::MISSED);
    }
}

async fn follow_listed<S: ViewerStream>(
    mut control: ControlClient<Channel>,
    credentials: Option<Credentials>,
    stream: S,
) -> Result<(), Status> {
    let mut lists = control.viewers(v1::ViewersRequest {}).await?.into_inner();
    let mut tasks = JoinSet::new();
    let mut followed: HashMap<String, AbortHandle> = HashMap::new();
    while let Some(list) = lists.message().await? {
        let listed = |name: &String| list.viewers.iter().any(|v| v.viewer == *name);
        followed.extract_if(|name, _| !listed(name)).for_each(|(_, task)| task.abort());
        while tasks.try_join_next().is_some() {}
        for v1::Viewer { viewer, address } in list.viewers {
            followed
                .entry(viewer)
                .or_insert_with(|| tasks.spawn(follow_one(address, credentials.clone(), stream.clone())));
        }
    }
    Ok(())
}

/// As long as it is listed.
async fn follow_one<S: ViewerStream>(address: String, credentials: Option<Credentials>, stream: S) {
    let mut reported = String::new();
    loop {
        let Err(error) = until_lost(&address, credentials.as_ref(), &stream).await;
        // The same trouble twice is one line in the log.
        if error.to_string() != reported {
            reported = error.to_string();
            tracing::warn!("{reported}; {} there until it answers", S::MISSED);
        }
        tokio::time::sleep(RETRY).await;
    }
}

async fn until_lost<S: ViewerStream>(
    address: &str,
    credentials: Option<&Credentials>,
    stream: &S,
) -> Result<Infallible, TrialError> {
    let client = QualityClient::new(connect(address, Role::Viewer, credentials).await?);
    stream.follow(client, address).await
}

/// A viz-node's fault, for the log.
pub(crate) fn viewer_error(address: &str, reason: String) -> TrialError {
    TrialError::Node { node: format!("viz-node {address}"), reason }
}
