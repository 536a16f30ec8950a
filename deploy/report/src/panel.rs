//! Plots of quality curves: decibels on the vertical axis, any quantity on the horizontal one.

use super::numbers::finite_range;
use super::svg::{self, Axis};

/// The style sheet of pages that hold these plots.
pub const PANEL_STYLE: &str = concat!(include_str!("report.css"), include_str!("panel.css"));

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 52.0;
/// Room on the right for the names of curves.
const RIGHT: f64 = WIDTH - 122.0;
const TOP: f64 = 22.0;
const BOTTOM: f64 = HEIGHT - 42.0;

/// One curve of a plot, or one set of unconnected points.
#[derive(Debug)]
pub struct PlotLine {
    /// CSS class of the style sheet that colors it; class `trials` has points without a connecting line.
    pub class: &'static str,
    /// Label at the end of the curve; empty for none.
    pub name: String,
    /// For each point: horizontal value, decibels, and its tooltip.
    pub points: Vec<(f64, f64, String)>,
}

/// CSS classes of the curves of one plot, in their order.
pub const CLASSES: [&str; 10] = ["c0", "c1", "c2", "c3", "c4", "c5", "c6", "c7", "c8", "c9"];

/// A plot as an inline SVG element.
pub fn drawing(what: &str, x_name: &str, lines: &[PlotLine]) -> String {
    svg::drawing(WIDTH, HEIGHT, what, &panel(x_name, lines))
}

/// Several plots side by side as a standalone SVG file with its style sheet.
pub fn file(what: &str, panels: &[String]) -> String {
    let shifted =
        |(n, panel): (usize, &String)| format!("<g transform=\"translate({} 0)\">{panel}</g>", WIDTH * n as f64);
    let content: String = panels.iter().enumerate().map(shifted).collect();
    let width = WIDTH * panels.len() as f64;
    let style = concat!(include_str!("file.css"), include_str!("panel.css"));
    let ground = format!("<style>{style}</style><rect class=\"ground\" width=\"{width}\" height=\"{HEIGHT}\"/>");
    svg::drawing(width, HEIGHT, what, &(ground + &content)).replacen(
        "<svg ",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" ",
        1,
    )
}

/// The content of one plot: axes, curves and labels, without the enclosing SVG element.
pub fn panel(x_name: &str, lines: &[PlotLine]) -> String {
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

/// Labels of curves at the right edge, shifted downwards where they would overlap.
fn names(mut ends: Vec<(f64, &PlotLine)>) -> String {
    ends.retain(|(_, line)| !line.name.is_empty());
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = f64::NEG_INFINITY;
    let name = |(at, line): (f64, &PlotLine)| {
        let at = at.max(free);
        free = at + 14.0;
        let mark = svg::line(line.class, &[(RIGHT + 6.0, at), (RIGHT + 16.0, at)]);
        mark + &svg::text("tick", (RIGHT + 20.0, at + 4.0), "start", &line.name)
    };
    ends.into_iter().map(name).collect()
}
