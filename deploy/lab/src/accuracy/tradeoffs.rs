//! Across knobs: the front, the cheapest settings that reach a stated quality, and what one more decibel costs.

use super::choice::{best, cheapest as cheapest_of};
use super::curve::{ErrorCurve, Point, Price, front};
use super::figures::{self, Across};
use super::{Findings, sweeps};
use lamina_report::html::{self, escape};
use lamina_report::numbers::{fixed, significant};
use lamina_report::panel::{PlotLine, drawing};

/// The knobs of a VDI, each through the base, with the front of everything tried.
pub(super) fn overview(findings: &Findings, across: Across) -> Vec<PlotLine> {
    let keys = [sweeps::STEP.key, sweeps::CUTOFF.key, sweeps::GAMMA.key, sweeps::RESOLUTION.key];
    let curves: Vec<&ErrorCurve> = keys.iter().filter_map(|key| findings.curve(key)).collect();
    let [trials, front] = figures::front_lines(&findings.trials, across);
    [trials].into_iter().chain(figures::lines(&curves, across)).chain([front]).collect()
}

/// The cheapest settings that reach the quality asked for, a line each.
pub(super) fn cheapest(findings: &Findings) -> Vec<String> {
    let db = findings.psnr_db;
    let (vdis, cast) = (&findings.trials, findings.curve(sweeps::RAYCAST_STEP.key).map_or(&[][..], |c| &c.points));
    let vdi = |what: &str, p: Option<&Point>| match (p, best(vdis)) {
        (Some(p), _) => format!(
            "{db} dB, least {what}: {}: {} dB, {} ms, {} kB",
            figures::setting(p),
            fixed(p.decibels(), 2),
            fixed(p.time_ms, 1),
            fixed(p.kilobytes().unwrap_or(f64::NAN), 1)
        ),
        (None, Some(best)) => {
            format!(
                "{db} dB: no VDI tried reaches it; the best is {}: {} dB",
                figures::setting(best),
                fixed(best.decibels(), 2)
            )
        }
        (None, None) => format!("{db} dB: no VDI was made"),
    };
    let ray = cheapest_of(cast, db, |p| Some(p.time_ms)).map_or_else(
        || format!("{db} dB: no step tried reaches it by ray casting"),
        |p| {
            format!(
                "{db} dB, ray casting: step {} voxels: {} dB, {} ms a picture",
                p.value,
                fixed(p.decibels(), 2),
                fixed(p.time_ms, 1)
            )
        },
    );
    let mut said = vec![
        vdi("time", cheapest_of(vdis, db, |p| Some(p.time_ms))),
        vdi("size", cheapest_of(vdis, db, Point::kilobytes)),
        ray,
    ];
    said.dedup();
    said
}

/// What all knobs offer together.
pub(super) fn across(findings: &Findings) -> String {
    let drawn = |title: &str, name: &str, across| {
        figures::figure(title, "all VDIs tried", &drawing(title, name, &overview(findings, across)))
    };
    let said: String = cheapest(findings).iter().map(|line| format!("<li>{}</li>", escape(line))).collect();
    let costs: Vec<(f64, f64)> = findings.trials.iter().map(|p| (p.time_ms, p.error.rms)).collect();
    let head = ["within ms", "best dB", "max-norm", "setting", "kB", "encode ms", "draw ms"].map(String::from);
    let on_front: Vec<&Point> = front(&costs).into_iter().map(|n| &findings.trials[n]).collect();
    let line = |p: &&Point| {
        (
            vec![
                fixed(p.time_ms, 1),
                fixed(p.decibels(), 2),
                significant(p.error.max, 2),
                figures::setting(p),
                optional(p.kilobytes()),
                optional(p.encode_ms),
                optional(p.draw_ms),
            ],
            false,
        )
    };
    let table = html::table("The best error within a time", &head, on_front.iter().map(line));
    html::section(
        "Across knobs",
        &format!(
            "<div class=\"plots\">{}{}</div><ul>{said}</ul>{}{table}",
            drawn("Quality against time", "ms of generation", Across::Time),
            drawn("Quality against size", "kB", Across::Size),
            from_base(findings)
        ),
    )
}

/// What one more decibel costs from the base on, by each knob: towards the next finer point that has a price.
fn from_base(findings: &Findings) -> String {
    let turned = sweeps::of_generation(&findings.base);
    let line = |t: &sweeps::ParameterSweep| {
        let curve = findings.curve(t.knob.key)?;
        let at_base = curve.points.iter().position(|p| p.params == Some(findings.base))?;
        let prices = curve.prices();
        let next = |price: fn(&Price) -> Option<f64>| {
            let found = (at_base + 1..curve.points.len()).find_map(|n| Some((n, price(&prices[n])?)));
            found.map_or_else(
                || "none to be had".to_owned(),
                |(n, price)| format!("{} (to {})", significant(price, 3), significant(curve.points[n].value, 5)),
            )
        };
        Some((vec![t.knob.title.to_owned(), next(|p| p.ms_per_db), next(|p| p.kb_per_db)], false))
    };
    let head = ["from the base on, by", "ms per dB", "kB per dB"].map(String::from);
    let lines: Vec<(Vec<String>, bool)> = turned.iter().filter_map(line).collect();
    html::table("What one more decibel costs", &head, lines.into_iter())
}

/// A number that there may be none of.
pub(super) fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| fixed(v, 1))
}
