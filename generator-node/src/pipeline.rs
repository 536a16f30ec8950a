//! The pipeline: complete steps become reduced volumes or Volumetric Depth Images, in order, one at a time.

use crate::arrival::{Arrived, Steps};
use crate::config::Config;
use crate::group::{GroupArrived, GroupField};
use crate::ingest::RunSpec;
use crate::key_frames::{KeyFrames, SentStep};
use crate::node_state::NodeState;
use crate::overhead::Coupling;
use crate::rate_control::{GeneratedStep, Rungs, copy_within, generate_within, start_params};
use crate::spans;
use crate::steering::{Changes, SteeringRelay};
use crate::step::{FieldSource, Purpose, Step};
use crate::triggers::{Statistics, Triggers, Webhook, Word, write_copy, write_picture, write_raw};
use lamina_codec::EncodedStep;
use lamina_compute::{Activity, Laps, Priority};
use lamina_model::suggest::{suggest, suggest_camera};
use lamina_model::{
    Cost, GenerationParams, Grid, Invalid, RunInfo, Scene, Steering, SteeringRequest, StepReport, TriggerAction,
    TriggerSpec, Voxels,
};
use lamina_raycast::Field;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace};
use parking_lot::Mutex;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::sync::watch;

/// What the configuration says of the pipeline.
pub(crate) struct Settings {
    /// It, for what changes in it.
    pub config: watch::Receiver<Config>,
    /// Conditions over each step.
    pub triggers: Arc<Mutex<Triggers>>,
    /// Folder for the raw steps that they ask for.
    pub trigger_folder: PathBuf,
    pub webhook: Option<Webhook>,
    /// Through which they ask the simulation.
    pub steering: Arc<SteeringRelay>,
}

/// The pipeline's own memory from step to step.
struct Pipeline {
    node: Arc<NodeState>,
    settings: Settings,
    run: Option<ShownRun>,
    /// What steps are generated with until the tuner sends parameters.
    start: Option<GenerationParams>,
    rungs: Rungs,
    key_frames: KeyFrames,
    /// Whether the last step had missing values.
    had_empty_voxels: bool,
}

/// The run that is shown.
struct ShownRun {
    /// As the simulation has it.
    id: String,
    /// As viewers have it: another one with every change that somebody asks for.
    info: Arc<RunInfo>,
    changes: u32,
    scene: Scene,
}

/// The run of the next step.
struct NextRun {
    id: String,
    info: Arc<RunInfo>,
    changes: Changes,
    is_new: bool,
}

/// What triggers see of a step: statistics, and its voxels where they may be asked for.
type Seen = (Statistics, Option<Voxels>);

/// What triggers that fired leave to be done.
#[derive(Default)]
struct Pulled {
    names: Vec<String>,
    /// Degrees that pictures are turned by.
    angles: Vec<f64>,
    /// The most kilobytes of the copy that is asked for.
    copy_kb: Option<u32>,
}

/// Turns steps into frames, until `stop` is true and none is left.
pub(crate) async fn run(steps: Steps, node: Arc<NodeState>, settings: Settings, mut stop: watch::Receiver<bool>) {
    // At 0 from the start on, so that what watches sees the first time, too.
    node.counters.fired.lock().extend(settings.triggers.lock().names().map(|name| (name.to_owned(), 0)));
    let (rungs, key_frames) = (Rungs::default(), KeyFrames::default());
    let pipeline =
        Pipeline { node: node.clone(), settings, run: None, start: None, rungs, key_frames, had_empty_voxels: false };
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
        let failure = match permit.run(Activity::Generate, work).await {
            Ok(Ok(())) => continue,
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic.to_string(),
        };
        node.counters.failed_steps.fetch_add(1, Ordering::Relaxed);
        tracing::error!(step = number, failure, "step not generated");
    }
}

