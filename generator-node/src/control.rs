//! The control service: parameters and trials in, numbers out.

use crate::node_state::NodeState;
use crate::trials::TrialSession;
use futures::{Stream, StreamExt, stream};
use lamina_model::Setting;
use lamina_rpc::invalid;
use lamina_rpc::v1::{self, control_server};
use std::pin::Pin;
use std::sync::Arc;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc;
use tokio_stream::wrappers::{ReceiverStream, WatchStream};
use tonic::{Request, Response, Status, Streaming};

/// The gRPC face of [`NodeState`].
pub(crate) struct ControlService(pub Arc<NodeState>);

type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl control_server::Control for ControlService {
    async fn set_parameters(
        &self,
        request: Request<v1::SetParametersRequest>,
    ) -> Result<Response<v1::SetParametersReply>, Status> {
        let request = request.into_inner();
        let from_step = request.from_step;
        let setting = Setting::try_from(request).map_err(|e| invalid(&e))?;
        let applies_from_step = match setting.params {
            None => self.0.limit(&setting),
            Some(_) => self.0.set(from_step, Setting { only_vdis: false, ..setting }),
        };
        tracing::info!(applies_from_step, "parameters set");
        Ok(Response::new(v1::SetParametersReply { applies_from_step }))
    }

    type WatchStream = Answers<v1::StepReport>;

    async fn watch(&self, _: Request<v1::WatchRequest>) -> Result<Response<Self::WatchStream>, Status> {
        let reports = self.0.reports.subscribe();
        let first = self.0.last_report();
        let newer = stream::unfold(reports, |mut reports| async move {
            loop {
                match reports.recv().await {
                    Ok(report) => return Some((report, reports)),
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => return None,
                }
            }
        });
        Ok(Response::new(stream::iter(first).chain(newer).map(|report| Ok(report.into())).boxed()))
    }

    type TrialsStream = Answers<v1::TrialReply>;

    async fn trials(
        &self,
        request: Request<Streaming<v1::TrialRequest>>,
    ) -> Result<Response<Self::TrialsStream>, Status> {
        let held = self.0.newest().ok_or_else(|| Status::failed_precondition("no step yet; trials need one"))?;
        let trials = TrialSession::new(self.0.clone(), held);
        let (answers, stream) = mpsc::channel(1);
        tokio::spawn(async move {
            if let Err(status) = trials.serve(request.into_inner(), &answers).await {
                let _ = answers.send(Err(status)).await;
            }
        });
        Ok(Response::new(ReceiverStream::new(stream).boxed()))
    }

    type ViewersStream = Answers<v1::ViewerList>;

    async fn viewers(&self, _: Request<v1::ViewersRequest>) -> Result<Response<Self::ViewersStream>, Status> {
        Ok(Response::new(WatchStream::new(self.0.publisher.viewers()).map(Ok).boxed()))
    }
}
