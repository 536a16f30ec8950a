//! Measures generation parameters on one time step in this process: both nodes' kernels, without sockets.

use crate::offline::prepare;
use crate::process;
use lamina_codec::{DecodeLimits, EncodeOptions, ErrorMeasure};
use lamina_model::Cost;
use lamina_model::{
    GenerationParams, Intermediate, Invalid, ParamsKey, Quality, ReferenceSamples, SamplePlan, Scene, Segmentation,
    Volume,
};
use lamina_raycast::{Field, most_points};
use lamina_tuner::evaluator::{Batches, Evaluator, Measurement, TrialError};
use lamina_vdi_render::{Detail, Drawable, Kernels};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// One set of parameters with everything that has been measured of it.
#[derive(Debug, Clone)]
pub struct RecordedTrial {
    /// The parameters.
    pub params: GenerationParams,
    /// Size, and times of generation and encoding.
    pub cost: Cost,
    /// How often the generation was timed; `cost` holds the shortest time.
    pub timed: u32,
    /// Quality on the batches of sampled pixels that were compared so far.
    pub quality: Quality,
    /// Processor time that measuring took.
    pub spent: SpentTime,
}

/// Processor time of all threads that a trial took, nanoseconds.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct SpentTime {
    /// Generating.
    pub generate_ns: u64,
    /// Encoding.
    pub encode_ns: u64,
    /// Decoding and preparing to draw.
    pub decode_ns: u64,
    /// Drawing and comparing the sampled pixels.
    pub quality_ns: u64,
}

impl SpentTime {
    /// Adds `more`.
    pub fn add(&mut self, more: &Self) {
        self.generate_ns += more.generate_ns;
        self.encode_ns += more.encode_ns;
        self.decode_ns += more.decode_ns;
        self.quality_ns += more.quality_ns;
    }

    /// The sum of all activities, seconds.
    pub fn secs(&self) -> f64 {
        1e-9 * (self.generate_ns + self.encode_ns + self.decode_ns + self.quality_ns) as f64
    }
}

/// Where trials are recorded: in memory ([`TrialsInMemory`]), or in a file that a later run reads.
pub trait TrialStore: std::fmt::Debug + Send {
    /// The recorded trial of `params`.
    fn get(&self, params: &GenerationParams) -> Option<&RecordedTrial>;

    /// Records a trial; it replaces an earlier one of the same parameters.
    ///
    /// # Errors
    /// If it cannot be written.
    fn put(&mut self, trial: RecordedTrial) -> anyhow::Result<()>;
}

/// Trials by their parameters.
pub type TrialsInMemory = HashMap<ParamsKey, RecordedTrial>;

impl TrialStore for TrialsInMemory {
    fn get(&self, params: &GenerationParams) -> Option<&RecordedTrial> {
        self.get(&params.key())
    }

    fn put(&mut self, trial: RecordedTrial) -> anyhow::Result<()> {
        self.insert(trial.params.key(), trial);
        Ok(())
    }
}

/// The evaluator of one time step; trials that its store holds are not measured again.
#[derive(Debug)]
pub struct InProcessEvaluator {
    step: u64,
    field: Field,
    segmentation: Segmentation,
    kernels: Kernels,
    reference: ReferenceSamples,
    trials: Box<dyn TrialStore>,
    /// The parameters measured last with their decoded result, for further batches of pixels.
    held: Option<(GenerationParams, Drawable)>,
}

impl InProcessEvaluator {
    /// The evaluator of time step `step`, which is `volume` under `scene`. Quality is compared on the pixels of `plan`; VDIs
    /// are made with `segmentation`, as all those in `trials` were.
    ///
    /// # Errors
    /// If the reference pixels cannot be cast.
    pub fn new(
        step: u64,
        volume: Volume,
        scene: &Scene,
        kernels: &Kernels,
        plan: &SamplePlan,
        segmentation: Segmentation,
        trials: Box<dyn TrialStore>,
    ) -> Result<Self, Invalid> {
        let (field, kernels) = (prepare(volume, scene), kernels.clone());
        let reference = kernels.cast.reference_samples(&field, plan, step)?;
        Ok(Self { step, field, segmentation, kernels, reference, trials, held: None })
    }

    /// The trial of `params`, if it was measured.
    pub fn trial(&self, params: &GenerationParams) -> Option<&RecordedTrial> {
        self.trials.get(params)
    }

    /// The field that is measured on.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The VDI or reduced volume of `params` as a viewer receives it: encoded and decoded.
    ///
    /// # Errors
    /// If it cannot be generated or coded.
    pub fn decoded(&self, params: &GenerationParams) -> Result<Drawable, Invalid> {
        Ok(self.generate(params)?.0)
    }

