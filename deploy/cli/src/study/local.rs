//! Trials in this process: both nodes' kernels on one step, without sockets.

use super::cache::{Cache, Spent, Trial as Recorded};
use crate::parts::prepare;
use crate::process;
use lamina_codec::{self, DecodeLimits, EncodeOptions};
use lamina_model::{
    GenerationParams, Intermediate, Invalid, Quality, ReferenceSamples, SamplePlan, Scene, Segmentation, Volume,
};
use lamina_raycast::{Backend, Field, most_points};
use lamina_tuner::trial::{Cost, Measured, Trial, TrialError};
use lamina_vdi_render::{self as viz, Detail, Drawable};
use std::time::{Duration, Instant};

/// Measures on one field; what the cache holds is not measured again.
pub struct Local {
    step: u64,
    field: Field,
    segmentation: Segmentation,
    backend: Backend,
    viewer: viz::Backend,
    reference: ReferenceSamples,
    cache: Cache,
    /// What was measured last, for further batches.
    held: Option<(GenerationParams, Drawable)>,
}

impl Local {
    /// Trials of `step`, which is `volume` under `scene`, on the pixels of `plan`; `cache` has VDIs of `segmentation`.
    ///
    /// # Errors
    /// If those cannot be cast.
    pub fn new(
        step: u64,
        volume: Volume,
        scene: &Scene,
        backends: &(Backend, viz::Backend),
        plan: &SamplePlan,
        segmentation: Segmentation,
        cache: Cache,
    ) -> Result<Self, Invalid> {
        let (field, (backend, viewer)) = (prepare(volume, scene), backends.clone());
        let reference = backend.reference_samples(&field, plan, step)?;
        Ok(Self { step, field, segmentation, backend, viewer, reference, cache, held: None })
    }

    /// What has been measured so far, with what measuring took.
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// The field measured on.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// What `params` give as a viewer has it: encoded and decoded.
    ///
    /// # Errors
    /// If it cannot be generated or coded.
    pub fn shown(&self, params: &GenerationParams) -> Result<Drawable, Invalid> {
        Ok(self.generate(params)?.0)
    }

    /// Generates, encodes and decodes.
    fn generate(&self, params: &GenerationParams) -> Result<(Drawable, Cost, Spent), Invalid> {
        let start = clock();
        let (intermediate, generation_time) = self.represent(params)?;
        let generated = clock();
        let (bytes, cost) = self.encode(&intermediate, generation_time)?;
        let encoded = clock();
        let shown = Drawable::new(lamina_codec::decode_any(&bytes, &DecodeLimits::default())?);
        let ns = |from: Duration, to: Duration| to.saturating_sub(from).as_nanos() as u64;
        let spent = Spent {
            generate_ns: ns(start, generated),
            encode_ns: ns(generated, encoded),
            decode_ns: ns(encoded, clock()),
            quality_ns: 0,
        };
        Ok((shown, cost, spent))
    }

    /// Its bytes, with what they cost.
    fn encode(&self, intermediate: &Intermediate, generation_time: Duration) -> Result<(Vec<u8>, Cost), Invalid> {
        let options = encode_options(self.segmentation);
        let (bytes, [generation_time, encode_time]) =
            lamina_codec::encode_timed(intermediate, generation_time, &options)?;
        let (size_bytes, supersegments) = (bytes.len() as u64, intermediate.elements());
        Ok((bytes, Cost { size_bytes, generation_time, encode_time, supersegments }))
    }

    fn represent(&self, params: &GenerationParams) -> Result<(Intermediate, Duration), Invalid> {
        self.backend.represent(&self.field, params, self.segmentation)
    }

    /// Times the generation of a trial once more, unless that was done so often: the least counts, for what else a machine
    /// does only ever adds. Not charged to the trial, which needs no second time.
    ///
    /// # Errors
    /// If it cannot be generated, or the cache not be written.
    pub fn time_again(&mut self, params: &GenerationParams, times: u32) -> anyhow::Result<()> {
        if let Some(known) = self.cache.get(params).filter(|known| known.timed < times) {
            let (mut trial, (_, time)) = (known.clone(), self.represent(params)?);
            trial.cost.generation_time = trial.cost.generation_time.min(time);
            trial.timed += 1;
            self.cache.put(trial)?;
        }
        Ok(())
    }

    fn one(&mut self, params: &GenerationParams, batches: u32) -> Result<Measured, Invalid> {
        let mut trial = match self.cache.get(params) {
            Some(known) if known.quality.batches() as u32 >= batches => return Ok(measured(known)),
            Some(known) => known.clone(),
            None => {
                let (shown, cost, spent) = self.generate(params)?;
                self.held = Some((*params, shown));
                Recorded { params: *params, cost, timed: 1, spent, quality: Quality::default() }
            }
        };
        if (trial.quality.batches() as u32) < batches {
            if self.held.as_ref().is_none_or(|(held, _)| held != params) {
                let (shown, _, again) = self.generate(params)?;
                self.held = Some((*params, shown));
                trial.spent.add(&again);
            }
            let start = clock();
            if let Some((_, shown)) = &self.held {
                let more = trial.quality.batches() as u32..batches;
                let quality = self.viewer.quality(shown, &self.reference, more, Detail::Cubic)?;
                trial.quality.extend(&quality)?;
            }
            trial.spent.quality_ns += clock().saturating_sub(start).as_nanos() as u64;
        }
        let answer = measured(&trial);
        self.cache.put(trial).map_err(|e| Invalid::new("cache", e.to_string()))?;
        Ok(answer)
    }
}

/// How VDIs cut so are coded: as in the paper, or as nodes send them.
pub fn encode_options(segmentation: Segmentation) -> EncodeOptions {
    match segmentation {
        Segmentation::Greedy => EncodeOptions::BZIP2,
        Segmentation::Fitted => EncodeOptions::default(),
    }
}

fn measured(trial: &Recorded) -> Measured {
    Measured { cost: trial.cost, quality: trial.quality.clone() }
}

/// Processor time so far; wall time where the system does not tell.
fn clock() -> Duration {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    process::cpu_time().unwrap_or_else(|| START.elapsed())
}

impl Trial for Local {
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
        let all = self.backend.represent_all(&self.field, params, gammas, self.segmentation)?;
        let generation_time = start.elapsed();
        all.iter().map(|one| Ok(self.encode(one, generation_time)?.1)).collect()
    }

    async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        Ok(self.represent(params).map(|(_, time)| time))
    }

    async fn measure(
        &mut self,
        params: &[GenerationParams],
        batches: u32,
    ) -> Result<Vec<Result<Measured, Invalid>>, TrialError> {
        let batches = batches.min(self.batches());
        Ok(params.iter().map(|p| self.one(p, batches)).collect())
    }
}
