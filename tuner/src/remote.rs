//! Trials over gRPC: the generator-node gives sigma and tau, the viz-node q, both keyed by the trial's id.

use crate::trial::{Measured, Trial, TrialError};
use lamina_model::{GenerationParams, Indicators, Invalid, Quality};
use lamina_wire::v1::{self, control_client::ControlClient, quality_client::QualityClient};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;
use tonic::{Code, Status, Streaming};

/// How long one node may take for one trial.
const TRIAL_DEADLINE: Duration = Duration::from_secs(120);

/// A stream of trials on one step, which the generator-node holds as long as this lives.
pub struct Remote {
    requests: mpsc::Sender<v1::TrialRequest>,
    replies: Streaming<v1::TrialReply>,
    quality: QualityClient<Channel>,
    generator: String,
    viz: String,
    step: u64,
}

fn node_error(node: &str) -> impl Fn(Status) -> TrialError {
    move |status| TrialError::Node { node: node.to_owned(), reason: status.message().to_owned() }
}

/// A connection to the node at `address`.
pub async fn connect(address: &str) -> Result<Channel, TrialError> {
    let failed = |reason| TrialError::Node { node: address.to_owned(), reason };
    lamina_wire::node::connect(address).await.map_err(failed)
}

impl Remote {
    /// Opens a stream of trials on the newest step.
    ///
    /// # Errors
    /// If a node is not reachable or has no step yet.
    pub async fn open(control: &ControlClient<Channel>, generator: &str, viz: &str) -> Result<Self, TrialError> {
        let quality = QualityClient::new(connect(viz).await?);
        let (requests, stream) = mpsc::channel(1);
        let replies =
            control.clone().trials(ReceiverStream::new(stream)).await.map_err(node_error(generator))?.into_inner();
        Ok(Self { requests, replies, quality, generator: generator.to_owned(), viz: viz.to_owned(), step: 0 })
    }

    async fn exchange(&mut self, params: &GenerationParams, trial_id: u64) -> Result<(v1::Cost, Quality), Status> {
        let request = v1::TrialRequest { trial_id, params: Some(params.into()) };
        self.requests.send(request).await.map_err(|_| Status::unavailable("the stream of trials ended"))?;
        let reply = self.replies.message().await?.ok_or_else(|| Status::unavailable("the stream of trials ended"))?;
        self.step = reply.step;
        let cost = reply
            .cost
            .filter(|_| reply.trial_id == trial_id)
            .ok_or_else(|| Status::internal("not this trial's reply"))?;
        let quality = self
            .quality
            .measure(v1::QualityRequest { trial_id })
            .await
            .map_err(|status| Status::new(status.code(), format!("viz-node {}: {}", self.viz, status.message())))?;
        let quality = Quality::try_from(quality.into_inner()).map_err(|e| lamina_wire::invalid(&e))?;
        Ok((cost, quality))
    }
}

impl Trial for Remote {
    fn step(&self) -> u64 {
        self.step
    }

    async fn measure(&mut self, params: &GenerationParams) -> Result<Measured, TrialError> {
        let trial_id = fresh_trial_id();
        let answer = tokio::time::timeout(TRIAL_DEADLINE, self.exchange(params, trial_id)).await;
        let late = |_| Err(Status::deadline_exceeded(format!("no answer within {TRIAL_DEADLINE:?}")));
        let (cost, quality) = answer.unwrap_or_else(late).map_err(|status| match status.code() {
            Code::InvalidArgument => Invalid::new("candidate", status.message()).into(),
            _ => node_error(&self.generator)(status),
        })?;
        Ok(Measured {
            indicators: Indicators {
                size_bytes: cost.size_bytes,
                psnr_db: quality.psnr_db,
                generation_time: cost.generation_time(),
            },
            encode_time: cost.encode_time(),
            supersegments: cost.supersegments,
        })
    }
}

/// Unique over restarts of this tuner: starts at the clock's microseconds.
fn fresh_trial_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |d| d.as_micros() as u64);
    let _ = NEXT.compare_exchange(0, now.max(1), Ordering::Relaxed, Ordering::Relaxed);
    NEXT.fetch_add(1, Ordering::Relaxed)
}
