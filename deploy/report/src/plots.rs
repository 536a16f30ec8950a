//! Plots over time steps: size, generation time, PSNR, resolution and gamma.

use super::numbers::{counted, finite_range, kilobytes, significant};
use super::svg::{self, Axis};
use super::{Limit, ReportStep, html};

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 220.0;
const LEFT: f64 = 52.0;
/// Room on the right for the names of lines.
const RIGHT: f64 = 442.0;
const TOP: f64 = 16.0;
const BOTTOM: f64 = 180.0;

/// One curve: points as (step, value), and a label for its end.
struct Curve {
    class: &'static str,
    points: Vec<(f64, f64)>,
    name: String,
}

impl Curve {
    fn of(steps: &[ReportStep], class: &'static str, value: impl Fn(&ReportStep) -> Option<f64>) -> Self {
        let point = |row: &ReportStep| value(row).filter(|v| !v.is_nan()).map(|v| (row.step as f64, v));
        Self { class, points: steps.iter().filter_map(point).collect(), name: String::new() }
    }

    /// The curve as a staircase, for a value that holds until it is set again.
    fn held(mut self) -> Self {
        let corners = self.points.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
        self.points = corners.chain(self.points.last().copied()).collect();
        self
    }
}

/// One plot over time steps.
struct Plot {
    title: &'static str,
    unit: &'static str,
    curves: Vec<Curve>,
    limit: Option<f64>,
    from_zero: bool,
}

/// All plots over steps; nothing if there is no step.
pub(super) fn section(steps: &[ReportStep], limit: &Limit) -> String {
    if steps.is_empty() {
        return String::new();
    }
    let figures: String = plots(steps, limit).iter().map(|plot| figure(steps, plot)).collect();
    html::section("Over the run", &format!("<div class=\"plots\">{figures}</div>"))
}

fn plots(steps: &[ReportStep], limit: &Limit) -> Vec<Plot> {
    let bold = |value: fn(&ReportStep) -> f64| vec![Curve::of(steps, "bold", |row| Some(value(row)))];
    let held = |value: fn(&ReportStep) -> f64| vec![Curve::of(steps, "bold", |row| Some(value(row))).held()];
    let size_limit = limit.size_bytes.map(kilobytes);
    let size = bold(|row| kilobytes(row.size_bytes));
    vec![
        Plot { title: "Size", unit: "kB", curves: size, limit: size_limit, from_zero: true },
        Plot { title: "PSNR", unit: "dB", curves: psnr_curves(steps), limit: None, from_zero: false },
        Plot {
            title: "Generation time",
            unit: "ms",
            curves: bold(|row| row.generation_ms),
            limit: limit.time_ms,
            from_zero: true,
        },
        Plot {
            title: "Resolution r",
            unit: "rays a side",
            curves: held(|row| f64::from(row.resolution)),
            limit: None,
            from_zero: true,
        },
        Plot { title: "Gamma", unit: "", curves: held(|row| row.gamma), limit: None, from_zero: true },
    ]
}

/// A thin curve for each test view, labeled with its angle, below a bold curve of all views pooled.
fn psnr_curves(steps: &[ReportStep]) -> Vec<Curve> {
    let at = |row: &ReportStep, angle: f64| row.views.iter().find(|view| view.0 == angle).map(|view| view.1);
    let view = |angle: f64| Curve {
        name: format!("{}°", significant(angle, 3)),
        ..Curve::of(steps, "thin", |row| at(row, angle))
    };
    let mut curves: Vec<Curve> = html::angles(steps).into_iter().map(view).collect();
    let pooled = Curve::of(steps, "bold", |row| row.psnr_db);
    curves.push(Curve { name: if curves.is_empty() { String::new() } else { "all".into() }, ..pooled });
    curves
}

fn figure(steps: &[ReportStep], plot: &Plot) -> String {
    let broken = plot.limit.map_or(0, |most| plot.curves.iter().flat_map(|c| &c.points).filter(|p| p.1 > most).count());
    let note = match plot.limit {
        None => String::new(),
        Some(most) if broken == 0 => format!("limit {} {}, kept by every step", significant(most, 4), plot.unit),
        Some(most) => format!("limit {} {}, broken by {}", significant(most, 4), plot.unit, counted(broken, "step")),
    };
    let unit = if plot.unit.is_empty() { String::new() } else { format!(" <span>({})</span>", plot.unit) };
    let caption = format!("<figcaption><b>{}</b>{unit}<span class=\"note\">{note}</span></figcaption>", plot.title);
    format!("<figure>{caption}{}</figure>", drawing(steps, plot))
}

