//! `report.html` and `accuracy.svg`.

use super::curve::ErrorCurve;
use super::figures::{self, Across};
use super::reference::{AGREEMENT_DB, Reference};
use super::tradeoffs::{across, optional, overview};
use super::{Findings, sweeps};
use anyhow::Context;
use lamina_model::Volume;
use lamina_report::html::{self, escape};
use lamina_report::numbers::{decibels, fixed, significant};
use lamina_report::panel::{PANEL_STYLE, drawing, file, panel};
use std::path::Path;

/// Curves that belong together: heading, what is to be known of them, their keys.
const GROUPS: [(&str, &str, &[&str]); 11] = [
    (
        "Sampling step: ray casting",
        "The product's ray caster, and the one that integrates the transfer function over each step; time is that of a whole \
         picture. Rays end at 100 dB.",
        &["raycast_step", "raycast_step_integrated"],
    ),
    (
        "Sampling step: VDI",
        "Time is the median of three generations, without and with the transfer function integrated over each step; bytes are \
         those of the VDI, encoded once.",
        &["step", "step_integrated"],
    ),
    (
        "Opacity cut-off",
        "Rays of the VDI end where they are this opaque; drawn from aside, what they left out is seen.",
        &["opacity_cutoff"],
    ),
    ("Gamma", "The interrupt parameter: of supersegments that are fitted, as here, the price of one.", &["gamma"]),
    ("Resolution", "Rays of the VDI along each side.", &["resolution"]),
    (
        "Blending",
        "A novel view takes the nearest rays of the VDI, or blends those around, as all other figures here do; time is that of \
         drawing a picture.",
        &["blended"],
    ),
    (
        "Stored bits of color and opacity",
        "The base's VDI rounded before it is encoded, and not by the codec, which goes by gamma else. It stores 8 bits a channel, so \
         that fewer save only what its compressor finds, and 10 and 12 are drawn without being encoded.",
        &["color_bits"],
    ),
    (
        "Stored bits of depth",
        "The base's VDI with depths counted in longer steps, the most bits being those the data takes. What gets shorter \
         than half a step joins what lies behind it.",
        &["depth_bits"],
    ),
    (
        "Sums and pre-integration",
        "The plain integrator, all variants in the same code; time is that of the sampled rays, scaled to a whole picture, and \
         compares within this section and the next only.",
        &["midpoint_f64", "midpoint_f32", "preintegrated"],
    ),
    (
        "Interpolation",
        "The plain integrator at the base's step, on all voxels and on every second, fourth and eighth. The reference is the \
         trilinear field of all voxels, as the product draws it: at a distance of 1 what the others differ by is no error of \
         theirs but another field. Tricubic is Catmull-Rom.",
        &["nearest", "trilinear", "tricubic"],
    ),
    (
        "The quality sample",
        "How far the RMS error that smaller whole pictures tell is from that of pictures of full size, the product's own ray \
         casting being the reference; time is that of all views, cast and drawn.",
        &["sample_px"],
    ),
];

/// Writes the page and the picture.
pub(super) fn write(folder: &Path, findings: &Findings, volume: &Volume, command: &str) -> anyhow::Result<()> {
    let mut parts = vec![heading(findings, volume, command), trust(findings), across(findings)];
    for (title, words, keys) in GROUPS {
        let curves: Vec<&ErrorCurve> = keys.iter().filter_map(|key| findings.curve(key)).collect();
        parts.push(group(findings, title, words, &curves));
    }
    parts.push(table(findings));
    let page = html::document("Accuracy against time", PANEL_STYLE, &parts);
    let save = |name: &str, text: String| {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("{}: cannot be written", path.display()))
    };
    save("report.html", page)?;
    let panels =
        [("ms of generation", Across::Time), ("kB", Across::Size)].map(|(name, a)| panel(name, &overview(findings, a)));
    save("accuracy.svg", file("Quality of a VDI against time and size, by what is turned", &panels))
}

fn heading(findings: &Findings, volume: &Volume, command: &str) -> String {
    let base = &findings.base;
    let [x, y, z] = volume.grid().dims();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let entries = [
        ("Volume", format!("{x} x {y} x {z}, {}", volume.voxels().voxel_type())),
        (
            "Base setting",
            format!("r {}, gamma {}, step {} voxels, no cut-off", base.resolution(), base.gamma(), base.step_voxels()),
        ),
        (
            "Pictures",
            format!("{0} x {0}, rotated by 10 to 60 degrees; {1} rays compared", findings.size, findings.rays),
        ),
        ("Machine", format!("{cores} cores, {}, {}", std::env::consts::ARCH, std::env::consts::OS)),
        ("Command", command.to_owned()),
    ];
    let entry = |(name, text): (&str, String)| format!("<dt>{name}</dt><dd>{}</dd>", escape(&text));
    let entries: String = entries.into_iter().map(entry).collect();
    format!("<header><h1>Accuracy against time</h1><dl class=\"origin\">{entries}</dl></header>\n")
}

