//! SVG text: axes that map values to pixels, ticks on round numbers, and basic shapes.

use super::numbers::significant;

/// A map from values `low..=high` to pixels `from..=to`, linear or logarithmic.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
    logarithmic: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear((low, high): (f64, f64), from: f64, to: f64) -> Self {
        Self { low, high, from, to, logarithmic: false }
    }

    /// An axis that is logarithmic if the values are positive and span more than a factor of eight, and linear otherwise.
    pub fn fitting((low, high): (f64, f64), from: f64, to: f64) -> Self {
        Self { low, high, from, to, logarithmic: low > 0.0 && high > 8.0 * low }
    }

    /// The pixel position of `value`; the middle if the axis has one value only.
    pub fn at(&self, value: f64) -> f64 {
        let place = |v: f64| if self.logarithmic { v.ln() } else { v };
        let span = place(self.high) - place(self.low);
        let t = if span > 0.0 { (place(value) - place(self.low)) / span } else { 0.5 };
        self.from + t * (self.to - self.from)
    }

    /// About `count` round values on the axis.
    pub fn ticks(&self, count: u32) -> Vec<f64> {
        let decades = if self.logarithmic { decade_ticks(self.low, self.high) } else { Vec::new() };
        if decades.len() >= 2 { decades } else { nice_ticks(self.low, self.high, count) }
    }
}

/// Multiples of 1, 2 or 5 times a power of ten within `low..=high`: the finest with at most `count` steps between them.
pub fn nice_ticks(low: f64, high: f64, count: u32) -> Vec<f64> {
    if !(low.is_finite() && high.is_finite() && high > low) {
        return if low.is_finite() { vec![low] } else { Vec::new() };
    }
    let rough = (high - low) / f64::from(count.max(1));
    let exponent = rough.log10().floor() as i32;
    let power = 10_f64.powi(exponent);
    let leading = [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * power >= rough * (1.0 - 1e-9)).unwrap_or(10.0);
    let unit = leading * power;
    let (first, last) = ((low / unit - 1e-9).ceil() as i64, (high / unit + 1e-9).floor() as i64);
    // Dividing by a whole power of ten rounds once; multiplying by 0.1 would turn 3 into 0.30000000000000004.
    let value = |k: i64| if exponent < 0 { k as f64 * leading / 10_f64.powi(-exponent) } else { k as f64 * unit };
    (first..=last).map(value).collect()
}

/// 1, 2 and 5 of every decade, or the decades alone if that would be too many.
fn decade_ticks(low: f64, high: f64) -> Vec<f64> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let leading: &[f64] = if last - first > 3 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let power = |m: f64, e: i32| if e < 0 { m / 10_f64.powi(-e) } else { m * 10_f64.powi(e) };
    let all = (first..=last).flat_map(|e| leading.iter().map(move |&m| power(m, e)));
    all.filter(|v| *v >= low * (1.0 - 1e-9) && *v <= high * (1.0 + 1e-9)).collect()
}

/// A pixel coordinate, rounded to a tenth.
fn px(value: f64) -> String {
    significant((value * 10.0).round() / 10.0, 6)
}

/// A whole SVG element; `description` is its accessible label.
pub fn drawing(width: f64, height: f64, description: &str, content: &str) -> String {
    let label = super::html::escape(description);
    format!("<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{label}\">{content}</svg>", px(width), px(height))
}

/// A polyline through `points`.
pub fn line(class: &str, points: &[(f64, f64)]) -> String {
    let mut path = String::new();
    for (i, (x, y)) in points.iter().enumerate() {
        path.push_str(&format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, px(*x), px(*y)));
    }
    format!("<path class=\"{class}\" d=\"{path}\"/>")
}

