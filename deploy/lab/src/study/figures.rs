//! The paper's Fig. 7, 8 and 9 as drawings: what was measured, and what is best under which limit.

use super::choices::best;
use super::step_study::StepStudy;
use lamina_report::color_at;
use lamina_report::html::escape;
use lamina_report::numbers::{bytes, decibels, finite_range, fixed, significant};
use lamina_report::svg::{self, Axis};
use lamina_tuner::Contract;
use lamina_tuner::tune::Trial;

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = WIDTH - 12.0;
const BOTTOM: f64 = HEIGHT - 42.0;
const TOP: f64 = 16.0;

fn ms(row: &Trial) -> f64 {
    1e3 * row.measured.cost.generation.as_secs_f64()
}

/// gamma to the right, r upwards, room for the largest circle on all sides.
fn axes(rows: &[Trial], room: f64) -> (Axis, Axis) {
    let gammas = finite_range(rows.iter().map(|r| r.params.gamma())).unwrap_or((0.0, 0.0));
    let resolutions = finite_range(rows.iter().map(|r| f64::from(r.params.resolution()))).unwrap_or((0.0, 0.0));
    (Axis::linear(gammas, LEFT + room, RIGHT - room), Axis::linear(resolutions, BOTTOM - room, TOP + room))
}

fn frame(x: &Axis, y: &Axis) -> String {
    let name = svg::text("tick", (LEFT - 6.0, 12.0), "end", "r");
    svg::vertical_axis(y, LEFT, RIGHT) + &svg::horizontal_axis(x, BOTTOM, "gamma", false) + &name
}

fn figure(title: &str, note: &str, drawing: &str) -> String {
    let (title, note) = (escape(title), escape(note));
    format!("<figure><figcaption><b>{title}</b><span class=\"note\">{note}</span></figcaption>{drawing}</figure>")
}

/// Fig. 7: a circle for each trial, whose area is sigma, fill q and edge tau; of a fine grid every few.
pub(super) fn measurements(m: &StepStudy) -> String {
    let [every_r, every_gamma] = strides(&m.rows);
    let shown: Vec<&Trial> = every(&m.rows, every_r, every_gamma);
    let room = 15.0;
    let (x, y) = axes(&m.rows, room);
    let largest = shown.iter().map(|r| r.measured.cost.size_bytes).max().unwrap_or(1) as f64;
    let quality = finite_range(shown.iter().map(|r| r.measured.quality.psnr_db())).unwrap_or((0.0, 1.0));
    let times = finite_range(shown.iter().map(|r| ms(r))).unwrap_or((0.0, 1.0));
    let share = |value: f64, (low, high): (f64, f64)| ((value - low) / (high - low).max(1e-12)).clamp(0.0, 1.0);
    let circle = |row: &&Trial| {
        let size = row.measured.cost.size_bytes as f64;
        let q = row.measured.quality.psnr_db();
        let edge = 0.4 + 3.6 * share(ms(row), times);
        let looks = format!(
            " style=\"fill:{};stroke:var(--ink);stroke-width:{}\"",
            color_at(share(q, quality)),
            significant(edge, 2)
        );
        let (r, gamma) = (row.params.resolution(), significant(row.params.gamma(), 4));
        let words = format!("r {r}, gamma {gamma}: {}, {}, {} ms", bytes(size), decibels(q), fixed(ms(row), 1));
        let place = (x.at(row.params.gamma()), y.at(f64::from(row.params.resolution())));
        svg::circle("point", place, (room * 0.85 * (size / largest).sqrt()).max(1.2), &looks, &words)
    };
    let circles: String = shown.iter().map(circle).collect();
    let what = format!("Size, quality and time of every trial of {} step {}", m.name, m.step);
    let note = format!(
        "area: to {}; fill: {} to {} dB; edge: {} to {} ms",
        bytes(largest),
        fixed(quality.0, 1),
        fixed(quality.1, 1),
        fixed(times.0, 0),
        fixed(times.1, 0)
    );
    figure(
        &format!("{}, step {}", m.name, m.step),
        &note,
        &svg::drawing(WIDTH, HEIGHT, &what, &(frame(&x, &y) + &circles)),
    )
}

