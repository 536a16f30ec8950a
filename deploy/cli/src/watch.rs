//! `live` and `replay`: a source of steps, coupled through the client to the nodes.

use crate::cli;
use crate::nodes::{Nodes, Setup, Tuning};
use crate::offline;
use crate::pacer::Pacer;
use crate::run_folder::RunFolder;
use crate::source::{Example, Recorded, Source, read_options};
use crate::steering;
use crate::terminal::{Shown, progress};
use anyhow::{Context, bail, ensure};
use lamina_client::{Brick, Client, ClientError, FullPolicy, RunOptions, SteerableNumber, VoxelSlice};
use lamina_compute::{CpuLimit, CpuShare};
use lamina_model::{Representation, SamplePlan, Scene, Volume, Voxels};
use lamina_tuner::Contract;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

/// `lamina live`.
pub fn live(arguments: &cli::Live) -> anyhow::Result<()> {
    let watch = &arguments.watch;
    ensure!(!watch.headless || watch.steps.is_some(), "live --headless never ends by itself; say how many --steps");
    let cli::Live { cells, seed, terms, threads, .. } = arguments;
    let mut source = Example::new(*cells, *seed, terms, *threads, watch.nodes.scene.as_deref())?;
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
    let mut source = Recorded::open(&arguments.input, &read_options(&arguments.raw), watch.nodes.scene.as_deref())?;
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
    let overhead = options.nodes.contract.as_ref().and_then(|c| c.limits.overhead);
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

/// Connects as a simulation does, one whose steps have the fields `more` besides.
pub fn connect(
    source: &dyn Source,
    volume: &Volume,
    generator: &str,
    policy: FullPolicy,
    steering: Option<Vec<SteerableNumber>>,
    more: &[(String, Voxels)],
) -> Result<Client, ClientError> {
    let options = RunOptions {
        full_policy: policy,
        steering,
        scene: Some(source.scene().clone()),
        // Blocking is consent to wait: for as long as a study of the tuner may take.
        deadline: if policy == FullPolicy::Block { Duration::from_secs(600) } else { Duration::from_secs(5) },
        more_fields: more.iter().map(|(name, voxels)| (name.clone(), voxels.voxel_type())).collect(),
        color_field: volume.color_field().map(|(name, voxels)| (name.to_owned(), voxels.voxel_type())),
        ..RunOptions::new(generator, source.name(), source.field(), *volume.grid(), volume.voxels().voxel_type())
    };
    Client::connect(options)
}

/// Hands over a whole step, with its further fields.
pub fn push(
    client: &mut Client,
    (step, time): (u64, f64),
    volume: &Volume,
    more: &[(String, Voxels)],
) -> Result<(), ClientError> {
    let more: Vec<VoxelSlice> = more.iter().map(|(_, voxels)| voxels.into()).collect();
    let brick = Brick::new([0; 3], volume.grid().dims(), volume.voxels());
    let brick = volume.color_field().map_or(brick, |(_, voxels)| brick.with_colors(voxels));
    client.push(step, time, &brick.with_more_fields(&more)).map(drop)
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
    let mut more = source.more_fields();
    let mut client = connect(source, &first.1, &generator, policy, Some(steering::numbers(pace)), &more)?;
    let mut next = Some(first);
    let (mut step, mut pacer) = (0, Pacer::new(pace));
    while let Some((time, volume)) = next.filter(|_| steps.is_none_or(|n| step < n)) {
        pacer.wait(&|| false);
        if steering::obey(&mut client, &mut pacer, &|| false, || Ok(()))? {
            break;
        }
        match push(&mut client, (step, time), &volume, &more) {
            Ok(()) => say!("step {step:4}  time {time:.4}  pushed"),
            Err(error @ (ClientError::Invalid(_) | ClientError::Refused(_))) => return Err(error.into()),
            // The simulation goes on; the client tries again by itself.
            Err(error) => say!("step {step:4}  time {time:.4}  lost: {error}"),
        }
        step += 1;
        next = timed(source, &mut pacer)?;
        more = source.more_fields();
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

/// Processor time of the nodes: what the user grants, or a quarter of the cores for the generator-node and one for the viz-node.
pub(crate) fn share(options: &cli::NodeOptions) -> anyhow::Result<CpuShare> {
    Ok(CpuShare::new(options.cpu_share.unwrap_or_else(|| CpuLimit::default().doubled()))?)
}

/// Where quality is measured, and what the tuner is to do.
pub(crate) fn tuning(options: &cli::NodeOptions) -> (SamplePlan, Tuning) {
    let contract = options.contract.clone().unwrap_or_default();
    let tuning = Tuning {
        // The cone is a matter of where quality is measured.
        contract: Contract { cone_deg: None, ..contract.clone() },
        representations: options.representation.clone(),
        grid: options.grid,
        retune_every: options.retune_every,
        budget: lamina_tuner::Config::default().budget,
    };
    (contract.sample_plan(), tuning)
}

fn setup(options: &cli::Watch, scene: &Scene, volume: &Volume, more: &[(String, Voxels)]) -> anyhow::Result<Setup> {
    let fixed = options.resolution.zip(options.gamma);
    let representation = options.nodes.representation.first().copied().unwrap_or_default();
    let params = |(resolution, gamma)| offline::params(representation, resolution, gamma, 1.0, scene);
    let (samples, tuning) = tuning(&options.nodes);
    // Without a viewer every step waits for its tuning.
    let tuning = if options.headless { Tuning { budget: 1.0, ..tuning } } else { tuning };
    let untuned = fixed.and(options.nodes.representation.first());
    let vdis = untuned
        .map_or_else(|| options.nodes.representation.contains(&Representation::Vdi), |r| *r == Representation::Vdi);
    if let Some(second) = scene.effects.color_field.as_ref().filter(|_| !vdis) {
        bail!(
            "--representation: a reduced volume holds one field, and colors come from \"{}\"; allow vdi",
            second.name
        );
    }
    let voxels = volume.grid().voxels() as u64;
    let more_bytes: u64 = more.iter().map(|(_, field)| voxels * field.voxel_type().size_bytes() as u64).sum();
    // In work, each field and its colors take four bytes a voxel; so do one that is computed, and what derivatives of it are taken of.
    let in_work =
        12 * voxels * (1 + u64::from(volume.color_field().is_some())) + 16 * voxels * u64::from(!more.is_empty());
    Ok(Setup {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        insecure: options.nodes.insecure,
        viewer: if options.headless { SocketAddr::from((Ipv4Addr::LOCALHOST, 0)) } else { options.nodes.viewer },
        store: options.nodes.out.as_ref().map(|dir| dir.join("vdi")),
        backend: options.nodes.backend,
        samples,
        // Room for two waiting steps: more would only show the past.
        memory_bytes: 4 * (volume.size_bytes() as u64 + more_bytes) + in_work + (1 << 20),
        scene: Some(scene.clone()),
        params: fixed.map(params).transpose()?,
        step_voxels: scene.step_voxels,
        // All there is where every step waits for them.
        share: if options.headless { CpuShare::unlimited()? } else { share(&options.nodes)? },
        measure_all: options.headless,
        tuning: fixed.is_none().then_some(tuning),
    })
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
    let mut outputs =
        options.nodes.out.as_deref().map(|dir| RunFolder::create(dir, source, &first.1, steps)).transpose()?;
    // Where every step waits for its viewer nobody asks for anything, another field among them.
    let mut more = if options.headless { Vec::new() } else { source.more_fields() };
    let nodes = Nodes::start(setup(options, &scene, &first.1, &more)?)?;
    let stopped = nodes.stopped();
    if !options.headless {
        say!("watching {} ({}): open http://{}/   (Ctrl-C ends)", source.name(), source.field(), nodes.viewer);
    }
    let steering = (!options.headless).then(|| steering::numbers(pace));
    let mut client = connect(source, &first.1, &nodes.generator, policy, steering, &more)?;
    let bar = progress(steps, options.headless);
    let mut shown = Shown::new(None, options.headless);
    let mut pacer = Pacer::new(pace);
    let follow = || {
        let (mut next, mut step) = (Some(first), 0);
        while let Some((time, volume)) = next.filter(|_| steps.is_none_or(|n| step < n) && !stopped()) {
            pacer.wait(&stopped);
            if steering::obey(&mut client, &mut pacer, &stopped, || shown.show_new(&nodes, &bar, outputs.as_mut()))? {
                break;
            }
            push(&mut client, (step, time), &volume, &more).with_context(|| format!("step {step}"))?;
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
            if !options.headless {
                more = source.more_fields();
            }
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
