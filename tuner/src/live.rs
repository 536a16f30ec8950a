//! The quality of live steps, as viz-nodes measure it.

use crate::evaluator::TrialError;
use crate::remote::{connect, words};
use lamina_model::StepReport;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient, quality_client::QualityClient};
use std::collections::HashMap;
use std::convert::Infallible;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::{AbortHandle, JoinSet};
use tonic::Status;
use tonic::transport::Channel;

/// How long a step's quality is waited for: drawing some thousand pixels takes a fraction of it.
const PATIENCE: Duration = Duration::from_secs(2);
/// Pause before a viz-node that was lost is tried again.
const RETRY: Duration = Duration::from_secs(2);

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
        let (control, credentials, mut following) = (control.clone(), credentials.clone(), JoinSet::new());
        following.spawn(async move {
            if let Err(status) = follow_all(control, credentials, sender).await {
                tracing::warn!("no list of viz-nodes: {}; the limit on quality is not watched", words(&status));
            }
        });
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

async fn follow_all(
    mut control: ControlClient<Channel>,
    credentials: Option<Credentials>,
    told: watch::Sender<Told>,
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
                .or_insert_with(|| tasks.spawn(follow_one(address, credentials.clone(), told.clone())));
        }
    }
    Ok(())
}

/// As long as it is listed.
async fn follow_one(address: String, credentials: Option<Credentials>, told: watch::Sender<Told>) {
    let mut reported = String::new();
    loop {
        let Err(error) = until_lost(&address, credentials.as_ref(), &told).await;
        // The same trouble twice is one line in the log.
        if error.to_string() != reported {
            reported = error.to_string();
            tracing::warn!("{reported}; the limit on quality is not watched there until it answers");
        }
        tokio::time::sleep(RETRY).await;
    }
}

async fn until_lost(
    address: &str,
    credentials: Option<&Credentials>,
    told: &watch::Sender<Told>,
) -> Result<Infallible, TrialError> {
    let failed = |reason: String| TrialError::Node { node: format!("viz-node {address}"), reason };
    let mut client = QualityClient::new(connect(address, Role::Viewer, credentials).await?);
    let steps = client.steps(v1::StepsRequest {}).await.map_err(|s| failed(words(&s)))?;
    let mut steps = steps.into_inner();
    let _open = OpenStream::new(told);
    while let Some(quality) = steps.message().await.map_err(|s| failed(words(&s)))? {
        // NaN would keep every limit.
        if quality.psnr_db.is_nan() || quality.half_width_db.is_nan() {
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
