//! `lamina-lab study`: the paper's exhaustive measurement on the user's own data.
//!
//! Every (gamma, resolution) of a grid is generated, encoded, drawn from the test views and compared; everything else
//! (figures, tables, choices under limits) is read off what was measured.

mod cache;
mod choices;
mod csv;
mod figures;
mod findings;
mod page;
mod recorded_search;
mod step_study;

use crate::cli;
use anyhow::{Context, ensure};
use cache::Cache;
use choices::StudyLimits;
use indicatif::{ProgressBar, ProgressStyle};
use lamina::in_process::{InProcessEvaluator, encode_options};
use lamina::say;
use lamina::source::{read_options, scene_of, with_colors};
use lamina_model::{GenerationParams, Representation, SamplePlan, Scene, Segmentation, VdiParams, Volume};
use lamina_tuner::Contract;
use lamina_tuner::evaluator::Evaluator as _;
use lamina_tuner::search::{CandidateSet, SearchGrid};
use lamina_tuner::tune::tune;
use lamina_vdi_render::Kernels;
use lamina_volume_io::Series;
use step_study::StepStudy;

/// How often a generation is timed: once in each of as many rounds over the grid, because what else a machine does may last
/// for minutes.
const TIMES: u32 = 3;
/// What a trial takes besides its generation, in generations, about: for the bar.
const BESIDES: u64 = 4;

/// `lamina-lab study`.
pub(crate) fn study(arguments: &cli::StudyArguments) -> anyhow::Result<()> {
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("{}: cannot be created", arguments.out.display()))?;
    let kernels = Kernels::open(arguments.backend)?;
    let mut all = Vec::new();
    for input in &arguments.inputs {
        let series = Series::open(input, &read_options(&arguments.raw))?;
        let chosen: Vec<usize> =
            if series.len() == 1 || arguments.steps.is_empty() { vec![0] } else { arguments.steps.clone() };
        let last = series.len() - 1;
        for step in &chosen {
            ensure!(*step <= last, "--steps {step}: {} has steps 0 to {last}", input.display());
        }
        let scene = scene_of(&series, arguments.scene.as_deref())?;
        for step in chosen {
            let name = series.name().to_owned();
            let volume = with_colors(&series, step, series.read(step)?, &scene)?;
            let trial = open(&name, step as u64, volume, &scene, &kernels, arguments)?;
            all.push(measure(name, step as u64, &scene, trial, &arguments.grid)?);
            // What is there is written after every step: the next may take an hour.
            csv::measurements(&arguments.out, &all)?;
        }
    }
    let limits = StudyLimits::new(arguments, &all);
    csv::choices(&arguments.out, &all, &limits)?;
    csv::cross(&arguments.out, &all, &limits)?;
    let contracts: Vec<&Contract> = limits.size.iter().chain(&limits.time).collect();
    let outcomes = recorded_search::outcomes(&mut all, &contracts)?;
    csv::search(&arguments.out, &outcomes)?;
    let command: Vec<String> = std::env::args().skip(1).collect();
    page::write(&arguments.out, &all, &limits, &outcomes, &format!("lamina-lab {}", command.join(" ")))?;
    for m in &all {
        let found = findings::HEAD.iter().zip(findings::row(&m.rows, &limits));
        let by_ssim = findings::choices_by_ssim(&m.rows, &limits);
        let found =
            found.map(|(what, how)| (*what, how)).chain(by_ssim.map(|how| ("best by SSIM under size limits", how)));
        found.for_each(|(what, how)| say!("{} {}: {what}: {how}", m.name, m.step));
    }
    say!("{}", recorded_search::summary(&outcomes));
    say!("report and tables: {}", arguments.out.join("report.html").display());
    Ok(())
}

/// Trials on one step, with what an earlier run left.
fn open(
    name: &str,
    step: u64,
    volume: Volume,
    scene: &Scene,
    kernels: &Kernels,
    arguments: &cli::StudyArguments,
) -> anyhow::Result<InProcessEvaluator> {
    let plan = if arguments.ssim { SamplePlan::whole_views() } else { SamplePlan::default() };
    let mut kernel = format!("{:?}", std::mem::discriminant(&kernels.cast));
    if arguments.segmentation != Segmentation::Greedy {
        kernel += &format!("{} {:?}", arguments.segmentation, encode_options(arguments.segmentation).codec);
    }
    let fingerprint = cache::fingerprint(&volume, scene, &plan, &kernel)?;
    let cache = Cache::open(&arguments.out.join("cache").join(format!("{name}-{step}-{fingerprint}.jsonl")))?;
    Ok(InProcessEvaluator::new(step, volume, scene, kernels, &plan, arguments.segmentation, Box::new(cache))?)
}

/// Every candidate of `grid`.
fn measure(
    name: String,
    step: u64,
    scene: &Scene,
    mut trial: InProcessEvaluator,
    grid: &SearchGrid,
) -> anyhow::Result<StepStudy> {
    let base = VdiParams::new(1, 0.0)?.with_step_voxels(scene.step_voxels)?.into();
    let runtime = tokio::runtime::Builder::new_current_thread().build()?;
    let mut candidates = CandidateSet::new(trial.longest_side(), &[Representation::Vdi], grid, &base)?;
    let candidates = runtime.block_on(candidates.all(&mut trial))?;
    let known = candidates.iter().filter(|p| trial.trial(p).is_some()).count();
    let bar = bar(&format!("{name} {step}"), &candidates);
    if known > 0 {
        bar.println(format!(
            "{name}, step {step}: {known} of {} trials are there from an earlier run",
            candidates.len()
        ));
    }
    // The bar counts rays, which time follows, so that its time to go means something.
    let rays = |p: &GenerationParams| u64::from(p.resolution()).pow(2);
    let contract: Contract = "maximise psnr".parse()?;
    let mut study =
        runtime.block_on(tune(&mut trial, &contract, &candidates, |r| bar.inc(rays(&r.params) * (1 + BESIDES))))?;
    for times in 2..=TIMES {
        for row in &mut study.rows {
            if let Err(error) = trial.time_again(&row.params, times) {
                tracing::warn!("timed {} times only: {error}", times - 1);
            }
            bar.inc(rays(&row.params));
        }
    }
    for row in &mut study.rows {
        row.measured.cost = trial.trial(&row.params).map_or(row.measured.cost, |known| known.cost);
    }
    bar.finish_and_clear();
    ensure!(!study.rows.is_empty(), "{name}, step {step}: none of the grid's parameters could be measured");
    Ok(StepStudy { name, step: trial.step(), rows: study.rows, trial })
}

fn bar(what: &str, candidates: &[GenerationParams]) -> ProgressBar {
    let rays: u64 = candidates.iter().map(|p| u64::from(p.resolution()).pow(2)).sum();
    let style = ProgressStyle::with_template("{msg} {bar:30} {percent} %  {elapsed}  {eta} to go");
    let bar = ProgressBar::new(rays * (u64::from(TIMES) + BESIDES)).with_message(what.to_owned());
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
