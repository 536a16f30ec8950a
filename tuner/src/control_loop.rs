//! The loop: watch steps, study when one calls for it, push the winner.

use crate::characteristic_steps::choose;
use crate::evaluator::{Evaluator as _, TrialError};
use crate::key_frame::KeyFrame;
use crate::live::LiveQuality;
use crate::provisional::{ProvisionalChoice, follow};
use crate::push::{limits_alone, push, setting};
use crate::remote::negotiation::Negotiator;
use crate::remote::viewer_streams::follow_all;
use crate::remote::{Remote, connect};
use crate::run_state::{RunState, StudyEnd};
use crate::search::{CandidateSet, SearchRequest, search_with_margin};
use crate::transfer::transferred;
use crate::tune::{Study, Trial};
use crate::{Config, Contract, status::Status};
use futures::StreamExt;
use lamina_model::{Cost, GenerationParams, Setting, StepReport, TuningState};
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::Instant;
use tonic::transport::Channel;

/// Pause before a lost generator-node is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// Reports taken at once.
const MEANWHILE: usize = 1024;

/// What the loop remembers between steps.
struct Daemon {
    /// With the contract in force, whoever asked for it.
    config: Config,
    /// What changes while it runs.
    settings: watch::Receiver<Config>,
    credentials: Option<Credentials>,
    base: GenerationParams,
    status: Arc<Status>,
    run: RunState,
    /// What was pushed last.
    setting: Option<Setting>,
    /// First step the setting holds for: earlier ones do not speak against it.
    holds_from: u64,
    key_frame: KeyFrame,
    /// The contract that was asked for last.
    wanted: watch::Sender<Contract>,
    negotiator: Negotiator,
}

/// What a step calls for.
enum Call {
    /// The parameters in use are right.
    Nothing,
    /// It is like a step studied before: that one's parameters.
    Switch(Setting, f64),
    /// It is like none, or the contract was broken.
    Study,
}