    /// Times the generation of a recorded trial once more, unless it was timed `times` times already. The shortest time counts,
    /// because other load on the machine only ever adds. The processor time is not charged to the trial.
    ///
    /// # Errors
    /// If it cannot be generated, or the trial not be recorded.
    pub fn time_again(&mut self, params: &GenerationParams, times: u32) -> anyhow::Result<()> {
        if let Some(known) = self.trials.get(params).filter(|known| known.timed < times) {
            let (mut trial, (_, time)) = (known.clone(), self.represent(params)?);
            trial.cost.generation = trial.cost.generation.min(time);
            trial.timed += 1;
            self.trials.put(trial)?;
        }
        Ok(())
    }

    /// Generates, encodes and decodes.
    fn generate(&self, params: &GenerationParams) -> Result<(Drawable, Cost, SpentTime), Invalid> {
        let start = clock();
        let (intermediate, generation_time) = self.represent(params)?;
        let generated = clock();
        let (bytes, cost) = self.encode(&intermediate, generation_time)?;
        let encoded = clock();
        let decoded = Drawable::new(lamina_codec::decode_any(&bytes, &DecodeLimits::default())?);
        let ns = |from: Duration, to: Duration| to.saturating_sub(from).as_nanos() as u64;
        let spent = SpentTime {
            generate_ns: ns(start, generated),
            encode_ns: ns(generated, encoded),
            decode_ns: ns(encoded, clock()),
            quality_ns: 0,
        };
        Ok((decoded, cost, spent))
    }

    /// The encoded bytes, and their cost.
    fn encode(&self, intermediate: &Intermediate, generation_time: Duration) -> Result<(Vec<u8>, Cost), Invalid> {
        let encoded =
            lamina_codec::encode_timed(intermediate, generation_time, &encode_options(self.segmentation), None)?;
        Ok((encoded.bytes, encoded.cost))
    }

    fn represent(&self, params: &GenerationParams) -> Result<(Intermediate, Duration), Invalid> {
        self.kernels.cast.represent(&self.field, params, self.segmentation)
    }

    /// Measures `params` until `batches` batches of pixels are compared.
    fn measure_one(&mut self, params: &GenerationParams, batches: u32) -> Result<Measurement, Invalid> {
        let mut trial = match self.trials.get(params) {
            Some(known) if known.quality.batches() as u32 >= batches => return Ok(measured(known)),
            Some(known) => known.clone(),
            None => {
                let (decoded, cost, spent) = self.generate(params)?;
                self.held = Some((*params, decoded));
                RecordedTrial { params: *params, cost, timed: 1, spent, quality: Quality::default() }
            }
        };
        if (trial.quality.batches() as u32) < batches {
            if self.held.as_ref().is_none_or(|(held, _)| held != params) {
                let (decoded, _, again) = self.generate(params)?;
                self.held = Some((*params, decoded));
                trial.spent.add(&again);
            }
            let start = clock();
            if let Some((_, decoded)) = &self.held {
                let more = trial.quality.batches() as u32..batches;
                let quality = self.kernels.draw.quality(decoded, &self.reference, more, Detail::Cubic)?;
                trial.quality.extend(&quality)?;
            }
            trial.spent.quality_ns += clock().saturating_sub(start).as_nanos() as u64;
        }
        let answer = measured(&trial);
        self.trials.put(trial).map_err(|e| Invalid::new("cache", e.to_string()))?;
        Ok(answer)
    }
}

/// How steps are encoded: VDIs of greedy segmentation as in the paper, all else as the nodes send it.
pub fn encode_options(segmentation: Segmentation) -> EncodeOptions {
    let options = match segmentation {
        Segmentation::Greedy => EncodeOptions::BZIP2,
        Segmentation::Fitted => EncodeOptions::default(),
    };
    EncodeOptions { error: ErrorMeasure::MeanSquare, ..options }
}

fn measured(trial: &RecordedTrial) -> Measurement {
    Measurement { cost: trial.cost, quality: trial.quality.clone() }
}

/// Processor time of this process so far; wall time where the system does not count it.
fn clock() -> Duration {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    process::cpu_time().unwrap_or_else(|| START.elapsed())
}

impl Evaluator for InProcessEvaluator {
    fn step(&self) -> u64 {
        self.step
    }

    fn batches(&self) -> u32 {
        self.reference.plan.batches
    }

    fn longest_side(&self) -> u32 {
        most_points(&self.field)
    }

    async fn sizes(&mut self, params: &GenerationParams, gammas: &[f64]) -> Result<Vec<Cost>, TrialError> {
        let start = Instant::now();
        let all = self.kernels.cast.represent_all(&self.field, params, gammas, self.segmentation)?;
        let generation_time = start.elapsed();
        all.iter().map(|one| Ok(self.encode(one, generation_time)?.1)).collect()
    }

    async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        Ok(self.represent(params).map(|(_, time)| time))
    }

    async fn evaluate(
        &mut self,
        params: &[GenerationParams],
        batches: Batches,
    ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
        let batches = batches.count(self.batches());
        Ok(params.iter().map(|p| self.measure_one(p, batches)).collect())
    }
}
