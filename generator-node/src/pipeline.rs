//! The pipeline: complete steps become reduced volumes or Volumetric Depth Images, in order, one at a time.

use crate::ingest::{CompleteStep, Ingest};
use crate::node_state::NodeState;
use crate::overhead::Coupling;
use crate::rate_control::{Rung, generate_within, start_params};
use crate::step::{Purpose, Step};
use lamina_compute::{Activity, Laps, Priority};
use lamina_model::{GenerationParams, Invalid, RunInfo, Scene, StepReport, suggest::suggest};
use lamina_raycast::Field;
use parking_lot::Mutex;
use std::sync::Arc;

/// The pipeline's own memory from step to step.
struct Pipeline {
    node: Arc<NodeState>,
    reference_every: u64,
    /// Batches of sampled pixels that live steps are compared at; 0 for all.
    live_batches: u32,
    run: Option<(Arc<RunInfo>, Scene)>,
    /// What steps are generated with until the tuner sends parameters.
    start: Option<GenerationParams>,
    rung: Rung,
}

/// Turns steps into frames for ever.
pub(crate) async fn run(ingest: Arc<Ingest>, node: Arc<NodeState>, reference_every: u64, live_batches: u32) {
    let pipeline =
        Pipeline { node: node.clone(), reference_every, live_batches, run: None, start: None, rung: Rung::default() };
    let pipeline = Arc::new(Mutex::new(pipeline));
    loop {
        ingest.complete().await;
        let permit = node.share.acquire(Priority::LiveStep).await;
        // By now a newer one may be there.
        let Some(step) = ingest.take() else { continue };
        let (number, pipeline) = (step.step, pipeline.clone());
        let work = move |laps: &mut Laps| pipeline.lock().process(step, laps);
        match permit.run(Activity::Generate, work).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(step = number, %error, "step not generated"),
            Err(panic) => tracing::error!(step = number, %panic, "step not generated"),
        }
    }
}

impl Pipeline {
    fn process(&mut self, step: CompleteStep, laps: &mut Laps) -> Result<(), Invalid> {
        let (number, dropped_steps) = (step.step, step.dropped_steps);
        let step = Arc::new(self.prepare(step)?);
        let setting = self.node.begin(&step);
        let coupling = self.node.coupling();
        let cheaper =
            coupling.cheaper.checked_sub(1).and_then(|n| setting.fallbacks.get(n).or(setting.fallbacks.last()));
        let first = cheaper
            .copied()
            .or(setting.params)
            .or(self.start)
            .unwrap_or_else(|| start_params(&step, setting.only_vdis));
        let (params, bytes, cost) = generate_within(&step, first, &setting, &self.node.options, laps, &mut self.rung)?;
        if setting.params.is_none() {
            // The next step begins with what fitted.
            self.start = Some(params);
        }
        let (mut items, mut has_reference) = (Vec::new(), false);
        if self.reference_every > 0 && number.is_multiple_of(self.reference_every) {
            match step.live_reference(&self.node.plan, self.live_batches) {
                Ok(reference) => {
                    items.push(reference);
                    has_reference = true;
                }
                Err(error) => tracing::error!(step = number, %error, "no reference samples"),
            }
        }
        laps.lap(Activity::Generate);
        let Coupling { overhead, throttle, .. } = coupling;
        let purpose = Purpose::Live { dropped_steps, setting: &setting, overhead, throttle };
        items.push(step.frame(&params, cost, bytes, purpose));
        self.node.publisher.publish(items);
        let report = StepReport {
            run_id: step.run.id.clone(),
            step: number,
            time: step.time,
            params,
            cost,
            fell_back: setting.params.is_some_and(|set| set != params),
            has_reference,
        };
        tracing::info!(
            step = number,
            resolution = params.resolution(),
            gamma = params.gamma(),
            bytes = cost.size_bytes,
            ms = cost.generation.as_millis() as u64,
            "generated"
        );
        self.node.report(report);
        Ok(())
    }

    fn prepare(&mut self, step: CompleteStep) -> Result<Step, Invalid> {
        let (run_id, number, time) = (step.run_id.clone(), step.step, step.time);
        let description = RunInfo {
            id: run_id.clone(),
            name: step.spec.name.clone(),
            field: step.spec.field.clone(),
            grid: step.spec.grid,
        };
        let stated = step.spec.scene.clone();
        let volume = step.into_volume()?;
        let known = self.run.take().filter(|(run, _)| run.id == run_id);
        let (run, scene) = match known {
            Some(known) => known,
            None => {
                self.node.restart();
                self.start = None;
                // One scene for the whole run, so that its steps can be compared.
                let scene = stated.map_or_else(|| suggest(&[&volume]), Ok)?;
                (Arc::new(description), scene)
            }
        };
        self.run = Some((run.clone(), scene.clone()));
        let field = Field::new(volume, &scene);
        if field.empty_voxels() > 0 {
            tracing::warn!(step = number, voxels = field.empty_voxels(), "NaN or infinite voxels, drawn as empty");
        }
        Ok(Step::new(run, (number, time), (self.node.backend.clone(), self.node.segmentation), field))
    }
}
