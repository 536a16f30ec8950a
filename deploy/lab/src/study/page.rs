//! `report.html` of a study: its figures and tables on one self-contained page.

use super::choices::{ChoiceTransfer, StudyLimits, best, transfers};
use super::recorded_search::Outcome;
use super::step_study::StepStudy;
use super::{figures, findings};
use anyhow::Context;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use lamina_model::psnr;
use lamina_raycast::Backend;
use lamina_report::html::{self, escape};
use lamina_report::numbers::{bytes, decibels, fixed, kilobytes, significant};
use lamina_rpc::daemon::png;
use lamina_tuner::Contract;
use lamina_tuner::pareto::{front, offers};
use lamina_tuner::tune::Trial;
use lamina_vdi_render::{self as viz, Detail};
use std::path::Path;

/// Views of the paper's Fig. 3 to 6, degrees.
const ANGLES_DEG: [f64; 7] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
/// Side of their pictures, pixels.
const PICTURE: u32 = 256;

/// Writes the page.
pub(super) fn write(
    folder: &Path,
    all: &[StepStudy],
    limits: &StudyLimits,
    outcomes: &[Outcome],
    command: &str,
) -> anyhow::Result<()> {
    let plots = |title: &str, words: &str, draw: &dyn Fn(&StepStudy) -> String| {
        let drawn: String = all.iter().map(draw).collect();
        html::section(title, &format!("<p>{}</p><div class=\"plots\">{drawn}</div>", escape(words)))
    };
    let pictures = all.iter().map(|m| strip(m, limits)).collect::<anyhow::Result<Vec<String>>>()?;
    let parts = [
        heading(all, command),
        html::section("VDI above ray cast, 0 to 60 degrees (Fig. 3 to 6)", &pictures.concat()),
        plots(
            "Every trial (Fig. 7)",
            "Area is size, fill is quality, edge is generation time.",
            &figures::measurements,
        ),
        trends(all, limits),
        plots(
            "Best under a size limit (Fig. 8)",
            "Each limit is 1.5 times the one before, unless others were named; the path goes from the tightest.",
            &|m| figures::best_under(m, &limits.size),
        ),
        plots("Best under a time limit (Fig. 9)", "The same for generation time.", &|m| {
            figures::best_under(m, &limits.time)
        }),
        cross(all, limits),
        front_section(all, limits),
        search(outcomes),
    ];
    let style = [lamina_report::STYLE, include_str!("study.css")].concat();
    let page = html::document("A study of generation parameters", &style, &parts);
    let path = folder.join("report.html");
    std::fs::write(&path, page).with_context(|| format!("{}: cannot be written", path.display()))
}

fn heading(all: &[StepStudy], command: &str) -> String {
    let trials: usize = all.iter().map(|m| m.rows.len()).sum();
    let scenes: Vec<String> = all.iter().map(|m| format!("{} step {}", m.name, m.step)).collect();
    let entry = |name: &str, text: &str| format!("<dt>{name}</dt><dd>{}</dd>", escape(text));
    format!(
        "<header><h1>A study of generation parameters</h1><dl class=\"origin\">{}{}{}</dl></header>\n",
        entry("Measured", &scenes.join(", ")),
        entry("Trials", &trials.to_string()),
        entry("Command", command)
    )
}

/// What the pictures are made with: the best under the middle limit that something keeps.
fn pictured<'a>(m: &'a StepStudy, limits: &StudyLimits) -> Option<(&'a Trial, String)> {
    let kept: Vec<(&Contract, usize)> = limits.size.iter().filter_map(|c| best(&m.rows, c).map(|n| (c, n))).collect();
    kept.get(kept.len() / 2).map(|(c, n)| (&m.rows[*n], figures::limit(c)))
}

/// The VDI's pictures above the ray-cast ones, q under each.
fn strip(m: &StepStudy, limits: &StudyLimits) -> anyhow::Result<String> {
    let Some((row, limit)) = pictured(m, limits) else { return Ok(String::new()) };
    let shown = m.trial.decoded(&row.params)?;
    let mut cells = String::new();
    for angle in ANGLES_DEG {
        let camera = m.trial.field().scene().camera.rotated_about_y(angle)?;
        let reference = Backend::cpu().raycast(m.trial.field(), &camera, PICTURE, PICTURE)?;
        let drawn = viz::Backend::default().render(&shown, &camera, PICTURE, PICTURE, Detail::Cubic)?;
        let image = |image: &lamina_model::Image, what: &str| -> anyhow::Result<String> {
            let data = STANDARD.encode(png(image)?);
            Ok(format!("<img src=\"data:image/png;base64,{data}\" alt=\"{what} at {angle} degrees\">"))
        };
        let q = decibels(psnr(&drawn, &reference)?);
        cells += &format!(
            "<div>{}{}<span>{angle}°<br>{q}</span></div>",
            image(&drawn, "VDI")?,
            image(&reference, "Ray cast")?
        );
    }
    let words = format!(
        "{}, step {}: r {}, gamma {}, {} (best under {limit}), {} over all views",
        m.name,
        m.step,
        row.params.resolution(),
        row.params.gamma(),
        bytes(row.measured.cost.size_bytes as f64),
        decibels(row.measured.quality.psnr_db())
    );
    Ok(format!("<figure><figcaption>{}</figcaption><div class=\"strip\">{cells}</div></figure>", escape(&words)))
}

