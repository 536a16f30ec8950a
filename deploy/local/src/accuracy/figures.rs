//! Drawings of curves: decibels against a knob, against time and against size.

use super::curve::{Curve, Point, front};
use crate::report::html::escape;
use crate::report::numbers::{finite_range, fixed, significant};
use crate::report::svg::{self, Axis};
use lamina_model::decibels;

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 52.0;
/// Room on the right for the names of curves.
const RIGHT: f64 = WIDTH - 122.0;
const TOP: f64 = 22.0;
const BOTTOM: f64 = HEIGHT - 42.0;

/// One curve or cloud: a class for its looks, a name for its end, and what to say of each point.
pub struct Line {
    class: &'static str,
    name: String,
    points: Vec<(f64, f64, String)>,
}

/// What is along the horizontal axis.
#[derive(Clone, Copy)]
pub enum Across {
    /// The knob itself.
    Knob,
    /// Time, milliseconds.
    Time,
    /// Size, kilobytes.
    Size,
}

impl Across {
    fn of(self, curve: &Curve, point: &Point) -> Option<f64> {
        match self {
            Self::Knob => Some((curve.knob.plotted)(point.value)).filter(|x| *x > 0.0),
            Self::Time => Some(point.time_ms),
            Self::Size => point.kilobytes(),
        }
    }
}

/// Looks of the curves of one drawing, in their order.
const CLASSES: [&str; 6] = ["c0", "c1", "c2", "c3", "c4", "c5"];

/// The curves as lines.
pub fn lines(curves: &[&Curve], across: Across) -> Vec<Line> {
    let line = |(n, curve): (usize, &&Curve)| {
        let point = |p: &Point| {
            let x = across.of(curve, p)?;
            Some((x, p.decibels(), words(curve, p)))
        };
        let name = if curves.len() > 1 { curve.knob.title.to_lowercase() } else { "rms".to_owned() };
        Line { class: CLASSES[n % CLASSES.len()], name, points: curve.points.iter().filter_map(point).collect() }
    };
    curves.iter().enumerate().map(line).collect()
}

/// The greatest error anywhere, in decibels of its own.
pub fn greatest(curve: &Curve, across: Across) -> Line {
    let point = |p: &Point| {
        let max = p.error.max;
        Some((across.of(curve, p)?, decibels(max * max), format!("at most {max:.1e} anywhere")))
    };
    Line { class: "thin", name: "max-norm".into(), points: curve.points.iter().filter_map(point).collect() }
}

fn words(curve: &Curve, p: &Point) -> String {
    let size = p.kilobytes().map_or_else(String::new, |kb| format!(", {} kB", significant(kb, 4)));
    let (title, value) = (curve.knob.title, significant(p.value, 5));
    format!("{title} {value}: {} dB, {} ms{size}", fixed(p.decibels(), 2), significant(p.time_ms, 3))
}

/// What nothing beats among `trials`, and all of them as dots.
pub fn front_lines(trials: &[Point], across: Across) -> [Line; 2] {
    let cost = |p: &Point| match across {
        Across::Size => p.kilobytes().unwrap_or(f64::NAN),
        Across::Knob | Across::Time => p.time_ms,
    };
    let costs: Vec<(f64, f64)> = trials.iter().map(|p| (cost(p), p.error.rms)).collect();
    let point = |n: usize| (costs[n].0, trials[n].decibels(), setting(&trials[n]));
    [
        Line { class: "trials", name: String::new(), points: (0..trials.len()).map(point).collect() },
        Line { class: "front", name: "front".into(), points: front(&costs).into_iter().map(point).collect() },
    ]
}

/// The generation parameters of a trial, for people.
pub fn setting(p: &Point) -> String {
    let Some(params) = p.params else { return String::new() };
    let cutoff = match params.opacity_cutoff() {
        1.0 => String::new(),
        other => format!(", cut-off {}", significant(other, 5)),
    };
    let (r, gamma, step) = (params.resolution(), significant(params.gamma(), 4), significant(params.step_voxels(), 4));
    format!("r {r}, gamma {gamma}, step {step}{cutoff}")
}

/// A figure with its caption.
pub fn figure(title: &str, note: &str, drawing: &str) -> String {
    let (title, note) = (escape(title), escape(note));
    format!("<figure><figcaption><b>{title}</b><span class=\"note\">{note}</span></figcaption>{drawing}</figure>")
}

/// A drawing by itself.
pub fn drawing(what: &str, x_name: &str, lines: &[Line]) -> String {
    svg::drawing(WIDTH, HEIGHT, what, &panel(x_name, lines))
}

/// Several drawings side by side, as a file of their own.
pub fn file(what: &str, style: &str, panels: &[String]) -> String {
    let shifted =
        |(n, panel): (usize, &String)| format!("<g transform=\"translate({} 0)\">{panel}</g>", WIDTH * n as f64);
    let content: String = panels.iter().enumerate().map(shifted).collect();
    let width = WIDTH * panels.len() as f64;
    let ground = format!("<style>{style}</style><rect class=\"ground\" width=\"{width}\" height=\"{HEIGHT}\"/>");
    svg::drawing(width, HEIGHT, what, &(ground + &content)).replacen(
        "<svg ",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" ",
        1,
    )
}

/// Axes and lines.
pub fn panel(x_name: &str, lines: &[Line]) -> String {
    let all = || lines.iter().flat_map(|l| &l.points).filter(|p| p.0.is_finite() && p.1.is_finite());
    let (Some(xs), Some(ys)) = (finite_range(all().map(|p| p.0)), finite_range(all().map(|p| p.1))) else {
        return svg::text("tick", (0.5 * WIDTH, 0.5 * HEIGHT), "middle", "nothing that differs");
    };
    let margin = (0.04 * (ys.1 - ys.0)).max(0.2);
    let x = Axis::fitting(xs, LEFT + 8.0, RIGHT);
    let y = Axis::linear((ys.0 - margin, ys.1 + margin), BOTTOM, TOP);
    let mut parts = svg::vertical_axis(&y, LEFT, RIGHT) + &svg::horizontal_axis(&x, BOTTOM, x_name, false);
    parts += &svg::text("tick", (LEFT - 6.0, 12.0), "end", "dB");
    let mut ends = Vec::new();
    for line in lines {
        let finite = line.points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
        let places: Vec<((f64, f64), &str)> = finite.map(|p| ((x.at(p.0), y.at(p.1)), p.2.as_str())).collect();
        let path: Vec<(f64, f64)> = places.iter().map(|p| p.0).collect();
        let dot = |(at, words): &((f64, f64), &str)| svg::circle(line.class, *at, 2.5, "", words);
        if line.class != "trials" {
            parts += &svg::line(line.class, &path);
        }
        parts += &places.iter().map(dot).collect::<String>();
        // A curve's name stands beside its rightmost point.
        ends.extend(path.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|at| (at.1, line)));
    }
    parts + &names(ends)
}

/// Names at the right, from the top downwards, pushed apart where they would overlap.
fn names(mut ends: Vec<(f64, &Line)>) -> String {
    ends.retain(|(_, line)| !line.name.is_empty());
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = f64::NEG_INFINITY;
    let name = |(at, line): (f64, &Line)| {
        let at = at.max(free);
        free = at + 14.0;
        let mark = svg::line(line.class, &[(RIGHT + 6.0, at), (RIGHT + 16.0, at)]);
        mark + &svg::text("tick", (RIGHT + 20.0, at + 4.0), "start", &line.name)
    };
    ends.into_iter().map(name).collect()
}
