//! The transfer function in double precision, and its integrals over the scalar for pre-integration.
//!
//! Pre-integration takes the scalar to run linearly from its value at a step's front to that at its back, and the mean of
//! extinction and of emission between the two from tables of their integrals. What a step takes of its own light is left
//! out (Engel, Kraus and Ertl, "High-Quality Pre-Integrated Volume Rendering", 2001, section 3.3).

use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::{ControlPoint, TransferFunction};

/// Straight color, and extinction per world length.
pub(super) type Medium = ([f64; 3], f64);

const EMPTY: Medium = ([0.0; 3], 0.0);
/// Rows of the integrals, less one.
const BINS: usize = 4096;
/// Midpoints that a row's integral is made of.
const POINTS: usize = 8;
/// Optical depth of a unit length that stands for an infinite one in the integrals.
const OPAQUE: f64 = 1e4;

/// A transfer function whose opacities refer to a world length.
pub(super) struct Optics {
    points: Vec<ControlPoint>,
    unit_length: f64,
    /// From 0 to each row: extinction, and red, green, blue times extinction.
    integrals: Vec<[f64; 4]>,
}

impl Optics {
    /// `transfer`, its opacities referring to `unit_length`.
    pub(super) fn new(transfer: &TransferFunction, unit_length: f64) -> Self {
        let mut optics = Self { points: transfer.points().to_vec(), unit_length, integrals: vec![[0.0; 4]] };
        let mut sum = [0.0; 4];
        for n in 0..BINS * POINTS {
            let row = optics.emission((n as f64 + 0.5) / (BINS * POINTS) as f64);
            sum = std::array::from_fn(|c| sum[c] + row[c] / (BINS * POINTS) as f64);
            if (n + 1) % POINTS == 0 {
                optics.integrals.push(sum);
            }
        }
        optics
    }

    /// The medium at position `u` of the range; NaN is empty.
    #[inline]
    pub(super) fn at(&self, u: f64) -> Medium {
        if u.is_nan() {
            return EMPTY;
        }
        let next = self.points.partition_point(|p| p.at <= u);
        let (color, opacity) = match (next.checked_sub(1).map(|i| &self.points[i]), self.points.get(next)) {
            (Some(a), Some(b)) => {
                let w = (u - a.at) / (b.at - a.at);
                let lerp = |x: f64, y: f64| x + w * (y - x);
                (std::array::from_fn(|c| lerp(a.color[c], b.color[c])), lerp(a.opacity, b.opacity))
            }
            (Some(end), None) | (None, Some(end)) => (end.color, end.opacity),
            (None, None) => return EMPTY,
        };
        (color, optical_depth_from_opacity(opacity) / self.unit_length)
    }

    /// The mean medium between positions `a` and `b`.
    pub(super) fn between(&self, a: f64, b: f64) -> Medium {
        if a.is_nan() || b.is_nan() {
            return EMPTY;
        }
        // Of rows this near their difference has no digits left, and the middle is as good.
        if (b - a).abs() * (BINS as f64) < 2.0 {
            return self.at(0.5 * (a + b));
        }
        let (from, to) = (self.integral(a), self.integral(b));
        let mean: [f64; 4] = std::array::from_fn(|c| (to[c] - from[c]) / (b - a));
        if mean[0] <= 0.0 {
            return EMPTY;
        }
        ([mean[1] / mean[0], mean[2] / mean[0], mean[3] / mean[0]], mean[0])
    }

    /// Extinction, and color times extinction.
    fn emission(&self, u: f64) -> [f64; 4] {
        let ([r, g, b], extinction) = self.at(u);
        let extinction = extinction.min(OPAQUE / self.unit_length);
        [extinction, extinction * r, extinction * g, extinction * b]
    }

    /// From 0 to `u`; beyond the ends the function is constant.
    fn integral(&self, u: f64) -> [f64; 4] {
        let inside = u.clamp(0.0, 1.0);
        let row = ((inside * BINS as f64) as usize).min(BINS - 1);
        let w = inside * BINS as f64 - row as f64;
        let (a, b) = (&self.integrals[row], &self.integrals[row + 1]);
        let beyond = if u == inside { [0.0; 4] } else { self.emission(u) };
        std::array::from_fn(|c| a[c] + w * (b[c] - a[c]) + (u - inside) * beyond[c])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{ScalarRange, Scale};

    fn transfer() -> TransferFunction {
        let p = |at, opacity| ControlPoint { at, color: [at, 0.5, 1.0], opacity };
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        TransferFunction::new(range, None, vec![p(0.25, 0.0), p(0.5, 0.5), p(0.5, 0.9), p(1.0, 1.0)]).unwrap()
    }

    #[test]
    fn it_is_the_models_transfer_function() {
        let (transfer, optics) = (transfer(), Optics::new(&transfer(), 0.5));
        for u in [-1.0_f32, 0.0, 0.26, 0.375, 0.5, 0.7, 1.0, 3.0, f32::NAN] {
            let (model, (color, extinction)) = (transfer.classify(u, 0.5), optics.at(u.into()));
            assert_eq!(model.extinction, extinction, "{u}");
            assert!(extinction == 0.0 || model.color == color, "{u}");
        }
    }

    #[test]
    fn means_are_those_of_the_closed_integral() {
        // Between 0.25 and 0.5 opacity is 2 (u - 0.25): the mean of -ln(1 - a) for a to 1/2 is 2 (1/2 ln(1/2) + 1/2).
        let ([r, ..], extinction) = Optics::new(&transfer(), 1.0).between(0.25, 0.5);
        assert!((extinction - (1.0 + 0.5_f64.ln())).abs() < 1e-6, "{extinction}");
        assert!(r > 0.375 && r < 0.5, "{r}");
        let back = Optics::new(&transfer(), 1.0).between(0.5, 0.25);
        assert!((back.1 - extinction).abs() < 1e-12);
        assert_eq!(Optics::new(&transfer(), 1.0).between(-3.0, 0.2), EMPTY);
    }
}