/// What the reference is worth, in a sentence.
pub(super) fn reference_words(reference: &Reference) -> String {
    let order = if reference.order.is_finite() { significant(reference.order, 2) } else { "unknown".to_owned() };
    let reached = if reference.is_converged() { "converged" } else { "not converged" };
    format!(
        "reference {reached} at a step of {} voxels: pictures of this step and of twice it agree to {} (asked for: {AGREEMENT_DB} dB), \
         observed order {order}, own error by Richardson {}",
        reference.step_voxels,
        decibels(reference.agreement.decibels()),
        decibels(reference.own_db())
    )
}

fn trust(findings: &Findings) -> String {
    let met = |m: &super::closed_forms::Met| {
        format!(
            "<li>{}: {}, at most {} off</li>",
            escape(m.name),
            decibels(m.error.decibels()),
            format_args!("{:.0e}", m.error.max)
        )
    };
    let forms: String = findings.closed_forms.iter().map(met).collect();
    let words = escape(&reference_words(&findings.reference));
    let max = format!("{:.0e}", findings.reference.agreement.max);
    html::section(
        "The reference",
        &format!(
            "<p>Before it was used it met:</p><ul>{forms}</ul><p>On this data: {words}; the two differ by at most {max} anywhere.</p>"
        ),
    )
}

/// How a curve falls, in words.
fn order_words(findings: &Findings, curve: &ErrorCurve) -> String {
    let found = findings.convergence(curve);
    let order = found.order.map_or_else(String::new, |o| format!("order {}", fixed(o, 2)));
    let level = found.level_from.map_or_else(String::new, |v| format!("levels off from {}", significant(v, 5)));
    let both: Vec<String> = [order, level].into_iter().filter(|w| !w.is_empty()).collect();
    if both.is_empty() { "no order".to_owned() } else { both.join(", ") }
}

fn group(findings: &Findings, title: &str, words: &str, curves: &[&ErrorCurve]) -> String {
    let Some(first) = curves.first() else { return String::new() };
    let knob = first.knob;
    let named = |c: &&ErrorCurve| {
        let name = if curves.len() > 1 { format!("{}: ", c.knob.title) } else { String::new() };
        format!("{name}{}", order_words(findings, c))
    };
    let note = curves.iter().map(named).collect::<Vec<String>>().join("; ");
    let x_name = if knob.unit.is_empty() { knob.title.to_lowercase() } else { knob.unit.to_owned() };
    let plot = |what: &str, name: &str, across| {
        let mut lines = figures::lines(curves, across);
        if let (Across::Parameter, [curve]) = (across, curves) {
            lines.push(figures::greatest(curve, across));
        }
        figures::figure(what, "", &drawing(&format!("{title}: {what}"), name, &lines))
    };
    let mut plots = plot("Quality by value", &x_name, Across::Parameter);
    if first.points.windows(2).any(|w| w[0].time_ms != w[1].time_ms) {
        plots += &plot("Quality by time", "ms", Across::Time);
    }
    if first.points.iter().any(|p| p.size_bytes.is_some()) {
        plots += &plot("Quality by size", "kB", Across::Size);
    }
    let extra = if knob.key == sweeps::MIDPOINT.key {
        let apart = decibels(findings.single.decibels());
        format!("<p>Sums in single precision and in double agree to {apart} or better at every step.</p>")
    } else {
        String::new()
    };
    let content = format!("<p>{}</p><p>{}.</p>{extra}<div class=\"plots\">{plots}</div>", escape(words), escape(&note));
    html::section(title, &content)
}

fn table(findings: &Findings) -> String {
    let head = [
        "knob",
        "value",
        "of",
        "dB",
        "max-norm",
        "alone dB",
        "ms",
        "encode ms",
        "draw ms",
        "kB",
        "ms per dB",
        "kB per dB",
    ];
    let price = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| significant(v, 3));
    let mut lines = Vec::new();
    for curve in &findings.curves {
        for (p, prices) in curve.points.iter().zip(curve.prices()) {
            let cells = vec![
                curve.knob.title.to_owned(),
                significant(p.value, 6),
                curve.knob.source.name().to_owned(),
                fixed(p.decibels(), 2),
                significant(p.error.max, 2),
                p.alone.map_or_else(|| "–".to_owned(), |e| fixed(e.decibels(), 2)),
                fixed(p.time_ms, 2),
                optional(p.encode_ms),
                optional(p.draw_ms),
                optional(p.kilobytes()),
                price(prices.ms_per_db),
                price(prices.kb_per_db),
            ];
            lines.push((cells, false));
        }
    }
    let words = "A price stands between a point and the next cheaper one that nothing of its knob beats. Alone: against the knob's own \
                 finest value.";
    let table = html::table("All points", &head.map(String::from), lines.into_iter());
    html::section("Every point", &format!("<p>{words}</p>{table}"))
}