/// Of how many resolutions and gammas one is shown, so that circles stay apart.
fn strides(rows: &[Trial]) -> [usize; 2] {
    let mut resolutions: Vec<u32> = rows.iter().map(|r| r.params.resolution()).collect();
    let mut gammas: Vec<u64> = rows.iter().map(|r| r.params.gamma().to_bits()).collect();
    resolutions.sort_unstable();
    resolutions.dedup();
    gammas.sort_unstable();
    gammas.dedup();
    [resolutions.len().div_ceil(10), gammas.len().div_ceil(17)]
}

fn every(rows: &[Trial], r: usize, gamma: usize) -> Vec<&Trial> {
    let by_resolution = rows.chunk_by(|a, b| a.params.resolution() == b.params.resolution());
    by_resolution.step_by(r.max(1)).flat_map(|line| line.iter().step_by(gamma.max(1))).collect()
}

/// Fig. 8 and 9: where the best under each rising limit lies, limit by limit, and what it gives.
pub(super) fn best_under(m: &StepStudy, contracts: &[Contract]) -> String {
    let chosen: Vec<(&Contract, &Trial)> =
        contracts.iter().filter_map(|c| best(&m.rows, c).map(|n| (c, &m.rows[n]))).collect();
    let of = |value: fn(&Trial) -> f64| finite_range(chosen.iter().map(|(_, row)| value(row))).unwrap_or((0.0, 0.0));
    let x = Axis::fitting(of(|r| r.params.gamma()), LEFT + 24.0, RIGHT - 24.0);
    let y = Axis::linear(of(|r| f64::from(r.params.resolution())), BOTTOM - 24.0, TOP + 24.0);
    let place = |row: &Trial| (x.at(row.params.gamma()), y.at(f64::from(row.params.resolution())));
    let path: Vec<(f64, f64)> = chosen.iter().map(|(_, row)| place(row)).collect();
    let mut parts = frame(&x, &y) + &svg::line("path", &path);
    let mut lines = String::new();
    for (n, (contract, row)) in chosen.iter().enumerate() {
        let at = place(row);
        let q = decibels(row.measured.quality.psnr_db());
        let (r, gamma) = (row.params.resolution(), significant(row.params.gamma(), 3));
        parts += &svg::circle("stop", at, 4.0, "", &format!("{contract}: r {r}, gamma {gamma}, {q}"));
        // Limits that lead to the same place share a label, the first one's.
        if n == 0 || path[n - 1] != at {
            parts += &svg::text("tick", (at.0 + 8.0, at.1 - 7.0), "start", &format!("{}", n + 1));
        }
        let cells = [
            format!("{}", n + 1),
            limit(contract),
            r.to_string(),
            gamma,
            bytes(row.measured.cost.size_bytes as f64),
            q,
        ];
        let time = format!("{} ms", fixed(ms(row), 1));
        let cells: String = cells.iter().chain([&time]).map(|c| format!("<td>{}</td>", escape(c))).collect();
        lines += &format!("<tr>{cells}</tr>");
    }
    let kept = format!("{} of {} limits can be kept", chosen.len(), contracts.len());
    let what = format!("Best gamma and r under each limit, {} step {}", m.name, m.step);
    let head: String = ["", "limit", "r", "gamma", "size", "quality", "time"].map(|h| format!("<th>{h}</th>")).concat();
    let table =
        format!("<div class=\"scroll\"><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>");
    let drawing = svg::drawing(WIDTH, HEIGHT, &what, &parts);
    figure(&format!("{}, step {}", m.name, m.step), &kept, &(drawing + &table))
}

/// The one limit of a contract, for people.
pub(super) fn limit(contract: &Contract) -> String {
    match (contract.limits.size_bytes, contract.limits.time_ms) {
        (Some(size), _) => bytes(size as f64),
        (None, Some(time)) => format!("{} ms", significant(time, 4)),
        (None, None) => contract.to_string(),
    }
}
