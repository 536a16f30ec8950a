//! `lamina-lab bench-live`: a simulation alone and beside the nodes, in one run: what each costs the other.
//!
//! The simulation makes the same steps alone, coupled, and alone again; its slowdown is that of the steps all three have made.
//! Meanwhile pages ask for pictures as hands that turn one do. With busy threads everything is measured beside them, too.

use crate::cli;
use anyhow::{Context, ensure};
use lamina::nodes::{Nodes, Setup, Tuning};
use lamina::pacer::Pacer;
use lamina::process::ProcessorTime;
use lamina::say;
use lamina::source::{Example, Recorded, Source, read_options};
use lamina::watch::{connect, push};
use lamina_client::FullPolicy;
use lamina_compute::{Activity, CpuLimit, CpuShare, Priority};
use lamina_model::{Representation, SamplePlan, Scene, TuningState, Volume};
use lamina_tuner::search::SearchGrid;
use lamina_viz_node::store::{QualityStatus, StepRow};
use lamina_volume_io::AxisOrder;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Side of the pictures that pages ask for, pixels.
const DRAFT_SIZE: u32 = 256;

/// Figures of one run, by name, in the order they are printed.
type Figures = BTreeMap<(usize, &'static str), f64>;

/// Names of the figures, and their digits.
const ROWS: [(&str, usize); 24] = [
    ("first pick, s", 1),
    ("first pick, dB", 2),
    ("final pick, s", 1),
    ("final pick, dB", 2),
    ("slowdown of a step, %", 1),
    ("overhead as the node sees it, %", 1),
    ("steps a second", 2),
    ("steps made", 0),
    ("steps shown, %", 1),
    ("steps measured, %", 1),
    ("steps above the limit", 0),
    ("studies lost", 0),
    ("simulate, cores", 3),
    ("generate, cores", 3),
    ("encode, cores", 3),
    ("decode, cores", 3),
    ("measure, cores", 3),
    ("draw, cores", 3),
    ("all else, cores", 3),
    ("first picture, s", 2),
    ("pictures a second", 1),
    ("picture p50, ms", 1),
    ("picture p95, ms", 1),
    ("pictures refused", 0),
];

fn set(figures: &mut Figures, name: &str, value: f64) {
    if let Some(n) = ROWS.iter().position(|(row, _)| *row == name) {
        figures.insert((n, ROWS[n].0), value);
    }
}

/// `lamina-lab bench-live`.
pub(crate) fn bench_live(arguments: &cli::BenchLive) -> anyhow::Result<()> {
    ensure!(
        (1.0..=3600.0).contains(&arguments.seconds),
        "--seconds: {} must lie in 1 to 3600, the time of each part",
        arguments.seconds
    );
    let mut columns = vec![("quiet".to_owned(), measure(arguments, 0)?)];
    if arguments.busy > 0 {
        columns.push((format!("beside {} busy", arguments.busy), measure(arguments, arguments.busy)?));
    }
    let heads: String = columns.iter().map(|(head, _)| format!("{head:>16}")).collect();
    say!("{:34}{heads}", "");
    for (n, (name, digits)) in ROWS.iter().enumerate() {
        let value = |(_, figures): &(String, Figures)| {
            figures.get(&(n, *name)).map_or_else(|| format!("{:>16}", "-"), |v| format!("{v:>16.digits$}"))
        };
        say!("{name:34}{}", columns.iter().map(value).collect::<String>());
    }
    Ok(())
}

/// Medians of all runs, but the sum of lost studies.
fn measure(arguments: &cli::BenchLive, busy: u16) -> anyhow::Result<Figures> {
    let mut runs = Vec::new();
    for n in 0..arguments.runs {
        let run = beside_busy(busy, |burnt| one_run(arguments, burnt))?;
        tracing::info!(run = n, ?run, "measured");
        runs.push(run);
    }
    let mut medians = Figures::new();
    for (n, (name, _)) in ROWS.iter().enumerate() {
        let mut values: Vec<f64> = runs.iter().filter_map(|run| run.get(&(n, *name)).copied()).collect();
        values.sort_by(f64::total_cmp);
        if *name == "studies lost" {
            medians.insert((n, name), values.iter().sum());
        } else if values.len() == runs.len() {
            // What a run lacks, as one without a pick, is no median of the others'.
            medians.insert((n, name), values[values.len() / 2]);
        }
    }
    Ok(medians)
}

/// Processor time of busy threads, nanoseconds.
type Burnt = AtomicU64;

/// `work` beside threads that compute without end; it is told what they have used so far.
fn beside_busy<T>(busy: u16, work: impl FnOnce(&Burnt) -> anyhow::Result<T>) -> anyhow::Result<T> {
    let (done, burnt) = (AtomicBool::new(false), Burnt::new(0));
    std::thread::scope(|scope| {
        for _ in 0..busy {
            scope.spawn(|| {
                let (mut x, mut before) = (1_u64, Duration::ZERO);
                while !done.load(Ordering::Relaxed) {
                    for _ in 0..1 << 20 {
                        x = std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
                    }
                    let used = lamina_compute::thread_cpu_time();
                    burnt.fetch_add((used - before).as_nanos() as u64, Ordering::Relaxed);
                    before = used;
                }
            });
        }
        let outcome = work(&burnt);
        done.store(true, Ordering::Relaxed);
        outcome
    })
}

fn source(arguments: &cli::BenchLive) -> anyhow::Result<Box<dyn Source>> {
    Ok(match &arguments.replay {
        Some(series) => {
            let raw = lamina::cli::Raw {
                dims: None,
                dtype: None,
                field: None,
                missing: None,
                axes: AxisOrder::default(),
                level: None,
            };
            Box::new(Recorded::open(series, &read_options(&raw), None)?)
        }
        None => Box::new(Example::new(arguments.cells, 1, &[], arguments.threads, None)?),
    })
}

/// Makes steps at the pace for some time, each handed to `take`; what each took.
fn steps(
    source: &mut dyn Source,
    pace: lamina::cli::StepsPerSecond,
    time: Duration,
    mut take: impl FnMut(u64, f64, &Volume) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<f64>> {
    let (mut pacer, mut took, begun) = (Pacer::new(pace), Vec::new(), Instant::now());
    while begun.elapsed() < time {
        pacer.wait(&|| begun.elapsed() >= time);
        let started = Instant::now();
        let Some((at, volume)) = source.next()? else { break };
        take(took.len() as u64, at, &volume)?;
        took.push(started.elapsed().as_secs_f64());
    }
    Ok(took)
}

fn one_run(arguments: &cli::BenchLive, burnt: &Burnt) -> anyhow::Result<Figures> {
    let time = Duration::from_secs_f64(arguments.seconds);
    let pace = arguments.pace;
    let alone = |share: f64| steps(&mut *source(arguments)?, pace, time.mul_f64(share), |_, _, _| Ok(()));
    let before = alone(0.5)?;
    let (mut figures, coupled) = coupled(arguments, time, burnt)?;
    let after = alone(0.5)?;
    let common = before.len().min(coupled.len()).min(after.len());
    // The first step has no computing behind it.
    let sum = |took: &[f64]| took[1.min(common)..common].iter().sum::<f64>();
    if common > 2 {
        let slowdown = 2.0 * sum(&coupled) / (sum(&before) + sum(&after)) - 1.0;
        set(&mut figures, "slowdown of a step, %", 100.0 * slowdown);
    }
    Ok(figures)
}

/// The simulation beside the nodes.
fn coupled(arguments: &cli::BenchLive, time: Duration, burnt: &Burnt) -> anyhow::Result<(Figures, Vec<f64>)> {
    let mut source = source(arguments)?;
    let (mut figures, scene) = (Figures::new(), source.scene().clone());
    let first = source.next()?.context("the series is empty")?.1;
    let share = CpuShare::new(arguments.cpu_share.unwrap_or_else(|| CpuLimit::default().doubled()))?;
    let nodes = Nodes::start(setup(arguments, share.clone(), &first, scene))?;
    let mut client = connect(&*source, &first, &nodes.generator, FullPolicy::DropOldest, None, &[])?;
    // The series from its beginning.
    let mut source = self::source(arguments)?;
    let (done, begun) = (AtomicBool::new(false), Instant::now());
    let (used, pages) = (ProcessorTime::now(), Mutex::new(Pages::default()));
    let busy = || burnt.load(Ordering::Relaxed) as f64 / 1e9;
    let busy_before = busy();
    let (took, picks) = std::thread::scope(|scope| {
        for page in 0..arguments.pages {
            let (done, pages, viewer) = (&done, &pages, nodes.viewer);
            scope.spawn(move || turn(viewer, page, done, pages));
        }
        let (done, nodes) = (&done, &nodes);
        let picks = scope.spawn(move || watch_picks(nodes, done, begun));
        let took = steps(&mut *source, arguments.pace, time, |step, at, volume| {
            // A step that is not taken is one not shown.
            let _ = push(&mut client, (step, at), volume, &[]);
            Ok(())
        });
        done.store(true, Ordering::Relaxed);
        (took, picks.join())
    });
    let (took, wall) = (took?, begun.elapsed().as_secs_f64());
    let picks = picks.map_err(|_| anyhow::anyhow!("the thread that watches picks panicked"))??;
    picks.fill(&mut figures);
    let without_busy = used.secs().map(|secs| secs - (busy() - busy_before));
    processor_time(&mut figures, &share, without_busy, source.cpu_time(), wall);
    pages.into_inner().fill(&mut figures, wall);
    let rows = nodes.store.rows();
    let part = |count: usize, of: usize| 100.0 * count as f64 / of.max(1) as f64;
    let measured = rows.iter().filter(|r| r.measured == QualityStatus::Yes).count();
    set(&mut figures, "steps a second", took.len() as f64 / wall);
    set(&mut figures, "steps made", took.len() as f64);
    set(&mut figures, "steps shown, %", part(rows.len(), took.len()));
    set(&mut figures, "steps measured, %", part(measured, rows.len()));
    let above = |row: &&StepRow| row.size_limit_bytes.is_some_and(|limit| row.size_bytes > limit);
    set(&mut figures, "steps above the limit", rows.iter().filter(above).count() as f64);
    if let Some(overhead) = rows.iter().rev().find_map(|r| r.overhead) {
        set(&mut figures, "overhead as the node sees it, %", 100.0 * overhead);
    }
    if let Some(status) = nodes.tuner_status(false)? {
        set(&mut figures, "studies lost", status.lost_studies as f64);
    }
    tracing::info!(skipped = share.usage().skipped(Priority::Quality), "quality");
    client.close();
    nodes.stop();
    Ok((figures, took))
}

fn setup(arguments: &cli::BenchLive, share: CpuShare, first: &Volume, scene: Scene) -> Setup {
    let tuning = Tuning {
        contract: arguments.contract.clone(),
        representations: Representation::ALL.to_vec(),
        grid: SearchGrid::default(),
        retune_every: 0,
        budget: lamina_tuner::Config::default().budget,
    };
    let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    Setup {
        listen: any_port,
        viewer: any_port,
        insecure: false,
        store: None,
        backend: lamina_compute::gpu::Choice::Auto,
        samples: SamplePlan::default(),
        memory_bytes: 4 * first.size_bytes() as u64 + 12 * first.grid().voxels() as u64 + (1 << 20),
        params: None,
        step_voxels: scene.step_voxels,
        scene: Some(scene),
        share,
        measure_all: false,
        tuning: Some(tuning),
    }
}

fn processor_time(figures: &mut Figures, share: &CpuShare, all: Option<f64>, simulated: Option<Duration>, wall: f64) {
    let usage = share.usage();
    let mut known = 0.0;
    for activity in Activity::ALL {
        let secs = usage.cpu(activity).as_secs_f64();
        known += secs;
        set(figures, &format!("{}, cores", activity.name()), secs / wall);
    }
    if let Some(simulated) = simulated {
        known += simulated.as_secs_f64();
        set(figures, "simulate, cores", simulated.as_secs_f64() / wall);
    }
    if let Some(all) = all {
        set(figures, "all else, cores", (all - known).max(0.0) / wall);
    }
}

/// When parameters of a study were first in use, and when those of a whole one; and what their trials came to.
#[derive(Default)]
struct Picks {
    first: Option<(f64, Option<f64>)>,
    last: Option<(f64, Option<f64>)>,
}

impl Picks {
    fn fill(&self, figures: &mut Figures) {
        for (pick, secs, db) in
            [(self.first, "first pick, s", "first pick, dB"), (self.last, "final pick, s", "final pick, dB")]
        {
            if let Some((at, psnr_db)) = pick {
                set(figures, secs, at);
                psnr_db.into_iter().for_each(|value| set(figures, db, value));
            }
        }
    }
}

fn watch_picks(nodes: &Nodes, done: &AtomicBool, begun: Instant) -> anyhow::Result<Picks> {
    let mut picks = Picks::default();
    while !done.load(Ordering::Relaxed) && picks.last.is_none() {
        std::thread::sleep(Duration::from_millis(20));
        let Some(row) = nodes.store.newest_step().and_then(|step| nodes.store.row(step)) else { continue };
        let pick = || -> anyhow::Result<Option<(f64, Option<f64>)>> {
            let psnr_db = nodes.tuner_status(false)?.and_then(|status| status.chosen_psnr_db);
            Ok(Some((begun.elapsed().as_secs_f64(), psnr_db)))
        };
        if row.tuning != TuningState::None && picks.first.is_none() {
            picks.first = pick()?;
        }
        if row.tuning == TuningState::Done {
            picks.last = pick()?;
        }
    }
    Ok(picks)
}

/// What pages saw.
#[derive(Default)]
struct Pages {
    latencies_ms: Vec<f64>,
    /// From when a page was opened.
    first: Option<f64>,
    refused: u64,
}

impl Pages {
    fn fill(mut self, figures: &mut Figures, wall: f64) {
        self.latencies_ms.sort_by(f64::total_cmp);
        let n = self.latencies_ms.len();
        if n == 0 {
            return;
        }
        let quantile = |q: f64| self.latencies_ms[((n as f64 * q) as usize).min(n - 1)];
        self.first.into_iter().for_each(|first| set(figures, "first picture, s", first));
        set(figures, "pictures a second", n as f64 / wall);
        set(figures, "picture p50, ms", quantile(0.5));
        set(figures, "picture p95, ms", quantile(0.95));
        set(figures, "pictures refused", self.refused as f64);
    }
}

/// A page whose reader turns the picture without rest: the next view is asked for when the last one is there, at most 60 a
/// second.
fn turn(viewer: SocketAddr, page: u16, done: &AtomicBool, pages: &Mutex<Pages>) {
    let agent: ureq::Agent = ureq::Agent::config_builder().timeout_global(Some(Duration::from_secs(10))).build().into();
    let (mut azimuth, mut opened) = (f64::from(page) * 40.0, None);
    while !done.load(Ordering::Relaxed) {
        azimuth = (azimuth + 1.5) % 360.0;
        let url = format!("http://{viewer}/api/image?step=newest&azimuth={azimuth}&size={DRAFT_SIZE}&draft=true");
        let asked = Instant::now();
        let begun = *opened.get_or_insert(asked);
        let drawn = agent.get(&url).call().and_then(|mut answer| answer.body_mut().read_to_vec());
        let took = asked.elapsed();
        {
            let mut pages = pages.lock();
            match drawn {
                Ok(_) => {
                    pages.latencies_ms.push(1e3 * took.as_secs_f64());
                    pages.first.get_or_insert(begun.elapsed().as_secs_f64());
                }
                // Before the first step there is nothing to see.
                Err(ureq::Error::StatusCode(404)) => {}
                Err(_) => pages.refused += 1,
            }
        }
        std::thread::sleep(Duration::from_millis(16).saturating_sub(took));
    }
}
