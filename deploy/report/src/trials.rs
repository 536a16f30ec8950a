//! Plots of the tuner's trials: for each tuned time step, resolution against gamma, with size as area and PSNR as fill.

use super::numbers::{bytes, counted, decibels, finite_range, fixed, kilobytes, significant};
use super::svg::{self, Axis};
use super::{Limit, ReportTrial, html};

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 300.0;
const LARGEST_RADIUS: f64 = 15.0;

/// A color map from dark to bright in even steps of lightness, so that its order survives a monochrome print.
const PSNR_COLORS: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// Value ranges that all plots share, so that they can be compared.
struct Scales {
    gamma: (f64, f64),
    resolution: (f64, f64),
    psnr_db: (f64, f64),
    largest_bytes: u64,
}

impl Scales {
    fn of(trials: &[ReportTrial]) -> Self {
        let range = |value: fn(&ReportTrial) -> f64| finite_range(trials.iter().map(value)).unwrap_or((0.0, 0.0));
        Self {
            gamma: range(|t| t.gamma),
            resolution: range(|t| f64::from(t.resolution)),
            psnr_db: range(|t| t.psnr_db),
            largest_bytes: trials.iter().map(|t| t.size_bytes).max().unwrap_or(0),
        }
    }

    /// The radius of the circle whose area is proportional to a size; at least 1.5 pixels.
    fn radius(&self, size_bytes: u64) -> f64 {
        let share = size_bytes as f64 / self.largest_bytes.max(1) as f64;
        (LARGEST_RADIUS * share.sqrt()).max(1.5)
    }

    fn color(&self, psnr_db: f64) -> String {
        let (low, high) = self.psnr_db;
        let t = if psnr_db == f64::INFINITY { 1.0 } else { (psnr_db - low) / (high - low) };
        color_at(if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.5 })
    }
}

