//! The Quality service, towards the tuner: trials measured, and the quality of live steps.

use crate::intake::Intake;
use crate::negotiation::Negotiation;
use crate::store::{Event, QualityStatus, StepRow};
use crate::trials::StudyStatus;
use futures::{Stream, StreamExt};
use lamina_compute::{Activity, Laps, Priority};
use lamina_model::Quality;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace, with_heartbeat};
use lamina_rpc::v1::{self, quality_server};
use lamina_vdi_render::Detail;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

/// The gRPC face of [`Intake`] and [`Negotiation`].
pub(crate) struct QualityService {
    pub intake: Arc<Intake>,
    pub negotiation: Arc<Negotiation>,
}

type Replies<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl quality_server::Quality for QualityService {
    type MeasureStream = Replies<v1::QualityReply>;

    async fn measure(&self, request: Request<v1::QualityRequest>) -> Result<Response<Self::MeasureStream>, Status> {
        let (replies, stream) = mpsc::channel(4);
        let request = request.into_inner();
        let trial_id = request.trial_id;
        let work = measure(self.intake.clone(), request);
        tokio::spawn(async move {
            let at_work = v1::QualityReply { trial_id, ..Default::default() };
            // Whoever hangs up wants no answer any more: work that waits is given up.
            if let Some(measured) = with_heartbeat(work, at_work, &replies).await {
                let _ = replies.send(measured.map(|quality| v1::QualityReply::new(trial_id, &quality))).await;
            }
        });
        Ok(Response::new(ReceiverStream::new(stream).boxed()))
    }

    type StepsStream = Replies<v1::StepQuality>;

    async fn steps(&self, _: Request<v1::StepsRequest>) -> Result<Response<Self::StepsStream>, Status> {
        let measured = self.intake.store.events().filter_map(|event| {
            let quality = match event {
                Event::Step(run_id, row) => step_quality(run_id, &row),
                _ => None,
            };
            std::future::ready(quality.map(Ok))
        });
        Ok(Response::new(measured.boxed()))
    }

    type NegotiateStream = Replies<v1::ContractRequest>;

    async fn negotiate(
        &self,
        request: Request<Streaming<v1::TunerUpdate>>,
    ) -> Result<Response<Self::NegotiateStream>, Status> {
        Ok(Response::new(self.negotiation.listen(request.into_inner()).boxed()))
    }
}

/// What is said of a live step once it is known whether its quality is measured.
pub(crate) fn step_quality(run_id: String, row: &StepRow) -> Option<v1::StepQuality> {
    let step = row.step;
    match row.measured {
        QualityStatus::Yes => row.psnr_db.map(|psnr_db| v1::StepQuality {
            run_id,
            step,
            psnr_db: psnr_db.into(),
            half_width_db: row.half_width_db.unwrap_or_default(),
            skipped: false,
            ssim: row.ssim,
            limit_kept: row.limit_kept,
        }),
        QualityStatus::Skipped => Some(v1::StepQuality { run_id, step, skipped: true, ..Default::default() }),
        _ => None,
    }
}

async fn measure(intake: Arc<Intake>, request: v1::QualityRequest) -> Result<Quality, Status> {
    let v1::QualityRequest { trial_id, first_batch, batches, study } = request;
    let mut timeline = Timeline::begin();
    let trial = intake.trials.find(trial_id).await?;
    let study = study.unwrap_or_default();
    let priority = Priority::of_trial(study.is_urgent());
    let v1::StudyProgress { first, trials, best_psnr_db, best_size_bytes } = study;
    intake.trials.set_study(StudyStatus { step: trial.frame.step, first, trials, best_psnr_db, best_size_bytes });
    let end = if batches == 0 { trial.reference.plan.batches } else { first_batch.saturating_add(batches) };
    let (backend, of) = (intake.backend.clone(), trial.clone());
    let work = move |laps: &mut Laps| {
        let shown = of.shown().map_err(|e| Status::invalid_argument(e.to_string()))?;
        laps.lap(Activity::Decode);
        let quality = backend.quality(shown, &of.reference, first_batch..end, Detail::Cubic);
        quality.map_err(|e| lamina_rpc::invalid(&e))
    };
    let permit = intake.share.acquire(priority).await;
    timeline.lap("wait", []);
    let quality = permit.run(Activity::Measure, work).await.map_err(|e| Status::internal(e.to_string()))??;
    timeline.lap("decode and measure", [("lamina.psnr_db", quality.psnr_db().into())]);
    timeline.send(Trace::of_trial(Role::Viewer, trial_id));
    intake.trials.remember(&trial.frame, &quality);
    intake.store.announce(Event::Trial);
    intake.counters.trials.fetch_add(1, Ordering::Relaxed);
    Ok(quality)
}
