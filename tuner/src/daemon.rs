//! The loop: watch steps, study when one calls for it, push the winner.

use crate::ahead::{Ahead, follow};
use crate::characteristic::{Characteristic, choose};
use crate::push::{push, setting};
use crate::remote::{Remote, connect};
use crate::search::{candidates, search};
use crate::trial::{Cost, TrialError};
use crate::tune::Row;
use crate::{Config, status::Status};
use lamina_model::GenerationParams;
use lamina_wire::v1::{self, control_client::ControlClient};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tonic::Streaming;
use tonic::transport::Channel;

/// Pause before a lost generator-node is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// What the loop remembers between steps.
struct Daemon {
    config: Config,
    base: GenerationParams,
    status: Arc<Status>,
    run: Run,
    /// What was pushed last.
    setting: Option<v1::SetParametersRequest>,
    /// First step the setting holds for: earlier ones do not speak against it.
    holds_from: u64,
}

/// What is known of the run watched.
struct Run {
    id: String,
    since: Instant,
    characteristic: Characteristic,
    studied_step: Option<u64>,
    /// The last study found something that keeps the contract.
    feasible: bool,
    /// Wall time of all studies.
    spent: Duration,
}

impl Run {
    fn new(id: String) -> Self {
        let characteristic = Characteristic::default();
        Self { id, since: Instant::now(), characteristic, studied_step: None, feasible: true, spent: Duration::ZERO }
    }

    /// True if studies so far took no more than this share of the time since the run was first seen.
    fn may_study(&self, budget: f64) -> bool {
        self.studied_step.is_none() || self.spent.as_secs_f64() <= budget * self.since.elapsed().as_secs_f64()
    }
}

/// What a step calls for.
enum Call {
    /// The parameters in use are right.
    Nothing,
    /// It is like a step studied before: that one's parameters.
    Switch(v1::SetParametersRequest),
    /// It is like none, or the contract was broken.
    Study,
}

