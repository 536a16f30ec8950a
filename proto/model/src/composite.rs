//! Emission and absorption along a ray, in optical depths so that neither end of opacity loses digits.
//!
//! A medium of extinction kappa over a length l has optical depth tau = kappa l, transmittance T = exp(-tau) and opacity
//! alpha = 1 - T.

/// Optical depth of an opacity: -ln(1 - alpha). 0 for 0, infinity for 1.
#[inline]
pub fn optical_depth_from_opacity(opacity: f64) -> f64 {
    -(-opacity).ln_1p()
}

/// Opacity of an optical depth: 1 - exp(-tau).
#[inline]
pub fn opacity_from_optical_depth(optical_depth: f64) -> f64 {
    -(-optical_depth).exp_m1()
}

/// Below this transmittance an image can no longer change by what lies behind: 1e-5 is 100 dB.
pub const TRANSMITTANCE_FLOOR: f64 = 1e-5;

/// What a ray has gathered so far, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accumulator {
    /// Premultiplied red, green, blue.
    pub color: [f64; 3],
    /// Share of light from behind that still comes through.
    pub transmittance: f64,
}

impl Default for Accumulator {
    fn default() -> Self {
        Self { color: [0.0; 3], transmittance: 1.0 }
    }
}

impl Accumulator {
    /// Adds, behind what is there, a piece of straight `color` with the given optical depth (positive).
    #[inline]
    pub fn add(&mut self, color: [f64; 3], optical_depth: f64) {
        let weight = self.transmittance * opacity_from_optical_depth(optical_depth);
        for (sum, c) in self.color.iter_mut().zip(color) {
            *sum += weight * c;
        }
        self.transmittance *= (-optical_depth).exp();
    }

    /// The colour seen in front of `background`.
    #[inline]
    pub fn over(&self, background: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| (self.color[c] + self.transmittance * f64::from(background[c])) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitting_a_piece_changes_nothing() {
        for tau in [1e-9, 1e-3, 0.7, 30.0, f64::INFINITY] {
            let color = [0.2, 0.9, 0.4];
            let mut whole = Accumulator::default();
            whole.add(color, tau);
            let mut parts = Accumulator::default();
            parts.add(color, 0.3 * tau);
            parts.add(color, 0.7 * tau);
            assert!((whole.transmittance - parts.transmittance).abs() < 1e-15);
            for c in 0..3 {
                assert!((whole.color[c] - parts.color[c]).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn opacity_and_optical_depth_invert_each_other_near_both_ends() {
        for alpha in [0.0, 1e-12, 1e-7, 0.5, 1.0 - 1e-7] {
            let back = opacity_from_optical_depth(optical_depth_from_opacity(alpha));
            assert!((back - alpha).abs() <= 1e-15 + 1e-12 * alpha, "{alpha} came back as {back}");
        }
        assert_eq!(opacity_from_optical_depth(f64::INFINITY), 1.0);
    }
}
