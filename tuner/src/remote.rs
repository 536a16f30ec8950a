//! Trials over gRPC: the generator-node gives sigma and tau, viz-nodes q, keyed by the trial's id.
//!
//! Whatever was measured stays here: a node that fails costs what it was about to answer, nothing else.

mod error;
mod generator;
mod known;
pub(crate) mod negotiation;
mod progress;
mod round;
pub(crate) mod viewer_streams;
mod viewers;

use crate::evaluator::{Batches, Evaluator, Measurement, TrialError};
pub use progress::Progress;

pub(crate) use error::words;
use futures::stream::FuturesUnordered;
use generator::Generator;
use known::Known;
use lamina_model::{Cost, GenerationParams, Invalid, ParamsKey};
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient};
use round::{Generating, Round};
use std::collections::{HashMap, HashSet, VecDeque};
use std::time::Duration;
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

/// A connection to the `server` at `address`.
///
/// # Errors
/// If nobody answers there.
pub async fn connect(address: &str, server: Role, credentials: Option<&Credentials>) -> Result<Channel, TrialError> {
    let failed = |reason| TrialError::Node { node: address.to_owned(), reason };
    lamina_rpc::connect::connect(address, server, credentials).await.map_err(failed)
}

impl Remote {
    /// A round that asks for costs and the first `batches` batches of all of `keys` that lack them.
    fn round(&mut self, keys: &[ParamsKey], batches: u32) -> Round<'_> {
        let Self { generator, viewers, known, generating, progress } = self;
        Round {
            generator,
            viewers,
            known,
            generating,
            progress,
            batches,
            asked: keys.iter().copied().collect(),
            todo: VecDeque::new(),
            ready: VecDeque::new(),
            busy: HashSet::new(),
            measuring: FuturesUnordered::new(),
        }
        .with_work(keys)
    }

    /// Opens a stream of trials on the newest step of the generator-node, whose address `generator` is for messages; of a run's
    /// `first` study they go before live steps. Viz-nodes are connected to with `credentials`.
    ///
    /// # Errors
    /// If it does not answer or has no step yet, or no viz-node that measures quality subscribes to it within some seconds.
    pub async fn open(
        control: &ControlClient<Channel>,
        generator: &str,
        credentials: &Option<Credentials>,
        first: bool,
    ) -> Result<Self, TrialError> {
        let viewers = Viewers::open(control, generator, credentials.clone()).await?;
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

    async fn evaluate(
        &mut self,
        params: &[GenerationParams],
        batches: Batches,
    ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
        let batches = batches.count(self.batches());
        for p in params {
            self.known.entry(p.key()).or_insert_with(|| Known::new(*p));
        }
        let wanted: Vec<ParamsKey> = params.iter().map(GenerationParams::key).collect();
        self.round(&wanted, batches).run().await?;
        Ok(wanted.iter().map(|k| self.known[k].answer(batches)).collect())
    }
}

impl Remote {
    /// The generator-node's answer to one request, once it has given the one before.
    async fn ask(&mut self, request: v1::TrialRequest) -> Result<v1::TrialReply, TrialError> {
        self.settle().await?;
        let request = v1::TrialRequest { first_study: self.progress.get().is_urgent(), ..request };
        let trial_id = self.generator.ask(request).await?;
        let reply = self.generator.reply().await?;
        round::send(trial_id, self.generator.timeline(), self.generator.step());
        Ok(reply)
    }

    /// Takes the answer that a study given up has left behind.
    async fn settle(&mut self) -> Result<(), TrialError> {
        if !self.generator.is_idle() {
            let reply = self.generator.reply().await?;
            self.round(&[], 0).generated(reply)?;
        }
        Ok(())
    }
}