/// At most the highest and lowest point of each pixel column, so that the size of a plot does not grow with the number of points.
pub fn thinned(points: &[(f64, f64)], width: f64) -> Vec<(f64, f64)> {
    if (points.len() as f64) <= 2.0 * width {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for column in points.chunk_by(|a, b| a.0.floor() == b.0.floor()) {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        kept.extend(column.iter().min_by(by_y).into_iter().chain(column.iter().max_by(by_y)));
    }
    kept
}

/// A circle with a tooltip; `attributes` are further SVG attributes as text, each with a leading space.
pub fn circle(class: &str, (x, y): (f64, f64), radius: f64, attributes: &str, title: &str) -> String {
    let (x, y, r) = (px(x), px(y), px(radius));
    let title = if title.is_empty() { String::new() } else { format!("<title>{}</title>", super::html::escape(title)) };
    format!("<circle class=\"{class}\" cx=\"{x}\" cy=\"{y}\" r=\"{r}\"{attributes}>{title}</circle>")
}

/// A triangular marker whose tip lies a little above the point: readable without color.
pub fn triangle(class: &str, (x, y): (f64, f64)) -> String {
    format!("<path class=\"{class}\" d=\"M{} {}l5 9h-10z\"/>", px(x), px(y - 5.0))
}

/// Text at a point; `anchor` is start, middle or end.
pub fn text(class: &str, (x, y): (f64, f64), anchor: &str, words: &str) -> String {
    let words = super::html::escape(words);
    format!("<text class=\"{class}\" x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\">{words}</text>", px(x), px(y))
}

/// Horizontal grid lines from `left` to `right`, labeled with their values.
pub fn vertical_axis(axis: &Axis, left: f64, right: f64) -> String {
    let tick = |v: f64| {
        let y = axis.at(v);
        line("grid", &[(left, y), (right, y)]) + &text("tick", (left - 6.0, y + 4.0), "end", &significant(v, 6))
    };
    axis.ticks(6).into_iter().map(tick).collect()
}

/// A baseline at `bottom` with labeled ticks below it and the name of the axis; `whole` keeps ticks on whole numbers only.
pub fn horizontal_axis(axis: &Axis, bottom: f64, name: &str, whole: bool) -> String {
    let ticks = axis.ticks(5).into_iter().filter(|v| !whole || v.fract() == 0.0);
    let tick = |v: f64| {
        let x = axis.at(v);
        line("grid", &[(x, bottom), (x, bottom + 5.0)])
            + &text("tick", (x, bottom + 18.0), "middle", &significant(v, 6))
    };
    let base = line("base", &[(axis.from, bottom), (axis.to, bottom)]);
    let name = text("tick", (0.5 * (axis.from + axis.to), bottom + 34.0), "middle", name);
    base + &ticks.map(tick).collect::<String>() + &name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_stand_on_round_numbers() {
        assert_eq!(nice_ticks(0.0, 1.0, 5), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(nice_ticks(0.0, 0.3, 3), [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(nice_ticks(0.0, 324.0, 4), [0.0, 100.0, 200.0, 300.0]);
        assert_eq!(nice_ticks(-7.0, 13.0, 4), [-5.0, 0.0, 5.0, 10.0]);
        assert_eq!(nice_ticks(36.2, 41.9, 4), [38.0, 40.0]);
        assert_eq!(nice_ticks(1e6, 3e6, 2), [1e6, 2e6, 3e6]);
        assert_eq!(nice_ticks(0.0, 9e-4, 4), [0.0, 5e-4]);
    }

    #[test]
    fn there_are_at_most_one_more_tick_than_asked() {
        for k in 1..400 {
            let high = 0.0137 * f64::from(k * k);
            let ticks = nice_ticks(0.0, high, 4);
            assert!((2..=5).contains(&ticks.len()), "{high}: {ticks:?}");
            assert!(ticks.iter().all(|t| (0.0..=high * (1.0 + 1e-9)).contains(t)));
        }
    }

    #[test]
    fn degenerate_ranges_have_their_value_or_nothing() {
        assert_eq!(nice_ticks(3.0, 3.0, 4), [3.0]);
        assert!(nice_ticks(f64::NAN, 1.0, 4).is_empty());
        assert_eq!(Axis::linear((3.0, 3.0), 10.0, 30.0).at(3.0), 20.0);
    }

    #[test]
    fn a_logarithmic_axis_halves_at_the_geometric_mean() {
        let axis = Axis::fitting((0.01, 1.0), 0.0, 100.0);
        assert!((axis.at(0.1) - 50.0).abs() < 1e-9);
        assert_eq!(axis.ticks(5), [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0]);
        assert!((Axis::fitting((0.0, 1.0), 0.0, 100.0).at(0.5) - 50.0).abs() < 1e-9);
    }

    #[test]
    fn thinning_keeps_the_extremes_of_each_column() {
        let points: Vec<_> = (0..1000).map(|k| (f64::from(k) * 0.01, f64::from(k * 37 % 101))).collect();
        let kept = thinned(&points, 10.0);
        assert_eq!(kept.len(), 20);
        assert!(kept.iter().any(|p| p.1 == 0.0) && kept.iter().any(|p| p.1 == 100.0));
        assert_eq!(thinned(&points[..5], 10.0), points[..5]);
    }

    #[test]
    fn words_in_a_drawing_are_escaped() {
        assert!(text("t", (0.0, 0.5), "end", "a<b").contains(">a&lt;b</text>"));
        assert!(circle("c", (1.0, 2.0), 3.0, "", "x&y").contains("<title>x&amp;y</title>"));
    }
}
