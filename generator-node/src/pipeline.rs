//! The pipeline: complete steps become reduced volumes or Volumetric Depth Images, in order, one at a time.

use crate::group::{Door, GroupArrived, GroupField, Root};
use crate::ingest::{CompleteStep, Ingest, RunSpec};
use crate::node_state::NodeState;
use crate::overhead::Coupling;
use crate::rate_control::{Rung, generate_within, start_params};
use crate::step::{FieldSource, Purpose, Step};
use lamina_compute::{Activity, Laps, Priority};
use lamina_model::suggest::{suggest, suggest_camera};
use lamina_model::{GenerationParams, Grid, Invalid, RunInfo, Scene, StepReport};
use lamina_raycast::Field;
use parking_lot::Mutex;
use std::sync::Arc;
use tokio::sync::watch;

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

/// Where whole steps come from.
pub(crate) enum Steps {
    /// From the ranks that bring their bricks to this node.
    Own(Arc<Ingest>),
    /// From the members of a group.
    Group(Arc<Root>, Arc<Door>),
}

/// A whole step.
enum Arrived {
    Own(CompleteStep),
    Group(Arc<Root>, GroupArrived),
}

impl Steps {
    /// Waits until there is one.
    async fn wait(&self) {
        match self {
            Self::Own(ingest) => ingest.complete().await,
            Self::Group(_, door) => door.whole().await,
        }
    }

    /// The one to be worked on now.
    fn take(&self) -> Option<Arrived> {
        match self {
            Self::Own(ingest) => ingest.take().map(Arrived::Own),
            Self::Group(root, door) => Some(Arrived::Group(root.clone(), door.take()?)),
        }
    }
}

impl Arrived {
    /// Run id, step, time, steps dropped so far.
    fn numbers(&self) -> (&str, u64, f64, u64) {
        match self {
            Self::Own(step) => (&step.run_id, step.step, step.time, step.dropped_steps),
            Self::Group(_, step) => (&step.run_id, step.step, step.time, step.dropped_steps),
        }
    }

    fn spec(&self) -> &RunSpec {
        match self {
            Self::Own(step) => &step.spec,
            Self::Group(_, step) => &step.spec,
        }
    }
}

/// Turns steps into frames, until `stop` is true and none is left.
pub(crate) async fn run(
    steps: Steps,
    node: Arc<NodeState>,
    reference_every: u64,
    live_batches: u32,
    mut stop: watch::Receiver<bool>,
) {
    let pipeline =
        Pipeline { node: node.clone(), reference_every, live_batches, run: None, start: None, rung: Rung::default() };
    let pipeline = Arc::new(Mutex::new(pipeline));
    loop {
        tokio::select! {
            biased;
            () = steps.wait() => {}
            _ = stop.wait_for(|stop| *stop) => return,
        }
        let permit = node.share.acquire(Priority::LiveStep).await;
        // By now a newer one may be there.
        let Some(step) = steps.take() else { continue };
        let ((_, number, ..), pipeline) = (step.numbers(), pipeline.clone());
        let work = move |laps: &mut Laps| pipeline.lock().process(step, laps);
        match permit.run(Activity::Generate, work).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(step = number, %error, "step not generated"),
            Err(panic) => tracing::error!(step = number, %panic, "step not generated"),
        }
    }
}

impl Pipeline {
    fn process(&mut self, step: Arrived, laps: &mut Laps) -> Result<(), Invalid> {
        let (_, number, _, dropped_steps) = step.numbers();
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

    fn prepare(&mut self, step: Arrived) -> Result<Step, Invalid> {
        let (run_id, number, time, _) = step.numbers();
        let RunSpec { name, field, grid, scene: stated, .. } = step.spec().clone();
        let known = self.run.take().filter(|(run, _)| run.id == run_id);
        let description = RunInfo { id: run_id.to_owned(), name, field, grid };
        if known.is_none() {
            self.node.restart();
            self.start = None;
        }
        // One scene for the whole run, so that its steps can be compared.
        let scene = known.as_ref().map(|(_, scene)| scene.clone()).or(stated);
        let run = known.map_or_else(|| Arc::new(description), |(run, _)| run);
        let (source, scene) = match step {
            Arrived::Own(step) => {
                let volume = step.into_volume()?;
                let scene = scene.map_or_else(|| suggest(&[&volume]), Ok)?;
                (FieldSource::Own(self.node.backend.clone(), Box::new(Field::new(volume, &scene))), scene)
            }
            Arrived::Group(root, GroupArrived { spec, step, members, .. }) => {
                let coarse = || root.coarse(step, &spec, &members).and_then(|volume| suggest(&[&volume]));
                let scene = match scene {
                    Some(scene) => scene,
                    None => whole_view(coarse()?, &spec.grid)?,
                };
                (FieldSource::Group(Box::new(GroupField::prepare(&root, step, &spec, scene.clone(), members)?)), scene)
            }
        };
        self.run = Some((run.clone(), scene));
        if source.empty_voxels() > 0 {
            tracing::warn!(step = number, voxels = source.empty_voxels(), "NaN or infinite voxels, drawn as empty");
        }
        Ok(Step::new(run, (number, time), self.node.segmentation, source))
    }
}

/// A scene chosen from a coarse volume, with a camera that sees all of `grid`, of which the coarse one may lack the last points; its
/// opacities refer to a length of the whole grid.
fn whole_view(scene: Scene, grid: &Grid) -> Result<Scene, Invalid> {
    let transfer = scene.transfer.with_unit_length(scene.transfer.unit_length(grid));
    Ok(Scene { camera: suggest_camera(&grid.bounds())?, transfer, ..scene })
}
