//! What a study writes for other programs.

use super::choices::{StudyLimits, best, transfers};
use super::recorded_search::Outcome;
use super::step_study::StepStudy;
use crate::table::Table;
use lamina_tuner::Contract;
use lamina_tuner::tune::Trial;
use std::path::Path;

/// Resolution, gamma, size, times and quality, as they stand in every file.
const TRIAL: [&str; 6] = ["resolution", "gamma", "size_bytes", "generation_ms", "encode_ms", "psnr_db"];

fn trial(row: &Trial) -> [String; 6] {
    let (params, cost) = (&row.params, &row.measured.cost);
    let ms = |time: std::time::Duration| format!("{:.3}", 1e3 * time.as_secs_f64());
    [
        params.resolution().to_string(),
        params.gamma().to_string(),
        cost.size_bytes.to_string(),
        ms(cost.generation),
        ms(cost.encode),
        format!("{:.4}", row.measured.quality.psnr_db()),
    ]
}

/// `measurements.csv`: every trial; one column for each view, then structural similarity where it was measured.
pub(super) fn measurements(folder: &Path, all: &[StepStudy]) -> anyhow::Result<()> {
    let first = all.iter().flat_map(|m| &m.rows).next();
    let views = first.iter().flat_map(|r| &r.measured.quality.views).map(|v| format!("psnr_db_{}", v.angle_deg));
    let views = views.chain(["ssim".to_owned()]);
    let header = ["scene", "step"].into_iter().chain(TRIAL).map(str::to_owned).chain(views);
    let mut table = Table::create(folder, "measurements.csv", header)?;
    for (m, r) in all.iter().flat_map(|m| m.rows.iter().map(move |row| (m, row))) {
        let views = r.measured.quality.views.iter().map(|v| format!("{:.4}", v.psnr_db()));
        let ssim = r.measured.quality.ssim().map_or_else(String::new, |ssim| format!("{ssim:.6}"));
        let views = views.chain([ssim]);
        table.row([m.name.clone(), m.step.to_string()].into_iter().chain(trial(r)).chain(views))?;
    }
    table.finish()
}

/// `best_size.csv` and `best_time.csv`: the choice under each limit; empty where nothing keeps it.
pub(super) fn choices(folder: &Path, all: &[StepStudy], limits: &StudyLimits) -> anyhow::Result<()> {
    let write = |name: &str, unit: &str, contracts: &[Contract], limit: fn(&Contract) -> f64| {
        let mut table = Table::create(folder, name, ["scene", "step", unit].into_iter().chain(TRIAL))?;
        for (m, contract) in all.iter().flat_map(|m| contracts.iter().map(move |c| (m, c))) {
            let chosen = best(&m.rows, contract).map(|n| trial(&m.rows[n])).unwrap_or_default();
            let of = [m.name.clone(), m.step.to_string(), limit(contract).to_string()];
            table.row(of.into_iter().chain(chosen))?;
        }
        table.finish()
    };
    write("best_size.csv", "limit_bytes", &limits.size, |c| c.limits.size_bytes.unwrap_or(0) as f64)?;
    write("best_time.csv", "limit_ms", &limits.time, |c| c.limits.time_ms.unwrap_or(0.0))
}

/// `cross.csv`: choices of one step, used on another.
pub(super) fn cross(folder: &Path, all: &[StepStudy], limits: &StudyLimits) -> anyhow::Result<()> {
    let header = ["scene", "from_step", "to_step", "limit"].into_iter().chain(TRIAL);
    let mut table = Table::create(folder, "cross.csv", header.chain(["excess_percent", "loss_db"]))?;
    for t in [&limits.size, &limits.time].into_iter().flat_map(|contracts| transfers(all, contracts)) {
        let of = [t.from.name.clone(), t.from.step.to_string(), t.to.step.to_string(), t.contract.to_string()];
        let loss = t.loss_db().map_or_else(String::new, |db| format!("{db:.3}"));
        table.row(of.into_iter().chain(trial(t.used)).chain([format!("{:.1}", 100.0 * t.excess()), loss]))?;
    }
    table.finish()
}

/// `search.csv`: what the search found beside the exhaustive choice.
pub(super) fn search(folder: &Path, outcomes: &[Outcome]) -> anyhow::Result<()> {
    let header = [
        "scene",
        "step",
        "limit",
        "best_resolution",
        "best_gamma",
        "best_psnr_db",
        "found_resolution",
        "found_gamma",
        "regret_db",
        "excess_percent",
        "trials",
        "cpu_s",
        "exhaustive_cpu_s",
    ];
    let mut table = Table::create(folder, "search.csv", header)?;
    for o in outcomes {
        let params = |row: &Option<Trial>| {
            row.as_ref().map(|r| [r.params.resolution().to_string(), r.params.gamma().to_string()]).unwrap_or_default()
        };
        let number = |value: Option<f64>, digits| value.map_or_else(String::new, |v| format!("{v:.digits$}"));
        let ([best_r, best_gamma], [found_r, found_gamma]) = (params(&o.best), params(&o.found));
        table.row([
            o.name.clone(),
            o.step.to_string(),
            o.contract.to_string(),
            best_r,
            best_gamma,
            number(o.best.as_ref().map(|r| r.measured.quality.psnr_db()), 4),
            found_r,
            found_gamma,
            number(o.regret_db(), 4),
            number(o.excess().map(|e| 100.0 * e), 2),
            o.trials.to_string(),
            format!("{:.2}", o.cpu_secs),
            format!("{:.1}", o.exhaustive_secs),
        ])?;
    }
    table.finish()
}
