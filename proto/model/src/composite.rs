//! Emission and absorption along a ray, in optical depths so that neither end of opacity loses digits.
//!
//! A medium of extinction kappa over a length l has optical depth tau = kappa l, transmittance T = exp(-tau) and opacity
//! alpha = 1 - T.

use std::ops::ControlFlow;

/// Optical depth of an opacity: -ln(1 - alpha). 0 for 0, infinity for 1.
///
/// Where 1 - alpha would lose digits, the series takes over: its next term is below 1e-14 of the value.
#[inline]
pub fn optical_depth_from_opacity(opacity: f64) -> f64 {
    let a = opacity;
    if a < SMALL { a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0)))) } else { -(1.0 - a).ln() }
}

/// Opacity of an optical depth: 1 - exp(-tau). 0 for 0, 1 for infinity. Small ones by their series, likewise.
#[inline]
pub fn opacity_from_optical_depth(optical_depth: f64) -> f64 {
    let t = optical_depth;
    if t < SMALL { t * (1.0 - t * (1.0 / 2.0 - t * (1.0 / 6.0 - t * (1.0 / 24.0)))) } else { 1.0 - (-t).exp() }
}

/// Below, four terms of a series are exact to 1e-13; above, 1 - x keeps 13 digits. Both cost less than ln_1p and exp_m1.
const SMALL: f64 = 5e-4;

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
        let opacity = opacity_from_optical_depth(optical_depth);
        let weight = self.transmittance * opacity;
        for (sum, c) in self.color.iter_mut().zip(color) {
            *sum += weight * c;
        }
        self.transmittance *= 1.0 - opacity;
    }

    /// The color seen in front of `background`.
    #[inline]
    pub fn over(&self, background: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| (self.color[c] + self.transmittance * f64::from(background[c])) as f32)
    }
}

/// Where along a ray half of the light from behind is gone: how deep one sees, where nothing is a surface.
#[derive(Debug, Clone, Copy)]
pub struct HalfDepth {
    /// Its distance; infinite where more comes through.
    pub distance: f64,
    /// Optical depth in front of what is added next.
    optical_depth: f64,
}

impl Default for HalfDepth {
    fn default() -> Self {
        Self { distance: f64::INFINITY, optical_depth: 0.0 }
    }
}

impl HalfDepth {
    /// Adds, behind what is there, a uniform piece of the ray between two distances with the given optical depth; breaks where half is gone.
    pub fn add(&mut self, optical_depth: f64, [from, to]: [f64; 2]) -> ControlFlow<()> {
        let wanted = std::f64::consts::LN_2 - self.optical_depth;
        self.optical_depth += optical_depth;
        if optical_depth < wanted {
            return ControlFlow::Continue(());
        }
        self.distance = from + wanted / optical_depth * (to - from);
        ControlFlow::Break(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_light_is_gone_where_the_optical_depth_is_the_logarithm_of_two() {
        let ln2 = std::f64::consts::LN_2;
        // Uniform from 2 to 6 with twice that depth: in the middle, in one piece or in three with a gap.
        let pieces: [&[(f64, [f64; 2])]; 3] = [
            &[(2.0 * ln2, [2.0, 6.0])],
            &[(0.5 * ln2, [2.0, 3.0]), (1.0 * ln2, [3.0, 5.0]), (0.5 * ln2, [5.0, 6.0])],
            &[(0.0, [0.0, 1.0]), (f64::INFINITY, [4.0, 4.5])],
        ];
        for pieces in pieces {
            let mut half = HalfDepth::default();
            assert!(pieces.iter().any(|&(depth, piece)| half.add(depth, piece).is_break()));
            assert!((half.distance - 4.0).abs() < 1e-12, "{half:?}");
        }
        let mut thin = HalfDepth::default();
        assert!(thin.add(0.99 * ln2, [0.0, 1.0]).is_continue() && thin.distance.is_infinite());
    }

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
        for alpha in [0.0, 1e-12, 1e-7, 4.9e-4, 5.1e-4, 0.5, 1.0 - 1e-7] {
            let back = opacity_from_optical_depth(optical_depth_from_opacity(alpha));
            assert!((back - alpha).abs() <= 1e-15 + 1e-12 * alpha, "{alpha} came back as {back}");
        }
        assert_eq!(opacity_from_optical_depth(f64::INFINITY), 1.0);
        for x in [1e-300, 1e-9, 1e-4, 4.999e-4, 5.001e-4, 1e-2, 0.9] {
            assert!((opacity_from_optical_depth(x) / -(-x).exp_m1() - 1.0).abs() < 1e-12, "{x}");
            assert!((optical_depth_from_opacity(x) / -(-x).ln_1p() - 1.0).abs() < 1e-12, "{x}");
        }
    }
}
