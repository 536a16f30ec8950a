//! The quality of live steps, as viz-nodes measure it.

use crate::evaluator::TrialError;
use crate::remote::viewer_streams::{ViewerStream, follow_all, viewer_error};
use crate::remote::words;
use lamina_model::StepReport;
use lamina_rpc::credentials::Credentials;
use lamina_rpc::v1::{self, control_client::ControlClient, quality_client::QualityClient};
use std::convert::Infallible;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tonic::transport::Channel;

/// How long a step's quality is waited for: drawing some thousand pixels takes a fraction of it.
const PATIENCE: Duration = Duration::from_secs(2);
/// What viz-nodes tell.
#[derive(Default)]
struct Told {
    newest: Option<v1::StepQuality>,
    /// How many are listened to.
    streams: usize,
}

/// Follows all viz-nodes that measure, as long as it lives.
pub(crate) struct LiveQuality {
    told: watch::Receiver<Told>,
    _following: JoinSet<()>,
}

impl LiveQuality {
    /// Of the steps of the generator-node behind `control`.
    pub(crate) fn follow(control: &ControlClient<Channel>, credentials: &Option<Credentials>) -> Self {
        let (sender, told) = watch::channel(Told::default());
        let mut following = JoinSet::new();
        following.spawn(follow_all(control.clone(), credentials.clone(), LiveSteps { told: sender }));
        Self { told, _following: following }
    }

    /// The quality of the step reported, waited for as long as somebody may tell; if there is none to come, or it does not in
    /// time, that of the newest step that has one. None where that was not measured for want of processor time.
    pub(crate) async fn of(&mut self, report: &StepReport) -> Option<v1::StepQuality> {
        let told_of_run = |told: &Told| told.newest.clone().filter(|q| q.run_id == report.run_id);
        let of_run = |told: &Told| told_of_run(told).filter(|q| !q.skipped);
        let none_to_come = |told: &Told| told.streams == 0 || !report.has_reference;
        let come = |told: &Told| none_to_come(told) || told_of_run(told).is_some_and(|q| q.step >= report.step);
        if let Ok(Ok(told)) = tokio::time::timeout(PATIENCE, self.told.wait_for(|told| come(told))).await {
            return of_run(&told);
        }
        of_run(&self.told.borrow())
    }
}

/// The stream of one viz-node's qualities.
#[derive(Clone)]
struct LiveSteps {
    told: watch::Sender<Told>,
}

impl ViewerStream for LiveSteps {
    const MISSED: &'static str = "the limit on quality is not watched";

    async fn follow(&self, mut client: QualityClient<Channel>, address: &str) -> Result<Infallible, TrialError> {
        let failed = |reason: String| viewer_error(address, reason);
        let told = &self.told;
        let steps = client.steps(v1::StepsRequest {}).await.map_err(|s| failed(words(&s)))?;
        let mut steps = steps.into_inner();
        let _open = OpenStream::new(told);
        while let Some(quality) = steps.message().await.map_err(|s| failed(words(&s)))? {
            // NaN would keep every limit.
            if quality.psnr_db.is_nan() || quality.half_width_db.is_nan() || quality.ssim.is_some_and(f64::is_nan) {
                return Err(failed(format!("measured NaN of step {}", quality.step)));
            }
            // Another viz-node may be further.
            told.send_if_modified(|told| {
                let newer = told.newest.as_ref().is_none_or(|k| k.run_id != quality.run_id || k.step <= quality.step);
                if newer {
                    told.newest = Some(quality);
                }
                newer
            });
        }
        Err(failed("ended the stream of qualities".to_owned()))
    }
}

/// A stream that is listened to, for as long as this lives.
struct OpenStream<'a>(&'a watch::Sender<Told>);

impl<'a> OpenStream<'a> {
    fn new(told: &'a watch::Sender<Told>) -> Self {
        told.send_modify(|told| told.streams += 1);
        Self(told)
    }
}

impl Drop for OpenStream<'_> {
    fn drop(&mut self) {
        self.0.send_modify(|told| told.streams -= 1);
    }
}