/// Tunes for ever.
pub async fn run(config: Config, base: GenerationParams, status: Arc<Status>) {
    let run = Run::new(String::new());
    let mut daemon = Daemon { config, base, status, run, setting: None, holds_from: 0 };
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
            let outcome = match self.call_of(&report) {
                Call::Nothing => Ok(()),
                Call::Switch(setting) => self.switch(&control, setting).await,
                Call::Study => self.study(&control, &report).await,
            };
            self.status.failed(outcome.as_ref().err());
            if let Err(error) = outcome {
                tracing::warn!("tuning for step {} gave nothing: {error}", report.step);
            }
            self.status.seen(report.step);
        }
        Ok(())
    }

    fn call_of(&mut self, report: &v1::StepReport) -> Call {
        if report.run_id != self.run.id {
            self.run = Run::new(report.run_id.clone());
            self.holds_from = 0;
        }
        let Some(studied) = self.run.studied_step else { return Call::Study };
        if report.step < self.holds_from {
            return Call::Nothing;
        }
        let study = if self.run.may_study(self.config.budget) { Call::Study } else { Call::Nothing };
        if self.config.retune_every > 0 && report.step >= studied + self.config.retune_every {
            return study;
        }
        let cost = Cost::from(report.cost.unwrap_or_default());
        let params = report.params.and_then(|p| GenerationParams::try_from(p).ok());
        let like = params.and_then(|p| self.run.characteristic.like(&p, cost.size_bytes));
        let kept = self.config.contract.excess(&cost, f64::NAN) <= 0.0;
        // Parameters other than those pushed mean that the generator-node had to fall back to keep the size limit.
        let fell_back = self.setting.as_ref().is_some_and(|s| s.params != report.params);
        match like {
            // Where nothing keeps the contract, every step breaks it; asking again each time would find the same.
            Some(_) if !self.run.feasible => Call::Nothing,
            Some(step) => match setting(&step.study, step.chosen, &self.config.contract) {
                known if self.setting.as_ref().is_none_or(|s| s.params != known.params) => Call::Switch(known),
                _ if kept && !fell_back => Call::Nothing,
                _ => study,
            },
            None => study,
        }
    }

    async fn switch(
        &mut self,
        control: &ControlClient<Channel>,
        setting: v1::SetParametersRequest,
    ) -> Result<(), TrialError> {
        let from = push(control, setting.clone()).await?;
        let params = setting.params.unwrap_or_default();
        tracing::info!(
            resolution = params.resolution,
            gamma = params.gamma,
            from,
            "back to parameters of a step like this"
        );
        self.status.chosen(params);
        (self.setting, self.holds_from) = (Some(setting), from);
        Ok(())
    }

    async fn study(&mut self, control: &ControlClient<Channel>, report: &v1::StepReport) -> Result<(), TrialError> {
        let begun = Instant::now();
        let outcome = self.measure(control, report).await;
        self.run.spent += begun.elapsed();
        let (studies, run) = (self.run.spent.as_secs_f64(), self.run.since.elapsed().as_secs_f64());
        tracing::info!(kept = self.run.characteristic.len(), "studies took {studies:.1} s of {run:.1} s");
        outcome
    }

    /// The parameters pushed last; before any, those that the generator-node has of itself, if they lie among `candidates`.
    fn in_use(&self, report: &v1::StepReport, candidates: &[GenerationParams]) -> Option<GenerationParams> {
        let read = |params: Option<v1::GenerationParams>| GenerationParams::try_from(params?).ok();
        if let Some(setting) = &self.setting {
            return read(setting.params);
        }
        let own = read(report.params)?;
        // But for these they are like it.
        let like = |c: &GenerationParams| {
            c.with_resolution(own.resolution()).and_then(|c| c.with_gamma(own.gamma())).is_ok_and(|c| c == own)
        };
        let spanned = |of: fn(&GenerationParams) -> f64| {
            let values = || candidates.iter().filter(|c| like(c)).map(of);
            values().any(|v| v <= of(&own)) && values().any(|v| v >= of(&own))
        };
        (spanned(|p| p.resolution().into()) && spanned(GenerationParams::gamma)).then_some(own)
    }

    async fn measure(&mut self, control: &ControlClient<Channel>, report: &v1::StepReport) -> Result<(), TrialError> {
        let contract = self.config.contract.clone();
        let mut remote = Remote::open(control, &self.config.generator).await?;
        let all = candidates(&mut remote, &self.config.representations, &self.config.grid, &self.base).await?;
        let in_use = self.in_use(report, &all);
        let (mut ahead, picked) =
            in_use.filter(|_| self.setting.is_none()).map(|own| Ahead::new(&contract, own)).unzip();
        let status = &*self.status;
        let progress = move |row: &Row| {
            status.tried(row);
            if let Some(ahead) = &mut ahead {
                ahead.tried(row);
            }
        };
        let searching = search(&mut remote, &contract, &all, in_use.as_ref(), progress);
        let (found, pushed) = match picked {
            Some(picked) => tokio::join!(searching, follow(control, status, picked)),
            None => (searching.await, None),
        };
        if let Some((setting, from)) = pushed {
            (self.setting, self.holds_from) = (Some(setting), from);
        }
        let study = found?.study;
        let in_use = self.in_use(report, &all);
        self.run.studied_step = Some(study.step.max(report.step));
        let Some(chosen) = choose(&study, &contract, in_use.as_ref()) else { return Ok(()) };
        let row = &study.rows[chosen];
        if study.best.is_none() {
            tracing::warn!(
                step = study.step,
                "nothing keeps the contract; nearest: {}",
                contract.describe(&row.measured)
            );
        }
        let setting = setting(&study, chosen, &contract);
        let from = push(control, setting.clone()).await?;
        tracing::info!(
            step = study.step,
            trials = study.rows.len(),
            representation = row.params.representation().name(),
            resolution = row.params.resolution(),
            gamma = row.params.gamma(),
            bytes = row.measured.cost.size_bytes,
            psnr_db = row.measured.quality.psnr_db(),
            from,
            "tuned"
        );
        (self.setting, self.holds_from, self.run.feasible) = (Some(setting), from, study.best.is_some());
        self.status.finished(&study, chosen);
        self.run.characteristic.keep(study, chosen);
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
