//! The exact solution of the Riemann problem for an ideal gas (Toro, chapter 4), in double precision.

/// Density, velocity and pressure on one side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    pub rho: f64,
    pub u: f64,
    pub p: f64,
}

/// A Riemann problem and the pressure and velocity between its outer waves.
pub(super) struct Riemann {
    left: Side,
    right: Side,
    gamma: f64,
    p_star: f64,
    u_star: f64,
}

impl Side {
    fn sound_speed(&self, gamma: f64) -> f64 {
        (gamma * self.p / self.rho).sqrt()
    }

    /// By how much the velocity changes over a wave that leads from this side to pressure `p` (Toro 4.6, 4.7): a shock
    /// if that is higher, else a rarefaction. Grows with `p`.
    fn velocity_change(&self, p: f64, gamma: f64) -> f64 {
        if p > self.p {
            let (a, b) = (2.0 / ((gamma + 1.0) * self.rho), (gamma - 1.0) / (gamma + 1.0) * self.p);
            (p - self.p) * (a / (p + b)).sqrt()
        } else {
            let exponent = (gamma - 1.0) / (2.0 * gamma);
            2.0 * self.sound_speed(gamma) / (gamma - 1.0) * ((p / self.p).powf(exponent) - 1.0)
        }
    }

    /// The state at speed `s` on this, the left, side of the contact.
    fn sample(&self, s: f64, p_star: f64, u_star: f64, gamma: f64) -> Side {
        let a = self.sound_speed(gamma);
        let ratio = p_star / self.p;
        let g = (gamma - 1.0) / (gamma + 1.0);
        if ratio > 1.0 {
            let shock = self.u - a * ((gamma + 1.0) / (2.0 * gamma) * ratio + (gamma - 1.0) / (2.0 * gamma)).sqrt();
            let rho = self.rho * (ratio + g) / (g * ratio + 1.0);
            return if s < shock { *self } else { Side { rho, u: u_star, p: p_star } };
        }
        let (head, tail) = (self.u - a, u_star - a * ratio.powf((gamma - 1.0) / (2.0 * gamma)));
        if s < head {
            return *self;
        }
        if s > tail {
            return Side { rho: self.rho * ratio.powf(1.0 / gamma), u: u_star, p: p_star };
        }
        let c = 2.0 / (gamma + 1.0) + g / a * (self.u - s);
        let u = 2.0 / (gamma + 1.0) * (a + 0.5 * (gamma - 1.0) * self.u + s);
        let (rho, p) = (self.rho * c.powf(2.0 / (gamma - 1.0)), self.p * c.powf(2.0 * gamma / (gamma - 1.0)));
        Side { rho, u, p }
    }
}

impl Riemann {
    pub(super) fn new(left: Side, right: Side, gamma: f64) -> Self {
        let change = |p: f64| left.velocity_change(p, gamma) + right.velocity_change(p, gamma) + right.u - left.u;
        // Bisection in the logarithm: the function only grows.
        let (mut low, mut high) = (1e-12_f64.ln(), 1e6_f64.ln());
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if change(middle.exp()) > 0.0 { high = middle } else { low = middle }
        }
        let p_star = (0.5 * (low + high)).exp();
        let of_right = right.velocity_change(p_star, gamma) - left.velocity_change(p_star, gamma);
        Self { left, right, gamma, p_star, u_star: 0.5 * (left.u + right.u + of_right) }
    }

    /// The state at speed `s` = x / t.
    pub(super) fn at(&self, s: f64) -> Side {
        let Self { left, right, gamma, p_star, u_star } = *self;
        if s <= u_star {
            return left.sample(s, p_star, u_star, gamma);
        }
        // The right side is the left side of the mirror image.
        let mirrored = Side { u: -right.u, ..right }.sample(-s, p_star, -u_star, gamma);
        Side { u: -mirrored.u, ..mirrored }
    }
}

#[test]
fn sod_has_its_tabulated_star_values() {
    // Toro, table 4.3, test 1.
    let (left, right) = (Side { rho: 1.0, u: 0.0, p: 1.0 }, Side { rho: 0.125, u: 0.0, p: 0.1 });
    let sod = Riemann::new(left, right, 1.4);
    assert!((sod.p_star - 0.30313).abs() < 1e-5 && (sod.u_star - 0.92745).abs() < 1e-5);
    let (rho_left, rho_right) = (sod.at(0.92).rho, sod.at(0.93).rho);
    assert!((rho_left - 0.42632).abs() < 1e-5 && (rho_right - 0.26557).abs() < 1e-5);
}