/// What the paper says of its data, on this.
fn trends(all: &[StepStudy], limits: &StudyLimits) -> String {
    let head = ["input", "step"].iter().chain(&findings::HEAD).map(|h| (*h).to_owned());
    let line = |m: &StepStudy| {
        let cells = [m.name.clone(), m.step.to_string()].into_iter().chain(findings::row(&m.rows, limits));
        (cells.collect(), false)
    };
    let words = "<p>Pairs of neighbors on the grid that do what is said above them.</p>";
    let table = html::table("All steps", &head.collect::<Vec<_>>(), all.iter().map(line));
    html::section("How quality, size and time follow the parameters", &format!("{words}{table}"))
}

/// Table 1: choices of one step, used on another.
fn cross(all: &[StepStudy], limits: &StudyLimits) -> String {
    let found: Vec<ChoiceTransfer> = [&limits.size, &limits.time].into_iter().flat_map(|c| transfers(all, c)).collect();
    if found.is_empty() {
        return String::new();
    }
    let broken = found.iter().filter(|t| t.excess() > 0.0).count();
    let worst = found.iter().map(ChoiceTransfer::excess).fold(0.0, f64::max);
    let words = format!(
        "Parameters chosen on one step and used on another: {broken} of {} transfers break their limit, by up to {} %.",
        found.len(),
        fixed(100.0 * worst, 0)
    );
    let head =
        ["input", "limit", "chosen on", "used on", "r", "gamma", "size kB", "ms", "dB", "best there dB", "limit"];
    let line = |t: &ChoiceTransfer| {
        let excess = t.excess();
        let cells = vec![
            t.from.name.clone(),
            figures::limit(t.contract),
            t.from.step.to_string(),
            t.to.step.to_string(),
            t.chosen.params.resolution().to_string(),
            significant(t.chosen.params.gamma(), 4),
            fixed(kilobytes(t.used.measured.cost.size_bytes), 1),
            fixed(1e3 * t.used.measured.cost.generation.as_secs_f64(), 1),
            fixed(t.used.measured.quality.psnr_db(), 2),
            t.own.map_or_else(|| "none".to_owned(), |own| fixed(own.measured.quality.psnr_db(), 2)),
            if excess > 0.0 { format!("broken by {} %", fixed(100.0 * excess, 1)) } else { "kept".to_owned() },
        ];
        (cells, excess > 0.0)
    };
    let table = html::table("All transfers", &head.map(String::from), found.iter().map(line));
    html::section("From one step to another (Table 1)", &format!("<p>{}</p>{table}", escape(&words)))
}

/// What nothing beats, and what more would buy.
fn front_section(all: &[StepStudy], limits: &StudyLimits) -> String {
    let mut content = String::new();
    for m in all {
        let on_front = front(&m.rows);
        let mut words = format!(
            "{}, step {}: {} of {} trials are beaten by no other.",
            m.name,
            m.step,
            on_front.len(),
            m.rows.len()
        );
        for contract in &limits.size {
            let Some(chosen) = best(&m.rows, contract) else { continue };
            let (size, time) = offers(&m.rows, chosen);
            let size = size.map(|o| format!("{} kB more buy {} dB", fixed(o.extra_kilobytes, 0), fixed(o.gain_db, 1)));
            let time = time.map(|o| format!("{} ms more buy {} dB", fixed(o.extra_ms, 0), fixed(o.gain_db, 1)));
            let offers: Vec<String> = [size, time].into_iter().flatten().collect();
            if !offers.is_empty() {
                words += &format!(" At {}: {}.", figures::limit(contract), offers.join("; "));
            }
        }
        content += &format!("<p>{}</p>", escape(&words));
    }
    html::section("What more would buy", &content)
}

/// The search beside the exhaustive choice.
fn search(outcomes: &[Outcome]) -> String {
    if outcomes.is_empty() {
        return String::new();
    }
    let head = [
        "input",
        "step",
        "limit",
        "best r",
        "gamma",
        "dB",
        "found r",
        "gamma",
        "regret dB",
        "trials",
        "CPU s",
        "of exhaustive",
    ];
    let line = |o: &Outcome| {
        let [best, found] = [&o.best, &o.found].map(|row| {
            row.as_ref().map_or(["–".to_owned(), "–".to_owned(), "–".to_owned()], |r| {
                [
                    r.params.resolution().to_string(),
                    significant(r.params.gamma(), 4),
                    fixed(r.measured.quality.psnr_db(), 2),
                ]
            })
        });
        let regret = o.regret_db();
        let cells = vec![
            o.name.clone(),
            o.step.to_string(),
            figures::limit(&o.contract),
            best[0].clone(),
            best[1].clone(),
            best[2].clone(),
            found[0].clone(),
            found[1].clone(),
            regret.map_or_else(|| "–".to_owned(), |r| fixed(r, 3)),
            o.trials.to_string(),
            fixed(o.cpu_secs, 1),
            format!("1/{}", fixed(o.exhaustive_secs / o.cpu_secs.max(1e-9), 0)),
        ];
        (cells, regret.is_some_and(|r| r > 0.1) || o.best.is_some() != o.found.is_some())
    };
    let table = html::table("All searches", &head.map(String::from), outcomes.iter().map(line));
    html::section(
        "The search beside the exhaustive study",
        &format!("<p>{}</p>{table}", escape(&super::recorded_search::summary(outcomes))),
    )
}
