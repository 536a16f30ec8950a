//! Trials in this process: both nodes' kernels on one step, without sockets.

use super::cache::{Cache, Spent, Trial as Recorded};
use crate::parts::prepare;
use crate::process;
use lamina_cast::{Backend, Field, most_points};
use lamina_model::{
    GenerationParams, Intermediate, Invalid, Quality, ReferenceSamples, SamplePlan, Scene, Segmentation, Volume,
};
use lamina_tuner::trial::{Cost, Measured, Trial, TrialError};
use lamina_viz_node::kernel::{self as viz, Detail, Prepared};
use lamina_wire::codec::{self, DecodeLimits, EncodeOptions};
use std::time::{Duration, Instant};

/// Generations that all together take longer are not timed again.
const SHORT: Duration = Duration::from_millis(500);

/// Measures on one field; what the cache holds is not measured again.
pub struct Local {
    step: u64,
    field: Field,
    segmentation: Segmentation,
    backend: Backend,
    viewer: viz::Backend,
    reference: ReferenceSamples,
    /// How often a generation is timed.
    times: u32,
    cache: Cache,
    /// What was measured last, for further batches.
    held: Option<(GenerationParams, Prepared)>,
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
        Ok(Self { step, field, segmentation, backend, viewer, reference, times: 1, cache, held: None })
    }

    /// The same, every generation timed so often, where that is short: the least counts.
    #[must_use]
    pub fn timed(self, times: u32) -> Self {
        Self { times, ..self }
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
    pub fn shown(&self, params: &GenerationParams) -> Result<Prepared, Invalid> {
        let (intermediate, generation_time) = self.represent(params, 1)?;
        let (bytes, _) = encode(&intermediate, generation_time)?;
        Ok(Prepared::new(codec::decode_any(&bytes, &DecodeLimits::default())?))
    }

    /// Generates and encodes; what was encoded is what will be looked at.
    fn generate(&mut self, params: &GenerationParams, times: u32) -> Result<(Cost, Spent), Invalid> {
        let start = clock();
        let (intermediate, generation_time) = self.represent(params, times)?;
        let generated = clock();
        let (bytes, cost) = encode(&intermediate, generation_time)?;
        let encoded = clock();
        let decoded = codec::decode_any(&bytes, &DecodeLimits::default())?;
        self.held = Some((*params, Prepared::new(decoded)));
        let ns = |from: Duration, to: Duration| to.saturating_sub(from).as_nanos() as u64;
        let spent = Spent {
            generate_ns: ns(start, generated),
            encode_ns: ns(generated, encoded),
            decode_ns: ns(encoded, clock()),
            quality_ns: 0,
        };
        Ok((cost, spent))
    }

    /// With the least of several times, where they are short: what else a machine does only ever adds.
    fn represent(&self, params: &GenerationParams, times: u32) -> Result<(Intermediate, Duration), Invalid> {
        let once = || self.backend.represent(&self.field, params, self.segmentation);
        let start = Instant::now();
        let (intermediate, mut least) = once()?;
        for _ in 1..times {
            if start.elapsed() < SHORT {
                least = least.min(once()?.1);
            }
        }
        Ok((intermediate, least))
    }

    fn one(&mut self, params: &GenerationParams, batches: u32) -> Result<Measured, Invalid> {
        let mut trial = match self.cache.get(params) {
            Some(known) if known.quality.batches() as u32 >= batches => return Ok(measured(known)),
            Some(known) => known.clone(),
            None => {
                let (cost, spent) = self.generate(params, self.times)?;
                Recorded { params: *params, cost, spent, quality: Quality::default() }
            }
        };
        if (trial.quality.batches() as u32) < batches {
            if self.held.as_ref().is_none_or(|(held, _)| held != params) {
                let (_, again) = self.generate(params, 1)?;
                trial.spent.add(&again);
            }
            let start = clock();
            if let Some((_, shown)) = &self.held {
                let more = trial.quality.batches() as u32..batches;
                let quality = self.viewer.quality(shown, &self.reference, more, Detail::Blended)?;
                trial.quality.extend(&quality)?;
            }
            trial.spent.quality_ns += clock().saturating_sub(start).as_nanos() as u64;
        }
        let answer = measured(&trial);
        self.cache.put(trial).map_err(|e| Invalid::new("cache", e.to_string()))?;
        Ok(answer)
    }
}

/// Its bytes, with what they cost.
fn encode(intermediate: &Intermediate, generation_time: Duration) -> Result<(Vec<u8>, Cost), Invalid> {
    let (bytes, [generation_time, encode_time]) =
        codec::encode_timed(intermediate, generation_time, &EncodeOptions::default())?;
    let (size_bytes, supersegments) = (bytes.len() as u64, intermediate.elements());
    Ok((bytes, Cost { size_bytes, generation_time, encode_time, supersegments }))
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
        all.iter().map(|one| Ok(encode(one, generation_time)?.1)).collect()
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