fn drawing(steps: &[ReportStep], plot: &Plot) -> String {
    let values = plot.curves.iter().flat_map(|curve| curve.points.iter().map(|p| p.1));
    let x =
        Axis::linear(finite_range(steps.iter().map(|row| row.step as f64)).unwrap_or((0.0, 1.0)), LEFT + 6.0, RIGHT);
    let range = finite_range(values.clone().chain(plot.limit)).map(|range| widened(range, plot.from_zero));
    let y = Axis::linear(range.unwrap_or((0.0, 1.0)), BOTTOM, TOP + 8.0);
    let mut parts = vec![svg::horizontal_axis(&x, BOTTOM, "step", true)];
    if range.is_some() {
        parts.push(svg::vertical_axis(&y, LEFT, RIGHT));
    }
    if values.clone().any(|v| v == f64::INFINITY) {
        parts.push(svg::line("grid", &[(LEFT, TOP - 6.0), (RIGHT, TOP - 6.0)]));
        parts.push(svg::text("tick", (LEFT - 6.0, TOP - 2.0), "end", "∞"));
    }
    parts.extend(plot.curves.iter().map(|curve| draw_curve(curve, &x, &y)));
    parts.push(names(&plot.curves, &y));
    if let Some(most) = plot.limit {
        parts.push(svg::line("limit", &[(LEFT, y.at(most)), (RIGHT, y.at(most))]));
        let over = plot.curves.iter().flat_map(|curve| &curve.points).filter(|p| p.1 > most);
        parts.extend(over.map(|p| svg::triangle("broken", (x.at(p.0), y.at(p.1)))));
    }
    svg::drawing(WIDTH, HEIGHT, &format!("{} over steps", plot.title), &parts.concat())
}

/// The range of an axis: with a margin above the highest value, and below the lowest unless the axis starts at zero.
fn widened((low, high): (f64, f64), from_zero: bool) -> (f64, f64) {
    if from_zero {
        return (low.min(0.0), if high > 0.0 { high * 1.06 } else { 1.0 });
    }
    let margin = (0.06 * (high - low)).max(0.5);
    (low - margin, high + margin)
}

/// The pixel row of a value; infinite values lie on the upper edge, which carries an infinity sign.
fn row_of(y: &Axis, value: f64) -> f64 {
    if value == f64::INFINITY { TOP - 6.0 } else { y.at(value) }
}

fn draw_curve(curve: &Curve, x: &Axis, y: &Axis) -> String {
    let points: Vec<_> = curve.points.iter().map(|p| (x.at(p.0), row_of(y, p.1))).collect();
    // A line through one point is invisible.
    if let [only] = points[..] {
        return svg::circle("dot", only, if curve.class == "bold" { 4.0 } else { 2.5 }, "", "");
    }
    svg::line(curve.class, &svg::thinned(&points, RIGHT - LEFT))
}

/// Labels at the ends of curves, shifted downwards where they would overlap.
fn names(curves: &[Curve], y: &Axis) -> String {
    let end = |curve: &Curve| curve.points.last().map(|p| row_of(y, p.1));
    let mut ends: Vec<_> = curves.iter().filter(|c| !c.name.is_empty()).filter_map(|c| Some((end(c)?, c))).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut free = f64::NEG_INFINITY;
    let mut parts = String::new();
    for (at, curve) in ends {
        let at = at.max(free);
        free = at + 14.0;
        parts += &svg::text(
            if curve.class == "bold" { "name" } else { "tick" },
            (RIGHT + 5.0, at + 4.0),
            "start",
            &curve.name,
        );
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_value_turns_at_right_angles() {
        let curve = Curve { class: "bold", points: vec![(0.0, 1.0), (5.0, 2.0)], name: String::new() }.held();
        assert_eq!(curve.points, [(0.0, 1.0), (5.0, 1.0), (5.0, 2.0)]);
    }

    #[test]
    fn ranges_leave_room_and_contain_zero_if_asked() {
        assert_eq!(widened((10.0, 100.0), true), (0.0, 106.0));
        assert_eq!(widened((0.0, 0.0), true), (0.0, 1.0));
        assert_eq!(widened((30.0, 30.0), false), (29.5, 30.5));
    }
}
