//! The loop: watch steps, study when one calls for it, push the winner.

use crate::push::{decide, push};
use crate::remote::{Remote, connect};
use crate::trial::TrialError;
use crate::tune::tune;
use crate::{Config, status::Status};
use lamina_model::GenerationParams;
use lamina_wire::v1::{self, control_client::ControlClient};
use std::sync::Arc;
use std::time::Duration;
use tonic::Streaming;
use tonic::transport::Channel;

/// Pause before a lost generator-node is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// What the loop remembers between steps.
struct Daemon {
    config: Config,
    candidates: Vec<GenerationParams>,
    status: Arc<Status>,
    run_id: String,
    studied_step: Option<u64>,
    setting: Option<v1::SetParametersRequest>,
    /// First step the setting holds for: earlier ones do not speak against it.
    holds_from: u64,
    /// The last study found something that keeps the limit.
    feasible: bool,
}

/// Tunes for ever.
pub async fn run(config: Config, candidates: Vec<GenerationParams>, status: Arc<Status>) {
    let mut daemon = Daemon {
        config,
        candidates,
        status,
        run_id: String::new(),
        studied_step: None,
        setting: None,
        holds_from: 0,
        feasible: true,
    };
    let mut reported = String::new();
    loop {
        if let Err(error) = daemon.follow().await {
            let text = error.to_string();
            // The same trouble twice is one line in the log.
            if text != reported {
                tracing::warn!("{text}; trying again");
                reported = text;
            }
        } else {
            reported.clear();
        }
        tokio::time::sleep(RETRY).await;
    }
}

impl Daemon {
    /// One connection to the generator-node, until it ends.
    async fn follow(&mut self) -> Result<(), TrialError> {
        let generator = self.config.generator.clone();
        let control = ControlClient::new(connect(&generator).await?);
        let failed = |s: tonic::Status| TrialError::Node { node: generator.clone(), reason: s.message().to_owned() };
        let mut reports = control.clone().watch(v1::WatchRequest {}).await.map_err(failed)?.into_inner();
        tracing::info!(generator, "watching");
        // A restarted generator-node has forgotten its parameters.
        if let Some(setting) = self.setting.clone() {
            push(&control, setting).await?;
        }
        while let Some(report) = newest(&mut reports).await.map_err(failed)? {
            self.status.working(true);
            if self.calls_for_study(&report) {
                let outcome = self.study(&control, &report).await;
                self.status.failed(outcome.as_ref().err());
                if let Err(error) = outcome {
                    tracing::warn!("study of step {} gave nothing: {error}", report.step);
                }
            }
            self.status.seen(report.step);
        }
        Ok(())
    }

    fn calls_for_study(&mut self, report: &v1::StepReport) -> bool {
        if report.run_id != self.run_id {
            self.run_id.clone_from(&report.run_id);
            self.studied_step = None;
            self.holds_from = 0;
        }
        let Some(studied) = self.studied_step else { return true };
        let due = self.config.retune_every > 0 && report.step >= studied + self.config.retune_every;
        let cost = report.cost.unwrap_or_default();
        let kept = self.config.utility.keeps_limit(cost.size_bytes, cost.generation_time());
        // Parameters other than those pushed mean that the generator-node had to fall back to keep the size limit.
        let fell_back =
            self.setting.as_ref().is_some_and(|s| s.fallbacks.iter().any(|f| report.params.as_ref() == Some(f)));
        // Where nothing keeps the limit, every step breaks it; asking again each time would find the same.
        due || (report.step >= self.holds_from && self.feasible && (!kept || fell_back))
    }

    async fn study(&mut self, control: &ControlClient<Channel>, report: &v1::StepReport) -> Result<(), TrialError> {
        let mut remote = Remote::open(control, &self.config.generator).await?;
        let study = tune(&mut remote, &self.config.utility, &self.candidates, |row| self.status.tried(row)).await?;
        self.studied_step = Some(study.step.max(report.step));
        let Some((chosen, setting)) = decide(&study, &self.config.utility) else { return Ok(()) };
        let row = &study.rows[chosen];
        if study.best.is_none() {
            tracing::warn!(step = study.step, "no candidate keeps the limit; using what comes nearest");
        }
        let from = push(control, setting.clone()).await?;
        tracing::info!(
            step = study.step,
            resolution = row.params.resolution(),
            gamma = row.params.gamma(),
            bytes = row.measured.indicators().size_bytes,
            psnr_db = row.measured.indicators().psnr_db,
            from,
            "tuned"
        );
        (self.setting, self.holds_from, self.feasible) = (Some(setting), from, study.best.is_some());
        self.status.finished(&study, chosen);
        Ok(())
    }
}

/// The next report, or the newest of those that came in meanwhile.
async fn newest(reports: &mut Streaming<v1::StepReport>) -> Result<Option<v1::StepReport>, tonic::Status> {
    let Some(mut newest) = reports.message().await? else { return Ok(None) };
    while let Ok(next) = tokio::time::timeout(Duration::ZERO, reports.message()).await {
        match next? {
            Some(report) => newest = report,
            None => break,
        }
    }
    Ok(Some(newest))
}
