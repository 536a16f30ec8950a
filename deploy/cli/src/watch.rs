//! `live` and `replay`: a source of steps, coupled through the client to the nodes.

use crate::cli;
use crate::nodes::{Nodes, Setup, Tuning};
use crate::offline;
use crate::pacer::Pacer;
use crate::run_folder::RunFolder;
use crate::source::{Example, Recorded, Source, read_options};
use crate::steering;
use anyhow::{Context, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use lamina_client::{Brick, Client, ClientError, FullPolicy, RunOptions, SteerableNumber};
use lamina_compute::{CpuLimit, CpuShare};
use lamina_model::{Representation, Scene, TuningState, Volume};
use lamina_tuner::Contract;
use lamina_tuner::units::show_bytes;
use lamina_viz_node::store::{QualityStatus, StepRow};
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// `lamina live`.
pub fn live(arguments: &cli::Live) -> anyhow::Result<()> {
    let watch = &arguments.watch;
    ensure!(!watch.headless || watch.steps.is_some(), "live --headless never ends by itself; say how many --steps");
    let cli::Live { cells, seed, terms, threads, .. } = arguments;
    let mut source = Example::new(*cells, *seed, terms, *threads, watch.scene.as_deref())?;
    // A live simulation does not wait for its viewer, unless every step is to be recorded.
    let (policy, pace) =
        if watch.headless { (FullPolicy::Block, UNPACED) } else { (FullPolicy::DropOldest, arguments.pace) };
    run(&mut source, watch, policy, pace)
}

/// As fast as it goes.
const UNPACED: cli::StepsPerSecond = cli::StepsPerSecond(0.0);

/// `lamina replay`.
pub fn replay(arguments: &cli::Replay) -> anyhow::Result<()> {
    let watch = &arguments.watch;
    let mut source = Recorded::open(&arguments.input, &read_options(&arguments.raw), watch.scene.as_deref())?;
    match arguments.pace {
        Some(pace) => run(&mut source, watch, FullPolicy::DropOldest, pace),
        None => run(&mut source, watch, FullPolicy::Block, UNPACED),
    }
}

fn run(
    source: &mut dyn Source,
    options: &cli::Watch,
    policy: FullPolicy,
    pace: cli::StepsPerSecond,
) -> anyhow::Result<()> {
    let waits = policy == FullPolicy::Block;
    let overhead = options.contract.as_ref().and_then(|c| c.limits.overhead);
    ensure!(
        !waits || overhead.is_none(),
        "contract: overhead: a series that waits for the nodes has no pace to lose; leave it out, or give --pace"
    );
    let steps = [options.steps, source.step_count()].into_iter().flatten().min();
    let first = source.next()?.context("the series is empty")?;
    match &options.generator {
        Some(generator) => push_only(source, first, steps, generator.clone(), policy, pace),
        None => watch(source, first, steps, options, policy, pace),
    }
}

/// Connects as a simulation does.
pub fn connect(
    source: &dyn Source,
    volume: &Volume,
    generator: &str,
    policy: FullPolicy,
    steering: Option<Vec<SteerableNumber>>,
) -> Result<Client, ClientError> {
    let options = RunOptions {
        full_policy: policy,
        steering,
        scene: Some(source.scene().clone()),
        // Blocking is consent to wait: for as long as a study of the tuner may take.
        deadline: if policy == FullPolicy::Block { Duration::from_secs(600) } else { Duration::from_secs(5) },
        color_field: volume.color_field().map(|(name, voxels)| (name.to_owned(), voxels.voxel_type())),
        ..RunOptions::new(generator, source.name(), source.field(), *volume.grid(), volume.voxels().voxel_type())
    };
    Client::connect(options)
}

/// Hands over a whole step.
pub fn push(client: &mut Client, step: u64, time: f64, volume: &Volume) -> Result<(), ClientError> {
    let brick = Brick::new([0; 3], volume.grid().dims(), volume.voxels());
    let brick = volume.color_field().map_or(brick, |(_, voxels)| brick.with_colors(voxels));
    client.push(step, time, &brick).map(drop)
}

/// Only the simulation: the nodes run elsewhere.
fn push_only(
    source: &mut dyn Source,
    first: (f64, Volume),
    steps: Option<u64>,
    generator: String,
    policy: FullPolicy,
    pace: cli::StepsPerSecond,
) -> anyhow::Result<()> {
    let mut client = connect(source, &first.1, &generator, policy, Some(steering::numbers(pace)))?;
    let mut next = Some(first);
    let (mut step, mut pacer) = (0, Pacer::new(pace));
    while let Some((time, volume)) = next.filter(|_| steps.is_none_or(|n| step < n)) {
        pacer.wait(&|| false);
        if steering::obey(&mut client, &mut pacer, &|| false, || Ok(()))? {
            break;
        }
        match push(&mut client, step, time, &volume) {
            Ok(()) => say!("step {step:4}  time {time:.4}  pushed"),
            Err(error @ (ClientError::Invalid(_) | ClientError::Refused(_))) => return Err(error.into()),
            // The simulation goes on; the client tries again by itself.
            Err(error) => say!("step {step:4}  time {time:.4}  lost: {error}"),
        }
        step += 1;
        next = timed(source, &mut pacer)?;
    }
    let summary = client.close();
    let dropped = summary.run_dropped_steps.unwrap_or(summary.dropped);
    say!("the simulation made {}", pacer.speed());
    say!("pushed {}  dropped {dropped}  lost {}", summary.pushed, summary.lost);
    anyhow::ensure!(summary.pushed > 0 || summary.lost == 0, "no step got through; is a generator-node running there?");
    Ok(())
}

/// The next step, and what it took.
fn timed(source: &mut dyn Source, pacer: &mut Pacer) -> anyhow::Result<Option<(f64, Volume)>> {
    let begun = Instant::now();
    let next = source.next()?;
    pacer.computed(begun.elapsed());
    Ok(next)
}

/// Processor time of the nodes: what the user grants, or a quarter of the cores for the generator-node and one for the viz-node;
/// all there is where every step waits for them.
fn share(options: &cli::Watch) -> anyhow::Result<CpuShare> {
    let unlimited = options.headless;
    Ok(if unlimited {
        CpuShare::unlimited()?
    } else {
        CpuShare::new(options.cpu_share.unwrap_or_else(|| CpuLimit::default().doubled()))?
    })
}

fn setup(options: &cli::Watch, scene: &Scene, volume: &Volume) -> anyhow::Result<Setup> {
    let fixed = options.resolution.zip(options.gamma);
    let representation = options.representation.first().copied().unwrap_or_default();
    let params = |(resolution, gamma)| offline::params(representation, resolution, gamma, 1.0, scene);
    let contract = options.contract.clone().unwrap_or_default();
    let angles_deg = contract.angles_deg();
    // The cone is a matter of where quality is measured.
    let contract = Contract { cone_deg: None, ..contract };
    let tuning = Tuning {
        contract,
        representations: options.representation.clone(),
        grid: options.grid,
        retune_every: options.retune_every,
        // Without a viewer every step waits for its tuning.
        budget: if options.headless { 1.0 } else { lamina_tuner::Config::default().budget },
    };
    let untuned = fixed.and(options.representation.first());
    let vdis =
        untuned.map_or_else(|| options.representation.contains(&Representation::Vdi), |r| *r == Representation::Vdi);
    if let Some(second) = scene.effects.color_field.as_ref().filter(|_| !vdis) {
        bail!(
            "--representation: a reduced volume holds one field, and colors come from \"{}\"; allow vdi",
            second.name
        );
    }
    // In work, each field and its colors take four bytes a voxel.
    let voxels = volume.grid().voxels() as u64 * (1 + u64::from(volume.color_field().is_some()));
    Ok(Setup {
        insecure: options.insecure,
        viewer: if options.headless { SocketAddr::from((Ipv4Addr::LOCALHOST, 0)) } else { options.viewer },
        store: options.out.as_ref().map(|dir| dir.join("vdi")),
        backend: options.backend,
        angles_deg,
        // Room for two waiting steps: more would only show the past.
        memory_bytes: 4 * volume.size_bytes() as u64 + 12 * voxels + (1 << 20),
        params: fixed.map(params).transpose()?,
        step_voxels: scene.step_voxels,
        share: share(options)?,
        measure_all: options.headless,
        tuning: fixed.is_none().then_some(tuning),
    })
}

fn progress(steps: Option<u64>, visible: bool) -> ProgressBar {
    let bar =
        if visible { steps.map_or_else(ProgressBar::new_spinner, ProgressBar::new) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} steps  {elapsed}  {eta} to go");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

fn line(row: &StepRow) -> String {
    let kept = if row.limit_kept { "" } else { "  contract broken" };
    format!(
        "step {:4}  time {:.4}  {}  {:.0} ms  {}{kept}",
        row.step,
        row.time,
        parameters(row),
        row.generation_ms,
        quality(row)
    )
}

/// Parameters and bytes.
fn parameters(row: &StepRow) -> String {
    let StepRow { representation, resolution, gamma, size_bytes, .. } = row;
    format!("{:6}  r {resolution}  gamma {gamma}  {}", representation.name(), show_bytes(*size_bytes))
}

/// Decibels, with their interval where they come from few pixels.
fn quality(row: &StepRow) -> String {
    let interval = row.half_width_db.filter(|w| *w >= 0.05).map_or_else(String::new, |w| format!(" +-{w:.1}"));
    row.psnr_db.map_or_else(|| "not measured".to_owned(), |q| format!("{:.2}{interval} dB", f64::from(q)))
}

/// Simulation, nodes and viewer together.
fn watch(
    source: &mut dyn Source,
    first: (f64, Volume),
    steps: Option<u64>,
    options: &cli::Watch,
    policy: FullPolicy,
    pace: cli::StepsPerSecond,
) -> anyhow::Result<()> {
    let scene = source.scene().clone();
    let mut outputs = options.out.as_deref().map(|dir| RunFolder::create(dir, source, &first.1, steps)).transpose()?;
    let nodes = Nodes::start(setup(options, &scene, &first.1)?, &scene)?;
    let stop = Arc::new(AtomicBool::new(false));
    let set = stop.clone();
    nodes.on_stop_signal(move || set.store(true, Ordering::Relaxed));
    let stopped = move || stop.load(Ordering::Relaxed);
    if !options.headless {
        say!("watching {} ({}): open http://{}/   (Ctrl-C ends)", source.name(), source.field(), nodes.viewer);
    }
    // Where every step waits for its viewer nobody asks for anything.
    let steering = (!options.headless).then(|| steering::numbers(pace));
    let mut client = connect(source, &first.1, &nodes.generator, policy, steering)?;
    let bar = progress(steps, options.headless);
    let mut shown = Shown { step: None, begun: Instant::now(), tuned: options.headless };
    let mut pacer = Pacer::new(pace);
    let follow = || {
        let (mut next, mut step) = (Some(first), 0);
        while let Some((time, volume)) = next.filter(|_| steps.is_none_or(|n| step < n) && !stopped()) {
            pacer.wait(&stopped);
            if steering::obey(&mut client, &mut pacer, &stopped, || shown.show_new(&nodes, &bar, outputs.as_mut()))? {
                break;
            }
            push(&mut client, step, time, &volume).with_context(|| format!("step {step}"))?;
            if options.headless {
                let Some(row) = nodes.settle(step, &stopped)? else { break };
                if let Some(outputs) = &mut outputs {
                    outputs.pictures(&row, &volume, &scene, &nodes.store)?;
                }
            }
            shown.show_new(&nodes, &bar, outputs.as_mut())?;
            bar.inc(1);
            step += 1;
            next = if stopped() { None } else { timed(source, &mut pacer)? };
        }
        if !options.headless {
            say!("the simulation made {}", pacer.speed());
        }
        if !options.headless && !stopped() {
            say!("all steps are in; the viewer goes on until Ctrl-C");
            while !stopped() {
                shown.show_new(&nodes, &bar, outputs.as_mut())?;
                std::thread::sleep(Duration::from_millis(100));
            }
        }
        Ok(())
    };
    // A step that fails takes none of those before it along.
    let followed = follow();
    shown.show_new(&nodes, &bar, outputs.as_mut())?;
    bar.finish_and_clear();
    client.close();
    if let Some(outputs) = outputs {
        outputs.finish(&nodes)?;
    }
    nodes.stop();
    followed
}

/// What the terminal was told.
struct Shown {
    step: Option<u64>,
    begun: Instant,
    /// The line about the first pick was printed, or is not wanted.
    tuned: bool,
}

impl Shown {
    /// Prints and writes the steps recorded since, up to one that waits to be measured.
    fn show_new(&mut self, nodes: &Nodes, bar: &ProgressBar, outputs: Option<&mut RunFolder>) -> anyhow::Result<()> {
        let new: Vec<StepRow> =
            nodes.store.rows().into_iter().filter(|r| self.step.is_none_or(|s| r.step > s)).collect();
        if let Some(first) = new.iter().find(|r| r.tuning != TuningState::None).filter(|_| !self.tuned) {
            self.tuned = true;
            let secs = self.begun.elapsed().as_secs_f64();
            let psnr_db = nodes.tuner_status(false)?.and_then(|status| status.chosen_psnr_db);
            let quality = psnr_db.map_or_else(String::new, |db| format!(", {db:.2} dB"));
            bar.suspend(|| say!("tuned after {secs:.1} s: {}{quality}", parameters(first)));
        }
        let rows: Vec<StepRow> = new.into_iter().take_while(|r| r.measured != QualityStatus::Pending).collect();
        for row in &rows {
            bar.suspend(|| say!("{}", line(row)));
        }
        if let Some(outputs) = outputs {
            outputs.add(&rows)?;
            // The end will tell again what is missing now.
            if let Err(error) = outputs.update(nodes) {
                tracing::warn!("trials.csv and report.html are not up to date: {error:#}");
            }
        }
        self.step = rows.last().map(|r| r.step).or(self.step);
        Ok(())
    }
}
