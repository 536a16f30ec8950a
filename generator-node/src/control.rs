//! The control service: parameters and trials in, numbers out.

use crate::cycle::{Prepared, Purpose, Shared};
use crate::schedule::Setting;
use futures::{Stream, StreamExt, stream};
use lamina_model::GenerationParams;
use lamina_wire::v1::{self, control_server};
use lamina_wire::{invalid, required};
use std::pin::Pin;
use std::sync::Arc;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status, Streaming};

/// The gRPC face of [`Shared`].
pub struct ControlService(pub Arc<Shared>);

type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl control_server::Control for ControlService {
    async fn set_parameters(
        &self,
        request: Request<v1::SetParametersRequest>,
    ) -> Result<Response<v1::SetParametersReply>, Status> {
        let request = request.into_inner();
        let setting = setting_from(&request).map_err(|e| invalid(&e))?;
        let applies_from_step = self.0.set(request.from_step, setting);
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
        Ok(Response::new(stream::iter(first).chain(newer).map(Ok).boxed()))
    }

    type TrialsStream = Answers<v1::TrialReply>;

    async fn trials(
        &self,
        request: Request<Streaming<v1::TrialRequest>>,
    ) -> Result<Response<Self::TrialsStream>, Status> {
        let held = self.0.newest().ok_or_else(|| Status::failed_precondition("no step yet; trials need one"))?;
        let shared = self.0.clone();
        let (answers, stream) = mpsc::channel(1);
        tokio::spawn(async move {
            if let Err(status) = serve_trials(&shared, &held, request.into_inner(), &answers).await {
                let _ = answers.send(Err(status)).await;
            }
        });
        Ok(Response::new(tokio_stream::wrappers::ReceiverStream::new(stream).boxed()))
    }
}

fn setting_from(request: &v1::SetParametersRequest) -> Result<Setting, lamina_model::Invalid> {
    Ok(Setting {
        params: required(request.params, "params")?.try_into()?,
        size_limit_bytes: request.size_limit_bytes,
        time_limit_ns: request.time_limit_ns,
        fallbacks: request.fallbacks.iter().map(|p| GenerationParams::try_from(*p)).collect::<Result<_, _>>()?,
    })
}

/// Measures trial after trial on the step held; the tuner's hanging up ends it.
async fn serve_trials(
    shared: &Arc<Shared>,
    held: &Arc<Prepared>,
    mut requests: Streaming<v1::TrialRequest>,
    answers: &mpsc::Sender<Result<v1::TrialReply, Status>>,
) -> Result<(), Status> {
    let mut first = true;
    while let Some(request) = requests.message().await? {
        if request.trial_id == 0 {
            return Err(Status::invalid_argument("trial_id: 0 means a live step; choose another number"));
        }
        let params: GenerationParams =
            required(request.params, "params").and_then(TryInto::try_into).map_err(|e| invalid(&e))?;
        let permit = shared.kernel.acquire().await.map_err(|_| Status::unavailable("stopping"))?;
        let (step, worker) = (held.clone(), shared.clone());
        let work = move || {
            let reference = if first { Some(step.reference(&worker.plan)?) } else { None };
            let (bytes, cost) = step.measure(&params, &worker.options)?;
            let frame = step.frame(&params, cost, bytes, Purpose::Trial(request.trial_id));
            worker.publisher.publish_trial(reference.into_iter().chain([frame]).collect());
            Ok::<_, lamina_model::Invalid>(cost)
        };
        let measured = tokio::task::spawn_blocking(work).await.map_err(|e| Status::internal(e.to_string()))?;
        drop(permit);
        first = false;
        let (cost, refusal) = match measured {
            Ok(cost) => (Some(cost), String::new()),
            Err(invalid) => (None, invalid.to_string()),
        };
        let reply = v1::TrialReply {
            trial_id: request.trial_id,
            run_id: held.run.run_id.clone(),
            step: held.step,
            cost,
            refusal,
        };
        if answers.send(Ok(reply)).await.is_err() {
            return Ok(());
        }
    }
    Ok(())
}
