//! What was measured of one knob, and what is read off it: the observed order of convergence, and marginal prices.

use super::error::Error;
use lamina_model::VdiParams;

/// An error within this factor of a curve's least is level with it: 1 dB.
const LEVEL: f64 = 1.122;
/// The finest points that an order is fitted to, if they are not level.
const FITTED: usize = 4;

/// What a figure was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ErrorSource {
    /// The product's ray caster: time of a whole picture.
    Raycast,
    /// The product's VDI: time of its generation.
    Vdi,
    /// The plain integrator: time of the sampled rays, scaled to a whole picture.
    Plain,
    /// The base's VDI: time of drawing a whole picture of it.
    Drawing,
    /// Measuring quality itself: time of reference and drawing, all views.
    Sample,
}

impl ErrorSource {
    /// As it stands in files.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Raycast => "raycast",
            Self::Vdi => "vdi",
            Self::Plain => "plain",
            Self::Drawing => "drawing",
            Self::Sample => "sample",
        }
    }
}

/// Something that can be set finer or coarser.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parameter {
    /// Its name in files.
    pub key: &'static str,
    /// Its name for people.
    pub title: &'static str,
    /// What its values count.
    pub unit: &'static str,
    /// What is measured.
    pub source: ErrorSource,
    /// The h of a value, which the error is a power of.
    pub coarseness: fn(f64) -> f64,
    /// Where a value stands on an axis.
    pub plotted: fn(f64) -> f64,
    /// Whether a finer value takes more time, so that decibels have a price.
    pub priced: bool,
}

/// One setting, measured.
#[derive(Debug, Clone)]
pub(super) struct Point {
    /// The knob's value.
    pub value: f64,
    /// With what the VDI was generated, if one was.
    pub params: Option<VdiParams>,
    /// Whether the product integrated the transfer function over each step.
    pub pre_integrated: bool,
    /// Against the converged reference.
    pub error: Error,
    /// Against the knob's finest value: what the knob itself adds.
    pub alone: Option<Error>,
    /// As [`ErrorSource`] says.
    pub time_ms: f64,
    /// Encoding the VDI.
    pub encode_ms: Option<f64>,
    /// Drawing a whole picture of it.
    pub draw_ms: Option<f64>,
    /// The VDI, encoded.
    pub size_bytes: Option<u64>,
}

impl Point {
    /// What was measured of `value`, with nothing stored.
    pub(super) fn new(value: f64, error: Error, time_ms: f64) -> Self {
        let (params, pre_integrated, alone, encode_ms, draw_ms, size_bytes) = Default::default();
        Self { value, params, pre_integrated, error, alone, time_ms, encode_ms, draw_ms, size_bytes }
    }
    /// PSNR against the converged reference.
    pub(super) fn decibels(&self) -> f64 {
        self.error.decibels()
    }
    /// Size in kilobytes.
    pub(super) fn kilobytes(&self) -> Option<f64> {
        self.size_bytes.map(|b| b as f64 / 1e3)
    }
}

/// What one more decibel costs, beside the next cheaper point that nothing beats.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Price {
    /// Milliseconds.
    pub ms_per_db: Option<f64>,
    /// Kilobytes.
    pub kb_per_db: Option<f64>,
}

/// How an error falls with its knob.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Convergence {
    /// Slope of ln(error) against ln(h) over the finest points that are not level; none of fewer than three.
    pub order: Option<f64>,
    /// The coarsest value from which on the curve is level, to within 1 dB.
    pub level_from: Option<f64>,
}

/// A knob with its points, coarsest first.
pub(super) struct ErrorCurve {
    /// What was turned.
    pub knob: Parameter,
    /// What was measured.
    pub points: Vec<Point>,
}

impl ErrorCurve {
    /// How the error falls; what is below `trusted` rms is the reference's own error and counts as level.
    pub(super) fn convergence(&self, trusted: f64) -> Convergence {
        let of = |p: &Point| ((self.knob.coarseness)(p.value), p.error.rms.max(trusted));
        // A knob that is off has no h, and an error of 0 no logarithm.
        let mut all: Vec<(f64, (f64, f64))> =
            self.points.iter().map(|p| (p.value, of(p))).filter(|(_, (h, e))| *h > 0.0 && *e > 0.0).collect();
        all.reverse();
        let least = all.iter().map(|(_, (_, e))| *e).fold(f64::INFINITY, f64::min);
        let level = all.iter().take_while(|(_, (_, e))| *e <= LEVEL * least).count();
        let level_from = (level > 1).then(|| all[level - 1].0);
        // The coarsest of the level ones still falls towards the others.
        let fitted: Vec<(f64, f64)> =
            all.iter().skip(level.saturating_sub(1)).take(FITTED).map(|(_, (h, e))| (h.ln(), e.ln())).collect();
        Convergence { order: (fitted.len() >= 3).then(|| least_squares(&fitted)), level_from }
    }