/// The color of `t` in 0..=1 on the map of PSNR, as `#rrggbb`.
pub fn color_at(t: f64) -> String {
    let place = t * (PSNR_COLORS.len() - 1) as f64;
    let lower = (place as usize).min(PSNR_COLORS.len() - 2);
    let part = place - lower as f64;
    let mix = |k: usize| (PSNR_COLORS[lower][k] * (1.0 - part) + PSNR_COLORS[lower + 1][k] * part).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

/// The section of trials: plots, legend and table; empty without trials.
pub(super) fn section(trials: &[ReportTrial], limit: &Limit) -> String {
    if trials.is_empty() {
        return String::new();
    }
    let scales = Scales::of(trials);
    let mut sorted: Vec<&ReportTrial> = trials.iter().collect();
    sorted.sort_by_key(|t| t.step);
    let figures: String = sorted.chunk_by(|a, b| a.step == b.step).map(|rows| figure(rows, &scales, limit)).collect();
    let content = format!("{}<div class=\"plots\">{figures}</div>{}", legend(&scales, limit), table(&sorted, limit));
    html::section("Trials", &content)
}

fn figure(rows: &[&ReportTrial], scales: &Scales, limit: &Limit) -> String {
    let step = rows[0].step;
    let count = counted(rows.len(), "trial");
    let note = rows.iter().find(|t| t.chosen).map_or("none chosen".into(), |t| {
        format!(
            "chosen: {} r {}, gamma {}, {}",
            t.representation,
            t.resolution,
            significant(t.gamma, 3),
            decibels(t.psnr_db)
        )
    });
    let head = format!("<b>Step {step}</b> <span>{count}</span><span class=\"note\">{note}</span>");
    format!("<figure><figcaption>{head}</figcaption>{}</figure>", drawing(rows, scales, limit))
}

fn drawing(rows: &[&ReportTrial], scales: &Scales, limit: &Limit) -> String {
    let (left, right, bottom) = (52.0, WIDTH - 12.0, HEIGHT - 42.0);
    let pad = LARGEST_RADIUS + 4.0;
    let x = Axis::fitting(scales.gamma, left + pad, right - pad);
    let y = Axis::linear(scales.resolution, bottom - pad, pad);
    let mut parts = vec![svg::vertical_axis(&y, left, right), svg::horizontal_axis(&x, bottom, "gamma", false)];
    // Large circles first, so that none hides a smaller one; the chosen one's ring above all.
    let mut by_size = rows.to_vec();
    by_size.sort_by_key(|t| std::cmp::Reverse(t.size_bytes));
    let place = |t: &ReportTrial| (x.at(t.gamma), y.at(f64::from(t.resolution)));
    for trial in &by_size {
        let class = if limit.holds(trial.size_bytes, trial.generation_ms) { "trial" } else { "trial over" };
        let fill = format!(" fill=\"{}\"", scales.color(trial.psnr_db));
        parts.push(svg::circle(class, place(trial), scales.radius(trial.size_bytes), &fill, &words(trial)));
    }
    let chosen = by_size.iter().filter(|t| t.chosen);
    parts.extend(chosen.map(|t| svg::circle("chosen", place(t), scales.radius(t.size_bytes) + 3.5, "", "")));
    let name = svg::text("tick", (left - 6.0, 12.0), "end", "r");
    svg::drawing(WIDTH, HEIGHT, "Resolution against gamma of each trial", &(parts.concat() + &name))
}

fn words(t: &ReportTrial) -> String {
    let (gamma, size, time) = (significant(t.gamma, 3), bytes(t.size_bytes as f64), fixed(t.generation_ms, 1));
    format!("{} r {}, gamma {gamma}: {size}, {}, {time} ms", t.representation, t.resolution, decibels(t.psnr_db))
}

/// The legend of fill and area.
fn legend(scales: &Scales, limit: &Limit) -> String {
    let (low, high) = scales.psnr_db;
    let bar: String = (0..24)
        .map(|k| {
            let color = color_at(f64::from(k) / 23.0);
            format!("<rect x=\"{}\" y=\"14\" width=\"6.5\" height=\"12\" fill=\"{color}\"/>", 60 + 6 * k)
        })
        .collect();
    let ends = svg::text("tick", (54.0, 24.0), "end", &fixed(low, 1))
        + &svg::text("tick", (210.0, 24.0), "start", &format!("{} dB", fixed(high, 1)));
    let sizes: String = [(0.25, 300.0), (1.0, 400.0)]
        .map(|(share, x)| {
            let size = (scales.largest_bytes as f64 * share) as u64;
            let r = scales.radius(size);
            svg::circle("trial", (x, 20.0), r, " fill=\"none\"", "")
                + &svg::text("tick", (x + r + 5.0, 24.0), "start", &bytes(size as f64))
        })
        .concat();
    let key = svg::drawing(WIDTH, 40.0, "Key: fill is PSNR, area is size", &(bar + &ends + &sizes));
    let over = match (limit.size_bytes, limit.time_ms) {
        (None, None) => "",
        _ => ", a dashed edge breaks the limit",
    };
    format!("<div class=\"key\"><p>Fill is PSNR, area is size, a ring is what the tuner chose{over}.</p>{key}</div>")
}

fn table(sorted: &[&ReportTrial], limit: &Limit) -> String {
    let head = ["step", "as", "r", "gamma", "size kB", "generation ms", "encode ms", "PSNR dB", ""];
    let row = |t: &&ReportTrial| {
        let mark = match (t.chosen, limit.holds(t.size_bytes, t.generation_ms)) {
            (true, true) => "chosen",
            (true, false) => "chosen, over the limit",
            (false, true) => "",
            (false, false) => "over the limit",
        };
        let cells = vec![
            t.step.to_string(),
            t.representation.to_string(),
            t.resolution.to_string(),
            significant(t.gamma, 4),
            fixed(kilobytes(t.size_bytes), 1),
            fixed(t.generation_ms, 2),
            fixed(t.encode_ms, 2),
            fixed(t.psnr_db, 2),
            mark.into(),
        ];
        (cells, t.chosen)
    };
    html::table("All trials", &head.map(String::from), sorted.iter().map(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_stands_for_size() {
        let scales = Scales { gamma: (0.0, 1.0), resolution: (1.0, 2.0), psnr_db: (30.0, 40.0), largest_bytes: 400 };
        assert_eq!((scales.radius(400), scales.radius(100)), (LARGEST_RADIUS, LARGEST_RADIUS / 2.0));
        assert_eq!((scales.color(30.0), scales.color(f64::INFINITY)), ("#440154".into(), "#fde725".into()));
        assert_eq!(scales.color(35.0), "#21918c");
    }

    #[test]
    fn every_tuned_step_has_its_drawing_and_one_ring() {
        let trial = |step, gamma, chosen| ReportTrial {
            step,
            gamma,
            chosen,
            resolution: 64,
            size_bytes: 10,
            psnr_db: 30.0,
            ..ReportTrial::default()
        };
        let trials = [trial(40, 0.1, true), trial(0, 0.1, false), trial(40, 0.01, false), trial(0, 0.02, true)];
        let html = section(&trials, &Limit::default());
        assert_eq!((html.matches("<figure>").count(), html.matches("class=\"chosen\" cx").count()), (2, 2));
        assert!(html.find("Step 0") < html.find("Step 40"));
    }
}
