//! `lamina tune`: the best parameters of one step under a contract, with a few trials.

use crate::cli;
use crate::in_process::{InProcessEvaluator, TrialsInMemory};
use crate::offline::read_step;
use crate::process::ProcessorTime;
use crate::scene_file::with_step;
use crate::source::{read_options, scene_of, with_colors};
use lamina_model::{Segmentation, VdiParams};
use lamina_tuner::Contract;
use lamina_tuner::evaluator::Evaluator as _;
use lamina_tuner::interval::half_width_db;
use lamina_tuner::pareto::{Exchange, front, offers};
use lamina_tuner::search::{CandidateSet, SearchRequest, SearchResult, search};
use lamina_tuner::tune::Trial;
use lamina_vdi_render::Kernels;
use lamina_volume_io::Series;

/// `lamina tune`.
pub fn tune(arguments: &cli::Tune) -> anyhow::Result<()> {
    let contract = &arguments.contract;
    anyhow::ensure!(
        contract.limits.overhead.is_none(),
        "contract: overhead: there is no simulation to measure here; leave it out"
    );
    let input = &arguments.input;
    let series = Series::open(&input.input, &read_options(&input.raw))?;
    let volume = read_step(&series, input)?;
    let scene = with_step(scene_of(&series, input.scene.as_deref())?, input)?;
    let volume = with_colors(&series, input.time_step, volume, &scene)?;
    let kernels = Kernels::open(input.backend)?;
    let plan = contract.sample_plan();
    let mut trial = InProcessEvaluator::new(
        input.time_step as u64,
        volume,
        &scene,
        &kernels,
        &plan,
        Segmentation::Fitted,
        Box::new(TrialsInMemory::new()),
    )?;
    let base = VdiParams::new(1, 0.0)?.with_step_voxels(scene.step_voxels)?.into();
    let before = ProcessorTime::now();
    let runtime = tokio::runtime::Builder::new_current_thread().build()?;
    let mut all = CandidateSet::new(trial.longest_side(), &arguments.representation, &arguments.grid, &base)?;
    let request = SearchRequest::new(contract, &mut all);
    let found = runtime.block_on(search(&mut trial, request, |row| say!("  {}", line(contract, row))))?;
    say!("contract   {contract}");
    verdict(contract, &found)?;
    let time = before.secs().map_or_else(String::new, |s| format!(", {s:.1} s of processor time"));
    say!("trials     {} of {} candidates{time}", found.study.rows.len(), all.count());
    Ok(())
}

fn line(contract: &Contract, row: &Trial) -> String {
    let width = half_width_db(&row.measured.quality);
    let doubt = if width.is_finite() { format!(" +- {width:.2}") } else { String::new() };
    let kept = if contract.keeps(&row.measured) { "" } else { "  not kept" };
    let (r, gamma) = (row.params.resolution(), row.params.gamma());
    format!(
        "{:6}  r {r:4}  gamma {gamma:<8}  {}{doubt}{kept}",
        row.params.representation().name(),
        contract.describe(&row.measured)
    )
}

/// What was found, how sure that is, and what more would buy.
fn verdict(contract: &Contract, found: &SearchResult) -> anyhow::Result<()> {
    let rows = &found.study.rows;
    let Some(best) = found.study.best else {
        if let Some(nearest) = found.study.nearest(contract) {
            say!("nearest    {}", line(contract, &rows[nearest]));
        }
        anyhow::bail!(
            "nothing tried keeps this contract (chance that something untried does: {:.0} %); relax the limit that the nearest breaks",
            100.0 * found.hope
        );
    };
    say!("best       {}", line(contract, &rows[best]));
    if let Some(limit) = contract.limits.size_bytes {
        let used = rows[best].measured.cost.size_bytes;
        say!("used       {used} of {limit} bytes: {:.1} %", 100.0 * used as f64 / limit as f64);
    }
    if let Some(left) = found.left {
        say!("sure       no other candidate is expected to gain more than {left:.3} ({})", contract.utility());
    }
    let (size, time) = offers(rows, best);
    let more = |o: Option<Exchange>| {
        if let Some(o) = o {
            let p = &rows[o.row].params;
            say!(
                "more       {:+.1} kB and {:+.1} ms for {:+.2} dB: {} r {}, gamma {}",
                o.extra_kilobytes,
                o.extra_ms,
                o.gain_db,
                p.representation(),
                p.resolution(),
                p.gamma()
            );
        }
    };
    more(size);
    more(time.filter(|t| size.is_none_or(|s| s.row != t.row)));
    let front = front(rows);
    say!("front      {} of the trials are beaten by no other:", front.len());
    for n in front {
        say!("  {}", line(contract, &rows[n]));
    }
    Ok(())
}