    /// The price of each point, in their order: between neighbors on the knob's own front.
    pub(super) fn prices(&self) -> Vec<Price> {
        let mut prices = vec![Price::default(); self.points.len()];
        if !self.knob.priced {
            return prices;
        }
        let time: Vec<(f64, f64)> = self.points.iter().map(|p| (p.time_ms, p.error.rms)).collect();
        for (n, price) in marginal(&self.points, &time) {
            prices[n].ms_per_db = Some(price);
        }
        let size: Vec<(f64, f64)> =
            self.points.iter().map(|p| (p.kilobytes().unwrap_or(f64::NAN), p.error.rms)).collect();
        for (n, price) in marginal(&self.points, &size) {
            prices[n].kb_per_db = Some(price);
        }
        prices
    }
}

fn least_squares(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let above: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    above / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>()
}

fn marginal(points: &[Point], costs: &[(f64, f64)]) -> Vec<(usize, f64)> {
    let price = |w: &[usize]| {
        let gain_db = points[w[1]].decibels() - points[w[0]].decibels();
        (w[1], (costs[w[1]].0 - costs[w[0]].0) / gain_db)
    };
    front(costs).windows(2).map(price).filter(|(_, price)| price.is_finite()).collect()
}

/// Of (cost, error) those that nothing beats, cheapest first; costs that are no number are none of them.
pub(super) fn front(costs: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..costs.len()).filter(|&n| !costs[n].0.is_nan() && !costs[n].1.is_nan()).collect();
    order.sort_by(|&a, &b| costs[a].0.total_cmp(&costs[b].0).then(costs[a].1.total_cmp(&costs[b].1)));
    let mut least = f64::INFINITY;
    order.retain(|&n| {
        let better = costs[n].1 < least;
        least = least.min(costs[n].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(errors: &[(f64, f64)]) -> ErrorCurve {
        let knob = Parameter {
            key: "k",
            title: "",
            unit: "",
            source: ErrorSource::Plain,
            coarseness: |h| h,
            plotted: |h| h,
            priced: true,
        };
        let point = |&(value, rms): &(f64, f64)| Point::new(value, Error { rms, max: rms }, 1.0 / value);
        ErrorCurve { knob, points: errors.iter().map(point).collect() }
    }

    #[test]
    fn a_square_law_has_order_two_until_it_levels_off() {
        let square = [4.0, 2.0, 1.0, 0.5, 0.25].map(|h: f64| (h, 1e-3 * h * h));
        let found = curve(&square).convergence(0.0);
        assert!((found.order.unwrap() - 2.0).abs() < 1e-12 && found.level_from.is_none());
        // 2e-4 is the reference's own: reached between 1/2 and 1/4.
        let found = curve(&square).convergence(2.4e-4);
        assert_eq!(found.level_from, Some(0.5), "1/4 is as good");
        assert!(found.order.unwrap() > 1.8);
        assert_eq!(curve(&square[..2]).convergence(0.0).order, None);
    }

    #[test]
    fn prices_lie_between_neighbors_on_the_front() {
        // 20 dB for a time of 1 to 2, nothing for 4, 20 more for 8: 6 ms from 2 on.
        let measured = curve(&[(1.0, 1e-1), (0.5, 1e-2), (0.25, 2e-2), (0.125, 1e-3)]);
        let prices: Vec<Option<f64>> = measured.prices().iter().map(|p| p.ms_per_db).collect();
        assert_eq!((prices[0], prices[2]), (None, None));
        assert!((prices[1].unwrap() - 0.05).abs() < 1e-12 && (prices[3].unwrap() - 0.3).abs() < 1e-12);
        assert!(measured.prices().iter().all(|p| p.kb_per_db.is_none()));
    }
}
