//! Curves as they are drawn: decibels against a knob, against time and against size.

use super::curve::{ErrorCurve, Point, front};
use lamina_model::decibels;
use lamina_report::html::escape;
use lamina_report::numbers::{fixed, significant};
use lamina_report::panel::{CLASSES, PlotLine};

/// What is along the horizontal axis.
#[derive(Clone, Copy)]
pub(super) enum Across {
    /// The knob itself.
    Parameter,
    /// Time, milliseconds.
    Time,
    /// Size, kilobytes.
    Size,
}

impl Across {
    fn of(self, curve: &ErrorCurve, point: &Point) -> Option<f64> {
        match self {
            Self::Parameter => Some((curve.knob.plotted)(point.value)).filter(|x| *x > 0.0),
            Self::Time => Some(point.time_ms),
            Self::Size => point.kilobytes(),
        }
    }
}

/// The curves as lines.
pub(super) fn lines(curves: &[&ErrorCurve], across: Across) -> Vec<PlotLine> {
    let line = |(n, curve): (usize, &&ErrorCurve)| {
        let point = |p: &Point| {
            let x = across.of(curve, p)?;
            Some((x, p.decibels(), words(curve, p)))
        };
        let name = if curves.len() > 1 { curve.knob.title.to_lowercase() } else { "rms".to_owned() };
        PlotLine { class: CLASSES[n % CLASSES.len()], name, points: curve.points.iter().filter_map(point).collect() }
    };
    curves.iter().enumerate().map(line).collect()
}

/// The greatest error anywhere, in decibels of its own.
pub(super) fn greatest(curve: &ErrorCurve, across: Across) -> PlotLine {
    let point = |p: &Point| {
        let max = p.error.max;
        Some((across.of(curve, p)?, decibels(max * max), format!("at most {max:.1e} anywhere")))
    };
    PlotLine { class: "thin", name: "max-norm".into(), points: curve.points.iter().filter_map(point).collect() }
}

fn words(curve: &ErrorCurve, p: &Point) -> String {
    let size = p.kilobytes().map_or_else(String::new, |kb| format!(", {} kB", significant(kb, 4)));
    let (title, value) = (curve.knob.title, significant(p.value, 5));
    format!("{title} {value}: {} dB, {} ms{size}", fixed(p.decibels(), 2), significant(p.time_ms, 3))
}

/// What nothing beats among `trials`, and all of them as dots.
pub(super) fn front_lines(trials: &[Point], across: Across) -> [PlotLine; 2] {
    let cost = |p: &Point| match across {
        Across::Size => p.kilobytes().unwrap_or(f64::NAN),
        Across::Parameter | Across::Time => p.time_ms,
    };
    let costs: Vec<(f64, f64)> = trials.iter().map(|p| (cost(p), p.error.rms)).collect();
    let point = |n: usize| (costs[n].0, trials[n].decibels(), setting(&trials[n]));
    [
        PlotLine { class: "trials", name: String::new(), points: (0..trials.len()).map(point).collect() },
        PlotLine { class: "front", name: "front".into(), points: front(&costs).into_iter().map(point).collect() },
    ]
}

/// The generation parameters of a trial, for people.
pub(super) fn setting(p: &Point) -> String {
    let Some(params) = p.params else { return String::new() };
    let cutoff = match params.opacity_cutoff() {
        1.0 => String::new(),
        other => format!(", cut-off {}", significant(other, 5)),
    };
    let (r, gamma, step) = (params.resolution(), significant(params.gamma(), 4), significant(params.step_voxels(), 4));
    let pre_integrated = if p.pre_integrated { ", pre-integrated" } else { "" };
    format!("r {r}, gamma {gamma}, step {step}{cutoff}{pre_integrated}")
}

/// A figure with its caption.
pub(super) fn figure(title: &str, note: &str, drawing: &str) -> String {
    let (title, note) = (escape(title), escape(note));
    format!("<figure><figcaption><b>{title}</b><span class=\"note\">{note}</span></figcaption>{drawing}</figure>")
}
