//! Closed forms of light along a ray.

use glam::DVec3;
use lamina_model::Ray;
use lamina_tests::reference::{Light, span, steps};

/// A box of one color and one extinction inside the volume's box.
pub(crate) struct Slab {
    pub bounds: [DVec3; 2],
    pub inside: [DVec3; 2],
    pub color: [f64; 3],
    /// Extinction, 1 / world length.
    pub kappa: f64,
}

impl Slab {
    /// After 0, 1, 2 .. steps from the entry into the volume's box: 1 - exp(-kappa l), l the length inside so far.
    pub(crate) fn lights(&self, ray: &Ray, step: f64) -> Vec<Light> {
        let inside = span(ray, self.inside[0], self.inside[1]).filter(|_| self.kappa > 0.0);
        along(ray, self.bounds, step, |_, to| {
            let length = inside.map_or(0.0, |[enter, leave]| to.min(leave) - enter);
            if length > 0.0 { Light::CLEAR.then(self.color, self.kappa * length) } else { Light::CLEAR }
        })
    }
}

/// Opacity of a unit length growing linearly along an axis, from 0 to `opacity`.
pub(crate) struct Wedge {
    pub bounds: [DVec3; 2],
    pub axis: usize,
    pub color: [f64; 3],
    pub opacity: f64,
    pub unit_length: f64,
}

impl Wedge {
    /// The optical depth is the integral of -ln(1 - a u) over the way, u linear in it: its antiderivative in u is
    /// ((1 - a u) ln(1 - a u) + a u) / a.
    pub(crate) fn lights(&self, ray: &Ray, step: f64) -> Vec<Light> {
        let (a, axis) = (self.opacity, self.axis);
        let (low, size) = (self.bounds[0][axis], self.bounds[1][axis] - self.bounds[0][axis]);
        let u = |s: f64| (ray.origin[axis] + s * ray.direction[axis] - low) / size;
        let antiderivative = |u: f64| ((1.0 - a * u) * (-a * u).ln_1p() + a * u) / a;
        along(ray, self.bounds, step, |from, to| {
            let (u0, u1) = (u(from), u(to));
            let mean = if (u1 - u0).abs() < 1e-6 {
                -(-a * 0.5 * (u0 + u1)).ln_1p()
            } else {
                (antiderivative(u1) - antiderivative(u0)) / (u1 - u0)
            };
            Light::CLEAR.then(self.color, mean * (to - from) / self.unit_length)
        })
    }
}

/// `light(entry, end)` at every step from the entry into a box.
fn along(ray: &Ray, bounds: [DVec3; 2], step: f64, light: impl Fn(f64, f64) -> Light) -> Vec<Light> {
    let Some([enter, leave]) = span(ray, bounds[0], bounds[1]) else { return vec![Light::CLEAR] };
    (0..=steps(leave - enter, step)).map(|n| light(enter, (enter + n as f64 * step).min(leave))).collect()
}