impl Pipeline {
    fn process(&mut self, step: Arrived, laps: &mut Laps) -> Result<(), Invalid> {
        let (_, number, _, dropped_steps) = step.numbers();
        let mut timeline = Timeline::since(step.completed());
        timeline.lap("wait", []);
        let (step, seen) = self.prepare(step)?;
        timeline.lap("prepare", []);
        let step = Arc::new(step);
        let setting = self.node.begin(&step);
        let coupling = self.node.coupling();
        let cheaper =
            coupling.cheaper.checked_sub(1).and_then(|n| setting.fallbacks.get(n).or(setting.fallbacks.last()));
        let wanted = cheaper
            .copied()
            .or(setting.params)
            .or(self.start)
            .unwrap_or_else(|| start_params(&step, setting.only_vdis));
        let (run_id, key_wanted) = (&step.run.id, self.node.publisher.take_key_wanted());
        let before = self.key_frames.predecessor((run_id, dropped_steps), wanted, &setting, key_wanted);
        let searched = (&mut *laps, &mut self.rungs);
        let made = generate_within(&step, wanted, &setting, before.as_ref(), &self.node.options, searched)?;
        let GeneratedStep { params, encoded: EncodedStep { bytes, cost, reference }, fell_back } = made;
        timeline.lap("generate and encode", spans::of_generated(&params, &cost));
        let before = before.map(|before| before.step);
        let has_predecessor = before.is_some();
        let sent =
            SentStep { run_id, step: number, dropped_steps, has_predecessor, wanted, params, bytes: &bytes, reference };
        let is_after = self.key_frames.sent(sent);
        let after_step = before.filter(|_| is_after);
        if setting.params.is_none() {
            // The next step begins with what fitted.
            self.start = Some(params);
        }
        let Pulled { names: triggers, angles, copy_kb } =
            seen.map_or_else(Pulled::default, |seen| self.pull_triggers(&step, seen, &cost));
        let (mut items, mut has_reference) = (Vec::new(), false);
        let Config { reference_every: every, live_batches, .. } = *self.settings.config.borrow();
        if every > 0 && number.is_multiple_of(every) {
            match step.live_reference(&self.node.plan, live_batches) {
                Ok(reference) => {
                    items.push(reference);
                    has_reference = true;
                    timeline.lap("reference", []);
                }
                Err(error) => tracing::error!(step = number, %error, "no reference samples"),
            }
        }
        laps.lap(Activity::Generate);
        let Coupling { overhead, throttle, .. } = coupling;
        let purpose = Purpose::Live { after_step, dropped_steps, setting: &setting, overhead, throttle, triggers };
        items.push(step.frame(&params, cost, bytes, purpose));
        self.node.publisher.publish(items);
        timeline.lap("publish", []);
        for angle in angles {
            self.keep_picture(&step, angle);
            timeline.lap("picture", []);
            laps.lap(Activity::Generate);
        }
        if let Some(kilobytes) = copy_kb {
            self.keep_copy(&step, kilobytes, laps);
            timeline.lap("copy", []);
        }
        let traced = Trace::of_step(Role::Generator, &step.run.id, number);
        timeline.send_first(
            traced,
            "step",
            [("lamina.run_id", step.run.id.clone().into()), ("lamina.step", (number as i64).into())],
        );
        let counters = &self.node.counters;
        counters.size_bytes.observe(cost.size_bytes as f64);
        counters.generation_secs.observe(cost.generation.as_secs_f64());
        counters.encode_secs.observe(cost.encode.as_secs_f64());
        let report = StepReport {
            run_id: step.run.id.clone(),
            step: number,
            time: step.time,
            params,
            cost,
            fell_back: fell_back || setting.params.is_some_and(|set| set != wanted),
            has_reference,
            is_after_another: after_step.is_some(),
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

    /// Casts and writes the picture that a trigger asks for.
    fn keep_picture(&self, step: &Step, angle_deg: f64) {
        match step.picture(angle_deg, self.node.plan.image_size) {
            Ok(image) => write_picture(self.settings.trigger_folder.clone(), &step.run, step.step, angle_deg, image),
            Err(error) => tracing::error!(step = step.step, %error, "no picture for a trigger"),
        }
    }

    /// Generates and writes the copy that a trigger asks for.
    fn keep_copy(&self, step: &Step, kilobytes: u32, laps: &mut Laps) {
        match copy_within(step, 1000 * u64::from(kilobytes), &self.node.options, laps) {
            Ok(copy) => write_copy(self.settings.trigger_folder.clone(), &step.run, step.step, copy.bytes),
            Err(error) => tracing::error!(step = step.step, %error, "no copy for a trigger"),
        }
    }

    /// What the triggers are to see of a step, if there are any.
    fn look_at(&self, voxels: &Voxels) -> Option<Seen> {
        let wants_voxels = {
            let triggers = self.settings.triggers.lock();
            (!triggers.is_empty()).then(|| triggers.wants_voxels())?
        };
        Some((Statistics::of(voxels), wants_voxels.then(|| voxels.clone())))
    }

    /// Looks at a step for the triggers; does what those that fire ask for, as far as it is not to be done once the step is on its way.
    fn pull_triggers(&mut self, step: &Step, (statistics, mut voxels): Seen, cost: &Cost) -> Pulled {
        let mut pulled = Pulled::default();
        let Settings { triggers, trigger_folder, webhook, steering, .. } = &self.settings;
        let fired =
            triggers.lock().evaluate(&step.run.id, (step.step, step.time), &statistics, cost, step.diagnostics());
        for TriggerSpec { name, when, actions, copy_kb, angles } in fired {
            tracing::warn!(step = step.step, trigger = name, "trigger fired");
            *self.node.counters.fired.lock().entry(name.clone()).or_default() += 1;
            for action in &actions {
                let ask = |request| {
                    let asked = steering.steer(&step.run.id, Steering { request, asked_by: format!("trigger {name}") });
                    asked
                        .unwrap_or_else(|error| tracing::warn!(trigger = name, %error, "the simulation was not asked"));
                };
                match action {
                    TriggerAction::Pause => ask(SteeringRequest::Pause),
                    TriggerAction::Stop => ask(SteeringRequest::Stop),
                    // Once, however many ask for it.
                    TriggerAction::Raw => {
                        if let Some(voxels) = voxels.take() {
                            write_raw(trigger_folder.clone(), &step.run, step.step, voxels);
                        }
                    }
                    TriggerAction::Picture if angles.is_empty() => pulled.angles.push(0.0),
                    TriggerAction::Picture => pulled.angles.extend(&angles),
                    // One, the finest.
                    TriggerAction::Copy => pulled.copy_kb = pulled.copy_kb.max(copy_kb),
                    TriggerAction::Webhook => {
                        if let Some(webhook) = webhook {
                            webhook.send(word(step, &name, &when));
                        }
                    }
                }
            }
            pulled.names.push(name);
        }
        // From each direction once, however many ask for it.
        pulled.angles.sort_by(f64::total_cmp);
        pulled.angles.dedup();
        if pulled.angles.len() > TriggerSpec::MOST_ANGLES {
            tracing::warn!(
                step = step.step,
                "pictures from {} directions are left out",
                pulled.angles.len() - TriggerSpec::MOST_ANGLES
            );
            pulled.angles.truncate(TriggerSpec::MOST_ANGLES);
        }
        pulled
    }

    fn prepare(&mut self, step: Arrived) -> Result<(Step, Option<Seen>), Invalid> {
        let ((run_id, number, time, _), spec) = (step.numbers(), step.spec().clone());
        let (NextRun { id, info, changes, is_new }, scene, before) = self.next_run(run_id, &spec);
        let shown = spec.shown_fields(&info.field, scene.as_ref())?;
        let chosen = |scene| changes.all.apply(beside(scene, before.as_ref()));
        let (lost_ranks, diagnostics, seen);
        let mut derivation = Duration::ZERO;
        let (source, scene) = match step {
            Arrived::Own(step) => {
                (lost_ranks, diagnostics) = (step.lost_ranks.clone(), step.remarks.diagnostics.clone());
                let volume;
                (volume, derivation) = step.into_volume(&shown)?;
                seen = self.look_at(volume.voxels());
                let scene = scene.map_or_else(|| suggest(&[&volume]).map(chosen), Ok)?;
                (FieldSource::Own(self.node.backend.clone(), Box::new(Field::new(volume, &scene))), scene)
            }
            Arrived::Group(
                root,
                GroupArrived { run_id, spec, step, members, lost_ranks: lost, diagnostics: told, .. },
            ) => {
                let step = (&*run_id, step);
                (lost_ranks, diagnostics) = (lost, told);
                let scene = match scene {
                    Some(scene) => scene,
                    None => {
                        let scene = suggest(&[&root.coarse(step, (&spec, &shown), &members)?])?;
                        chosen(whole_view(scene, &spec.grid)?)
                    }
                };
                let has_triggers = !self.settings.triggers.lock().is_empty();
                let of_run = (&spec, &*info.field, has_triggers);
                let mut of_members = GroupField::prepare(&root, step, of_run, scene.clone(), members)?;
                seen = of_members.take_statistics().map(|statistics| (statistics, None));
                (FieldSource::Group(Box::new(of_members)), scene)
            }
        };
        if is_new {
            self.settings.steering.begin(&info, &spec, &scene);
        }
        self.run = Some(ShownRun { id, info: info.clone(), changes: changes.count, scene });
        let empty = source.empty_voxels();
        // A mask has them in every step, and is told of once.
        if empty > 0 && (is_new || !self.had_empty_voxels) {
            tracing::warn!(
                step = number,
                voxels = empty,
                "NaN or infinite voxels, drawn as empty; steps.csv counts them"
            );
        }
        self.had_empty_voxels = empty > 0;
        let step = Step::new(info, (number, time), self.node.segmentation, source);
        self.node.counters.diagnostics.lock().clone_from(&diagnostics);
        Ok((step.without(lost_ranks).with_diagnostics(diagnostics).derived_in(derivation), seen))
    }

    /// The run of the next step, its scene if that is known, and the scene that it had before another field was chosen.
    fn next_run(&mut self, id: &str, spec: &RunSpec) -> (NextRun, Option<Scene>, Option<Scene>) {
        let known = self.run.take().filter(|run| run.id == id);
        let Changes { count, all } = self.settings.steering.changes(id).unwrap_or_default();
        let (scene, before) = match known {
            // One scene for the whole run, so that its steps can be compared.
            Some(run) if run.changes == count => {
                let next = NextRun { id: run.id, info: run.info, changes: Changes { count, all }, is_new: false };
                return (next, Some(run.scene), None);
            }
            Some(run) if all.field.as_ref().is_none_or(|field| *field == run.info.field) => {
                (Some(all.apply(run.scene)), None)
            }
            Some(run) => (None, Some(run.scene)),
            None => (None, None),
        };
        self.node.restart();
        self.start = None;
        let field = all.field.clone().unwrap_or_else(|| spec.shown().to_owned());
        // What the simulation states is of its own field.
        let stated = || spec.scene.clone().filter(|_| field == spec.shown()).map(|scene| all.apply(scene));
        let scene = scene.or_else(stated);
        let info = RunInfo { id: RunInfo::shown_id(id, count), name: spec.name.clone(), field, grid: spec.grid };
        let changes = Changes { count, all };
        (NextRun { id: id.to_owned(), info: Arc::new(info), changes, is_new: true }, scene, before)
    }
}

/// A scene chosen for another field of a run, seen as the one `before` was: of its effects without those that are of its values.
fn beside(chosen: Scene, before: Option<&Scene>) -> Scene {
    let Some(Scene { camera, background, step_voxels, effects, .. }) = before.cloned() else { return chosen };
    Scene { camera, background, step_voxels, effects: effects.of_any_field(), ..chosen }
}

/// A scene chosen from a coarse volume, with a camera that sees all of `grid`, of which the coarse one may lack the last points; its
/// opacities refer to a length of the whole grid.
fn whole_view(scene: Scene, grid: &Grid) -> Result<Scene, Invalid> {
    let transfer = scene.transfer.with_unit_length(scene.transfer.unit_length(grid));
    Ok(Scene { camera: suggest_camera(&grid.bounds())?, transfer, ..scene })
}

/// What is told of the trigger `name`, which fired at `step`.
fn word(step: &Step, name: &str, when: &str) -> Word {
    let (run, number, time) = (&step.run, step.step, step.time);
    Word {
        // What chat services take for markup is left out.
        text: format!("{}: trigger {name} fired at step {number}, time {time}", run.name.replace(['<', '>', '&'], " ")),
        trigger: name.to_owned(),
        when: when.to_owned(),
        run: run.id.clone(),
        field: run.field.clone(),
        step: number,
        time,
        diagnostics: step.diagnostics().clone(),
    }
}