/// Tunes for ever.
pub(crate) async fn run(
    settings: watch::Receiver<Config>,
    credentials: Option<Credentials>,
    base: GenerationParams,
    status: Arc<Status>,
) {
    let config = settings.borrow().clone();
    let run = RunState::new(String::new());
    status.contract(&config.contract);
    let wanted = watch::Sender::new(config.contract.clone());
    let negotiator = Negotiator { status: status.clone(), wanted: wanted.clone() };
    tokio::spawn(negotiator.clone().follow_configuration(settings.clone()));
    let key_frame = KeyFrame::default();
    let (setting, holds_from) = (None, 0);
    let mut daemon =
        Daemon { config, settings, credentials, base, status, run, setting, holds_from, key_frame, wanted, negotiator };
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
        let control = ControlClient::new(connect(&generator, Role::Generator, self.credentials.as_ref()).await?);
        let failed = |s: tonic::Status| TrialError::Node { node: generator.clone(), reason: s.message().to_owned() };
        let reports = control.clone().watch(v1::WatchRequest {}).await.map_err(failed)?.into_inner();
        // What came in meanwhile comes at once: only the newest matters.
        let mut reports = reports.ready_chunks(MEANWHILE);
        let mut negotiating = JoinSet::new();
        negotiating.spawn(follow_all(control.clone(), self.credentials.clone(), self.negotiator.clone()));
        let mut wanted = self.wanted.subscribe();
        if *wanted.borrow() != self.config.contract {
            wanted.mark_changed();
        }
        let mut quality = self.live_quality(&control);
        tracing::info!(generator, "watching");
        // A restarted generator-node has forgotten its parameters; a new one knows no limits yet.
        let begin = self.setting.clone();
        let limits = || limits_alone(&self.config.contract, &self.config.representations);
        let from = push(&control, &begin.clone().unwrap_or_else(limits)).await?;
        if begin.is_some() {
            self.holds_from = self.holds_from.max(from);
        }
        loop {
            let some = tokio::select! {
                Ok(()) = wanted.changed() => {
                    let contract = wanted.borrow_and_update().clone();
                    self.adopt(&control, contract).await?;
                    quality = self.live_quality(&control);
                    continue;
                }
                some = reports.next() => some,
            };
            let Some(some) = some else { return Ok(()) };
            let mut newest = None;
            for report in some {
                match StepReport::try_from(report.map_err(failed)?) {
                    Ok(report) => newest = Some(self.key_frame.compared(report)),
                    Err(error) => tracing::warn!("a report cannot be read: {error}"),
                }
            }
            let Some(report) = newest else { continue };
            self.status.working(true);
            let call = match (self.call_of(&report), &mut quality) {
                (Call::Nothing, Some(quality)) if self.may_ask_quality(&report) => {
                    let measured = quality.of(&report).await;
                    let calls = measured.is_some_and(|m| self.quality_calls(&report, &m));
                    if calls { Call::Study } else { Call::Nothing }
                }
                (call, _) => call,
            };
            let outcome = match call {
                Call::Nothing => Ok(()),
                Call::Switch(setting, psnr_db) => self.switch(&control, setting, psnr_db).await,
                // What another contract leaves undone is begun anew under it.
                Call::Study => tokio::select! {
                    studied = self.study(&control, &report) => studied,
                    Ok(()) = wanted.changed() => {
                        wanted.mark_changed();
                        Ok(())
                    }
                },
            };
            self.status.failed(outcome.as_ref().err());
            if let Err(error) = outcome {
                match self.run.carried.len() {
                    0 => tracing::warn!("nothing was tuned for step {}: {error}", report.step),
                    n => tracing::warn!(
                        "the study for step {} was cut short: {error}; the best of its {n} trials stays in use, and the next study goes on from them",
                        report.step
                    ),
                }
            }
            self.status.seen(report.step);
        }
    }

    /// The quality of live steps, where the contract limits it.
    fn live_quality(&self, control: &ControlClient<Channel>) -> Option<LiveQuality> {
        let Contract { limits, ssim, .. } = &self.config.contract;
        let is_limited = limits.psnr_db.is_some() || ssim.is_some();
        is_limited.then(|| LiveQuality::follow(control, &self.credentials))
    }

    /// Turns to another contract. The best that was measured so far is in use until the study for it says more; what holds at
    /// once are its limits.
    async fn adopt(&mut self, control: &ControlClient<Channel>, contract: Contract) -> Result<(), TrialError> {
        let limits = limits_alone(&contract, &self.config.representations);
        push(control, &limits).await?;
        self.config.contract = contract;
        let carried = self.run.forget_choices();
        let contract = &self.config.contract;
        let rows = carried.into_iter().map(|row| Trial { cost: contract.cost(&row.measured), ..row });
        let mut study = Study { step: 0, rows: Vec::new(), best: None };
        rows.for_each(|row| study.add(row));
        if let Some(nearest) = choose(&study, contract, None) {
            let setting = setting(&study, nearest, contract, TuningState::Provisional);
            self.switch(control, setting, study.rows[nearest].measured.quality.psnr_db()).await?;
        } else {
            self.setting = None;
        }
        Ok(())
    }

    /// True if a step's quality may call for a study.
    fn may_ask_quality(&self, report: &StepReport) -> bool {
        report.step >= self.holds_from && self.run.may_study(self.settings.borrow().budget)
    }

    /// True if a step that was made after the last study is worse than the contract allows; where nothing kept the contract on
    /// steps like it, if it keeps it well: then something cheaper may.
    fn quality_calls(&self, report: &StepReport, measured: &v1::StepQuality) -> bool {
        let contract = &self.config.contract;
        let since = measured.step >= self.holds_from && self.run.studied_step.is_some_and(|s| measured.step > s);
        since
            && match self.run.nearest_studied(report) {
                Some(step) if step.study.best.is_none() => {
                    contract.aim().excess(&report.cost, measured.psnr_db - measured.half_width_db) <= 0.0
                        && !contract.aim().is_above(measured.ssim)
                }
                // Only where the whole interval lies beyond the limit.
                _ => {
                    contract.excess(&Cost::default(), measured.psnr_db + measured.half_width_db) > 0.0
                        || contract.is_above(measured.ssim)
                }
            }
    }

    fn call_of(&mut self, report: &StepReport) -> Call {
        if report.run_id != self.run.id {
            self.run = RunState::new(report.run_id.clone());
            self.holds_from = 0;
        }
        let Some(studied) = self.run.studied_step else { return Call::Study };
        if report.step < self.holds_from {
            return Call::Nothing;
        }
        let Config { budget, retune_every, .. } = *self.settings.borrow();
        let study = if self.run.may_study(budget) { Call::Study } else { Call::Nothing };
        if retune_every > 0 && report.step >= studied + retune_every {
            return study;
        }
        self.run.timed(report, &self.config.contract);
        let kept = self.config.contract.excess(&report.cost, f64::NAN) <= 0.0;
        match self.run.nearest_studied(report) {
            Some(step) if step.cut && matches!(study, Call::Study) => study,
            Some(step) => match setting(&step.study, step.chosen, &self.config.contract, TuningState::Done) {
                known if self.setting.as_ref().is_none_or(|s| s.params != known.params) => {
                    Call::Switch(known, step.study.rows[step.chosen].measured.quality.psnr_db())
                }
                _ if kept && !report.fell_back => Call::Nothing,
                // Where nothing keeps the contract, every step breaks it; asking again each time would find the same. What was
                // cut short is asked again above, as soon as there is time.
                _ if step.study.best.is_none() => Call::Nothing,
                _ => study,
            },
            None => study,
        }
    }

    async fn switch(
        &mut self,
        control: &ControlClient<Channel>,
        setting: Setting,
        psnr_db: f64,
    ) -> Result<(), TrialError> {
        let from = push(control, &setting).await?;
        let params = setting.params.unwrap_or_default();
        tracing::info!(
            resolution = params.resolution(),
            gamma = params.gamma(),
            from,
            "parameters that were measured before"
        );
        self.status.chosen(setting.params, psnr_db);
        (self.setting, self.holds_from) = (Some(setting), from);
        Ok(())
    }

    async fn study(&mut self, control: &ControlClient<Channel>, report: &StepReport) -> Result<(), TrialError> {
        let (begun, first) = (Instant::now(), self.run.studied_step.is_none());
        let outcome = self.measure(control, report).await;
        self.run.record_study(begun.elapsed(), first, *outcome.as_ref().unwrap_or(&StudyEnd::Failed));
        let (studies, run) = ((self.run.first + self.run.later).as_secs_f64(), self.run.since.elapsed().as_secs_f64());
        tracing::info!(kept = self.run.characteristic.len(), "studies took {studies:.1} s of {run:.1} s");
        outcome.map(|_| ())
    }

    /// The parameters that the step was made with: those pushed, or what the generator-node fell back to; those that it has of
    /// itself, if they lie among `candidates`.
    fn in_use(&self, report: &StepReport, candidates: &CandidateSet) -> Option<GenerationParams> {
        (self.setting.is_some() || candidates.spans(&report.params)).then_some(report.params)
    }

    async fn measure(&mut self, control: &ControlClient<Channel>, report: &StepReport) -> Result<StudyEnd, TrialError> {
        let (limits, until) = (self.config.contract.clone(), self.run.until(self.settings.borrow().budget));
        let pace = self.run.pace.ratio();
        let contract = limits.paced(pace);
        let given = until.map_or(Duration::ZERO, |until| until - Instant::now());
        let first = self.run.studied_step.is_none();
        let mut remote = Remote::open(control, &self.config.generator, &self.credentials, first).await?;
        let Config { representations, grid, .. } = &self.config;
        let all = CandidateSet::new(remote.longest_side(), representations, grid, &self.base)?;
        let mut all = all.with_range_of(&self.run.candidates);
        // Before any study the parameters in use are nobody's choice.
        let mut in_use = if first { None } else { self.in_use(report, &all) };
        let (mut provisional, chosen) = ProvisionalChoice::new(&contract, remote.progress());
        let status = &*self.status;
        let (step, mut tried) = (remote.step(), Vec::new());
        let rows: &mut Vec<Trial> = &mut tried;
        // Dropped with the search, which ends what is followed.
        let progress = move |row: &Trial| {
            status.tried(row);
            rows.retain(|known| known.params != row.params);
            rows.push(row.clone());
            provisional.add(row);
        };
        // `in_use` as it is now: what is chosen meanwhile changes it.
        let (searched, used, carried) = (&mut all, in_use, std::mem::take(&mut self.run.carried));
        let request = SearchRequest {
            in_use: used.as_ref(),
            until,
            carried: &carried,
            ..SearchRequest::new(&contract, searched)
        };
        let searching = search_with_margin(&mut remote, request, progress);
        let (found, pushed) =
            if first { tokio::join!(searching, follow(control, status, chosen)) } else { (searching.await, None) };
        if let Some((setting, from)) = pushed {
            in_use = setting.params;
            (self.setting, self.holds_from) = (Some(setting), from);
        }
        self.run.candidates = all;
        // A study that nodes cut short has measured something all the same: it stays in use, and the next one goes on from it.
        let found = found.inspect_err(|_| {
            if tried.is_empty() {
                status.lost_study();
                self.run.carried = carried;
            } else {
                status.measured(step, &tried, None);
                self.run.carried.clone_from(&tried);
            }
        })?;
        let study = found.study;
        let studied = study.step.max(report.step);
        let cut = found.cut;
        let end = if cut { StudyEnd::Cut(given) } else { StudyEnd::Whole };
        let Some(chosen) = choose(&study, &contract, in_use.as_ref()) else {
            tracing::warn!(step = study.step, cut, "nothing could be tried");
            self.run.studied_step = self.run.studied_step.or(Some(studied).filter(|_| !cut));
            return Ok(end);
        };
        let row = &study.rows[chosen];
        if study.best.is_none() {
            tracing::warn!(
                step = study.step,
                "nothing {} the contract; nearest: {}{}",
                if cut { "tried in the time there was keeps" } else { "keeps" },
                limits.describe(&row.measured),
                if pace > 1.0 { format!("; live steps take {pace:.1} times as long") } else { String::new() }
            );
        }
        let state = if cut { TuningState::Provisional } else { TuningState::Done };
        // Where time was short, something else than what was tried may be known to serve.
        let expected = if cut && study.best.is_none() {
            transferred(&study, self.run.characteristic.tables(), &contract)
        } else {
            None
        };
        if let Some(params) = &expected {
            let (resolution, gamma) = (params.resolution(), params.gamma());
            tracing::info!(resolution, gamma, "in use is what should keep it, after the trials on an earlier step");
        }
        let nearest = setting(&study, chosen, &limits, state);
        let setting = Setting { params: expected.or(nearest.params), ..nearest };
        let from = push(control, &setting).await?;
        tracing::info!(
            step = study.step,
            trials = study.rows.len(),
            representation = row.params.representation().name(),
            resolution = row.params.resolution(),
            gamma = row.params.gamma(),
            bytes = row.measured.cost.size_bytes,
            psnr_db = row.measured.quality.psnr_db(),
            left = found.left,
            cut,
            from,
            "tuned"
        );
        self.run.studied_step = Some(studied);
        let before = self.setting.replace(setting).and_then(|s| s.params);
        self.holds_from = from;
        // What was chosen on steps like this one did not serve.
        if let (Some(_), Some(before)) = (study.best, before) {
            self.run.characteristic.forget(&report.params, report.cost.size_bytes, &before);
        }
        self.status.measured(study.step, &study.rows, Some(chosen));
        self.run.characteristic.keep(study, chosen, cut);
        Ok(end)
    }
}
