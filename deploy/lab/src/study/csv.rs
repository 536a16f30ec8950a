//! What a study writes for other programs.

use super::choices::{StudyLimits, best, transfers};
use super::recorded_search::Outcome;
use super::step_study::StepStudy;
use anyhow::Context;
use lamina_tuner::Contract;
use lamina_tuner::tune::Trial;
use std::fmt::Write as _;
use std::path::Path;

fn write(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let path = folder.join(name);
    std::fs::write(&path, text).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Resolution, gamma, size, times and quality, as they stand in every file.
const ROW: &str = "resolution,gamma,size_bytes,generation_ms,encode_ms,psnr_db";

fn row(row: &Trial) -> String {
    let (params, cost) = (&row.params, &row.measured.cost);
    let ms = |time: std::time::Duration| 1e3 * time.as_secs_f64();
    format!(
        "{},{},{},{:.3},{:.3},{:.4}",
        params.resolution(),
        params.gamma(),
        cost.size_bytes,
        ms(cost.generation),
        ms(cost.encode),
        row.measured.quality.psnr_db()
    )
}

/// `measurements.csv`: every trial; one column for each view at the end.
pub(super) fn measurements(folder: &Path, all: &[StepStudy]) -> anyhow::Result<()> {
    let first = all.iter().flat_map(|m| &m.rows).next();
    let mut text = format!("scene,step,{ROW}");
    for view in first.iter().flat_map(|r| &r.measured.quality.views) {
        write!(text, ",psnr_db_{}", view.angle_deg)?;
    }
    text.push('\n');
    for (m, r) in all.iter().flat_map(|m| m.rows.iter().map(move |row| (m, row))) {
        write!(text, "{},{},{}", m.name, m.step, row(r))?;
        for view in &r.measured.quality.views {
            write!(text, ",{:.4}", view.psnr_db())?;
        }
        text.push('\n');
    }
    write(folder, "measurements.csv", &text)
}

/// `best_size.csv` and `best_time.csv`: the choice under each limit; empty where nothing keeps it.
pub(super) fn choices(folder: &Path, all: &[StepStudy], limits: &StudyLimits) -> anyhow::Result<()> {
    let table = |unit: &str, contracts: &[Contract], limit: fn(&Contract) -> f64| {
        let mut text = format!("scene,step,{unit},{ROW}\n");
        for (m, contract) in all.iter().flat_map(|m| contracts.iter().map(move |c| (m, c))) {
            let chosen = best(&m.rows, contract).map_or_else(|| ",,,,,".to_owned(), |n| row(&m.rows[n]));
            text += &format!("{},{},{},{chosen}\n", m.name, m.step, limit(contract));
        }
        text
    };
    write(folder, "best_size.csv", &table("limit_bytes", &limits.size, |c| c.limits.size_bytes.unwrap_or(0) as f64))?;
    write(folder, "best_time.csv", &table("limit_ms", &limits.time, |c| c.limits.time_ms.unwrap_or(0.0)))
}

/// `cross.csv`: choices of one step, used on another.
pub(super) fn cross(folder: &Path, all: &[StepStudy], limits: &StudyLimits) -> anyhow::Result<()> {
    let mut text = format!("scene,from_step,to_step,limit,{ROW},excess_percent,loss_db\n");
    for contracts in [&limits.size, &limits.time] {
        for t in transfers(all, contracts) {
            let loss = t.loss_db().map_or_else(String::new, |db| format!("{db:.3}"));
            let (name, excess) = (&t.from.name, 100.0 * t.excess());
            text +=
                &format!("{name},{},{},{},{},{excess:.1},{loss}\n", t.from.step, t.to.step, t.contract, row(t.used));
        }
    }
    write(folder, "cross.csv", &text)
}

/// `search.csv`: what the search found beside the exhaustive choice.
pub(super) fn search(folder: &Path, outcomes: &[Outcome]) -> anyhow::Result<()> {
    let mut text = String::from(
        "scene,step,limit,best_resolution,best_gamma,best_psnr_db,found_resolution,found_gamma,regret_db,excess_percent,trials,cpu_s,exhaustive_cpu_s\n",
    );
    for o in outcomes {
        let params = |row: &Option<Trial>| {
            row.as_ref().map_or_else(|| ",".to_owned(), |r| format!("{},{}", r.params.resolution(), r.params.gamma()))
        };
        let best_db = o.best.as_ref().map_or_else(String::new, |r| format!("{:.4}", r.measured.quality.psnr_db()));
        let number = |value: Option<f64>, digits| value.map_or_else(String::new, |v| format!("{v:.digits$}"));
        text += &format!(
            "{},{},{},{},{best_db},{},{},{},{},{:.2},{:.1}\n",
            o.name,
            o.step,
            o.contract,
            params(&o.best),
            params(&o.found),
            number(o.regret_db(), 4),
            number(o.excess().map(|e| 100.0 * e), 2),
            o.trials,
            o.cpu_secs,
            o.exhaustive_secs
        );
    }
    write(folder, "search.csv", &text)
}
