//! Trials over gRPC: the generator-node gives sigma and tau, viz-nodes q, keyed by the trial's id.
//!
//! Whatever was measured stays here: a node that fails costs what it was about to answer, nothing else.

mod generator;
mod round;
mod viewers;

use crate::evaluator::{Evaluator, Measurement, TrialError};
use generator::Generator;
use lamina_model::{Cost, GenerationParams, Invalid, ParamsKey, Quality};
use lamina_rpc::connect::innermost;
use lamina_rpc::v1::{self, control_client::ControlClient};
use round::{Generating, Round};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tonic::Status;
use tonic::transport::Channel;
use viewers::Viewers;

/// Trials on one step, which the generator-node holds as long as this lives, measured by all viz-nodes that subscribe to it.
#[derive(Debug)]
pub struct Remote {
    generator: Generator,
    viewers: Viewers,
    known: HashMap<ParamsKey, Known>,
    /// What the generator-node is at; its answer is waited for by whoever comes next.
    generating: Option<Generating>,
    progress: Progress,
}

/// How far a study is, as viz-nodes are told with every question. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct Progress(Arc<Mutex<v1::StudyProgress>>);

impl Progress {
    /// Of a run's first study, or of a later one.
    pub fn new(first: bool) -> Self {
        Self(Arc::new(Mutex::new(v1::StudyProgress { first, ..Default::default() })))
    }

    fn state(&self) -> MutexGuard<'_, v1::StudyProgress> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn get(&self) -> v1::StudyProgress {
        *self.state()
    }

    fn begin_trial(&self) {
        self.state().trials += 1;
    }

    /// Another trial is the best so far.
    pub fn best(&self, measured: &Measurement) {
        let mut state = self.state();
        state.best_psnr_db = Some(measured.quality.psnr_db());
        state.best_size_bytes = measured.cost.size_bytes;
    }
}

/// What is known of one set of parameters.
#[derive(Debug)]
struct Known {
    params: GenerationParams,
    cost: Option<Cost>,
    quality: Quality,
    /// It cannot be measured.
    refusal: Option<Invalid>,
    /// Which viewer has its VDI, as which trial.
    held: Option<(String, u64)>,
    /// How often in a row a viewer did not have what it was to have.
    missed: u32,
}

impl Known {
    fn new(params: GenerationParams) -> Self {
        Self { params, cost: None, quality: Quality::default(), refusal: None, held: None, missed: 0 }
    }

    /// True while there is something to find out.
    fn lacks(&self, batches: u32) -> bool {
        self.refusal.is_none() && (self.cost.is_none() || self.quality.batches() < batches as usize)
    }

    /// The answer, if nothing is lacking.
    fn answer(&self, batches: u32) -> Result<Measurement, Invalid> {
        if let Some(refusal) = &self.refusal {
            return Err(refusal.clone());
        }
        Ok(Measurement { cost: self.cost.unwrap_or_default(), quality: self.quality.first(batches as usize) })
    }
}

fn node_error(kind: &str, address: &str, reason: &str) -> TrialError {
    TrialError::Node { node: format!("{kind} {address}"), reason: reason.to_owned() }
}

/// What a failed call says: the cause at the bottom, if the transport knows one.
pub(crate) fn words(status: &Status) -> String {
    std::error::Error::source(status).map_or_else(|| status.message().to_owned(), innermost)
}

/// A connection to the node at `address`.
///
/// # Errors
/// If nobody answers there.
pub async fn connect(address: &str) -> Result<Channel, TrialError> {
    let failed = |reason| TrialError::Node { node: address.to_owned(), reason };
    lamina_rpc::connect::connect(address).await.map_err(failed)
}

impl Remote {
    /// Opens a stream of trials on the newest step of the generator-node, whose address `generator` is for messages; of a run's
    /// `first` study they go before live steps.
    ///
    /// # Errors
    /// If it does not answer or has no step yet, or no viz-node that measures quality subscribes to it within some seconds.
    pub async fn open(control: &ControlClient<Channel>, generator: &str, first: bool) -> Result<Self, TrialError> {
        let viewers = Viewers::open(control, generator).await?;
        let generator = Generator::open(control, generator).await?;
        Ok(Self { generator, viewers, known: HashMap::new(), generating: None, progress: Progress::new(first) })
    }

    /// How far the study is.
    pub fn progress(&self) -> Progress {
        self.progress.clone()
    }
}

impl Evaluator for Remote {
    fn step(&self) -> u64 {
        self.generator.step()
    }

    fn batches(&self) -> u32 {
        self.generator.batches()
    }

    fn longest_side(&self) -> u32 {
        self.generator.longest_side()
    }

    async fn sizes(&mut self, params: &GenerationParams, gammas: &[f64]) -> Result<Vec<Cost>, TrialError> {
        if gammas.is_empty() {
            return Ok(Vec::new());
        }
        let request = v1::TrialRequest { params: Some(params.into()), gammas: gammas.to_vec(), ..Default::default() };
        let reply = self.ask(request).await?;
        if !reply.refusal.is_empty() {
            return Err(Invalid::new("candidates", reply.refusal).into());
        }
        if reply.costs.len() != gammas.len() {
            let (got, asked) = (reply.costs.len(), gammas.len());
            return Err(self
                .generator
                .failed(format!("{got} costs for {asked} gammas; are all nodes of one version?")));
        }
        Ok(reply.costs.into_iter().map(Cost::from).collect())
    }

    async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        let request = v1::TrialRequest { params: Some(params.into()), time_alone: true, ..Default::default() };
        let reply = self.ask(request).await?;
        if !reply.refusal.is_empty() {
            return Ok(Err(Invalid::new("candidate", reply.refusal)));
        }
        let cost = reply.cost.ok_or_else(|| self.generator.no_cost())?;
        Ok(Ok(Cost::from(cost).generation))
    }

    async fn measure(
        &mut self,
        params: &[GenerationParams],
        batches: u32,
    ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
        let batches = batches.min(self.batches());
        for p in params {
            self.known.entry(p.key()).or_insert_with(|| Known::new(*p));
        }
        let wanted: Vec<ParamsKey> = params.iter().map(GenerationParams::key).collect();
        Round::new(self, &wanted, batches).run().await?;
        Ok(wanted.iter().map(|k| self.known[k].answer(batches)).collect())
    }
}

impl Remote {
    /// The generator-node's answer to one request, once it has given the one before.
    async fn ask(&mut self, request: v1::TrialRequest) -> Result<v1::TrialReply, TrialError> {
        self.settle().await?;
        let request = v1::TrialRequest { first_study: self.progress.get().first, ..request };
        self.generator.ask(request).await?;
        self.generator.reply().await
    }

    /// Takes the answer that a study given up has left behind.
    async fn settle(&mut self) -> Result<(), TrialError> {
        if !self.generator.is_idle() {
            let reply = self.generator.reply().await?;
            Round::new(self, &[], 0).generated(reply)?;
        }
        Ok(())
    }
}
