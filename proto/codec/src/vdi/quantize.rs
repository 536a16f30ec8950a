//! Quantization of colors and opacities to 8 bits, or to fewer distinct codes where gamma allows the error.
//!
//! Opacity codes are uniform in sqrt(1 - sqrt(T)), T = exp(-optical depth): fine near transparent and near opaque. Gamma
//! bounds the error of a supersegment: opacity has 1/gamma codes, so that rounding moves it by at most 0.77 gamma; color
//! steps are at most gamma / 2 where the supersegment is opaque and longer where it is faint, so that color times opacity
//! moves by a quarter of gamma. (Or by half of one of 256 codes, where that is more; and by up to twice as much where a code
//! is moved to compensate earlier errors.) Recurring codes are what compressors exploit. At gamma = 0 all 256 are in use.
//!
//! Rounding errors of successive thin supersegments all have the same sign where the medium is uniform: plain rounding kept
//! only 41 dB of a field whose opacity fell between two codes. So the error is summed along the ray, and once it exceeds
//! [`SLACK`] the neighboring code that reduces it is taken: 50 dB there, for a few percent more bytes elsewhere.
//! Compensating every error at once is better still but costs up to a third more bytes (`proto/formats/vdi.md`). Color is
//! treated likewise, once the ray's error in light exceeds gamma or 1/128.

use lamina_model::{Supersegment, Vdi, composite};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Accumulated error in optical depth from which on codes compensate it. It loses at most this share of a color (1/128 is
/// 42 dB), where all light passes.
const SLACK: f64 = 1.0 / 128.0;

/// Larger gammas are quantized as this one: 32 opacity codes, so that smooth media show no bands.
const COARSEST_GAMMA: f64 = 1.0 / 31.0;

/// Optical depth from which on supersegments are not compensated: later ones behind them cannot make up for an error.
const THICK: f64 = 0.9;

/// Largest code of each color scale, coarsest first.
const SCALES: [f64; 6] = [7.0, 15.0, 31.0, 63.0, 127.0, FINEST];
/// Largest code of the finest scale.
const FINEST: f64 = 255.0;

/// Red, green, blue, opacity code.
pub(super) type Codes = [u8; 4];

/// Optical depth of each opacity code; 0 is empty and 255 opaque. In single precision, as decoded values are, so that
/// quantizing a decoded value returns its code without error.
static OPTICAL_DEPTH: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let share = code as f64 / 255.0;
        (-2.0 * (-share * share).ln_1p()) as f32
    })
});

/// Scales of codes for one gamma. A scale is given by its largest code: codes from 0 to it are spread evenly over 0..=255.
struct CodeScales {
    opacity: f64,
    /// Color scale by the opacity code of the supersegment.
    color: [f64; 256],
    /// Accumulated error in light from which on color codes compensate it.
    slack: f64,
}

impl CodeScales {
    fn new(gamma: f64) -> Self {
        let gamma = gamma.min(COARSEST_GAMMA);
        // Few distinct scales, so that supersegments of similar opacity mostly share one.
        let color = OPTICAL_DEPTH.map(|depth| color_scale_for(0.5 * gamma / opacity_of(depth)));
        Self { opacity: (1.0 / gamma).ceil().min(FINEST), color, slack: gamma.max(SLACK) }
    }

    fn ray(&self, list: &[Supersegment]) -> Vec<Codes> {
        let (mut depth_error, mut light_error) = (0.0, [0.0; 3]);
        let coded = |s: &Supersegment| {
            let opacity = self.opacity_code(f64::from(s.optical_depth), &mut depth_error);
            let [r, g, b] = self.color_codes(s.color, opacity, &mut light_error);
            [r, g, b, opacity]
        };
        list.iter().map(coded).collect()
    }

    /// Rounds each channel of a color to one of its two nearest codes. `light_error` is the error in light of the supersegments
    /// in front, attenuated by those behind them.
    fn color_codes(&self, color: [f32; 3], opacity: u8, light_error: &mut [f64; 3]) -> [u8; 3] {
        let max_code = self.color[usize::from(opacity)];
        let shown = opacity_of(OPTICAL_DEPTH[usize::from(opacity)]);
        std::array::from_fn(|i| {
            let (exact, light_error) = (f64::from(color[i]), &mut light_error[i]);
            let wanted = if light_error.abs() > self.slack { exact + *light_error / shown } else { exact };
            let (below, above) = ((max_code * exact).floor(), (max_code * exact).ceil());
            let code = code_on_full_scale((max_code * wanted).round().clamp(below, above), max_code);
            *light_error = (*light_error + shown * (exact - f64::from(code) / 255.0)) * (1.0 - shown);
            code
        })
    }

    /// Rounds one optical depth to one of its two nearest codes, so that the error of a thick supersegment never makes a thin
    /// one behind it visible. `depth_error` is the ray's accumulated error in optical depth.
    fn opacity_code(&self, optical_depth: f64, depth_error: &mut f64) -> u8 {
        if optical_depth == 0.0 {
            return 0;
        }
        // Below the first code of a coarse scale use the finest: such a supersegment may be all that a ray has.
        let first = f64::from(code_on_full_scale(1.0, self.opacity));
        let (max_code, last) =
            if FINEST * position(optical_depth) < first { (FINEST, first) } else { (self.opacity, self.opacity) };
        let at = |depth: f64| max_code * position(depth);
        let exact = at(optical_depth);
        if optical_depth > THICK {
            *depth_error = 0.0;
            return code_on_full_scale(exact.round().clamp(1.0, last), max_code);
        }
        let depth_of = |code: f64| f64::from(OPTICAL_DEPTH[usize::from(code_on_full_scale(code, max_code))]);
        let (mut below, mut above) = (exact.floor().max(1.0), exact.ceil().clamp(1.0, last));
        // Codes are rounded to integers, so a code may lie on the other side of the depth than its position on the scale.
        if depth_of(below) > optical_depth {
            below = (below - 1.0).max(1.0);
        }
        if depth_of(above) < optical_depth {
            above = (above + 1.0).min(last);
        }
        let correction = if depth_error.abs() > SLACK { *depth_error } else { 0.0 };
        let code = at((optical_depth + correction).max(0.0)).round().clamp(below, above);
        *depth_error += optical_depth - depth_of(code);
        code_on_full_scale(code, max_code)
    }
}

/// Opacity of an optical depth.
fn opacity_of(depth: f32) -> f64 {
    composite::opacity_from_optical_depth(f64::from(depth))
}

/// Largest code of the coarsest color scale whose step, as a share of full color, is at most `step`; else the finest.
fn color_scale_for(step: f64) -> f64 {
    SCALES.into_iter().find(|max_code| max_code * step >= 1.0).unwrap_or(FINEST)
}

/// The code in 0..=255 of code `code` on a scale up to `max_code`.
fn code_on_full_scale(code: f64, max_code: f64) -> u8 {
    (code * (255.0 / max_code)).round() as u8
}

/// `vdi` with the colors and opacities that it has after [`super::encode`] in [`super::Layout::Columns`] and [`super::decode`].
pub fn quantize(vdi: &Vdi) -> Vdi {
    let dequantize = |(s, c): (&Supersegment, Codes)| supersegment(s.start, s.end, c);
    let segments = vdi.segments().iter().zip(codes(vdi)).map(dequantize).collect();
    Vdi::new(*vdi.header(), vdi.offsets().to_vec(), segments).expect("depths are the same and codes lie in 0..=255")
}

/// The codes of a ray's supersegments, of a VDI with this gamma.
pub(super) fn of_rays(gamma: f64) -> impl Fn(&[Supersegment]) -> Vec<Codes> {
    let scales = CodeScales::new(gamma);
    move |list| scales.ray(list)
}

/// The codes of all supersegments, in order.
pub(super) fn codes(vdi: &Vdi) -> Vec<Codes> {
    let ray = of_rays(vdi.header().params.gamma());
    let list = |w: &[u32]| ray(&vdi.segments()[w[0] as usize..w[1] as usize]);
    vdi.offsets().par_windows(2).flat_map_iter(list).collect()
}

/// The supersegment that a reader reconstructs from codes.
pub(super) fn supersegment(start: u32, end: u32, codes: Codes) -> Supersegment {
    let [r, g, b, opacity] = codes;
    let color = [r, g, b].map(|c| f32::from(c) / 255.0);
    Supersegment { start, end, color, optical_depth: OPTICAL_DEPTH[usize::from(opacity)] }
}

pub(super) fn color_codes(color: [f32; 3]) -> [u8; 3] {
    color.map(|c| (255.0 * c).round() as u8)
}

/// Position of an optical depth on the scale of opacity codes, 0 to 1.
fn position(optical_depth: f64) -> f64 {
    (-(-0.5 * optical_depth).exp_m1()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_in_use_comes_back_from_its_optical_depth_and_owes_nothing() {
        for gamma in [0.0, 0.003, 0.01, 0.02, 0.05, 0.26] {
            let scales = CodeScales::new(gamma);
            let faint = 0..code_on_full_scale(1.0, scales.opacity);
            let in_use: Vec<u8> =
                faint.chain((1..=scales.opacity as u8).map(|k| code_on_full_scale(k.into(), scales.opacity))).collect();
            assert!(in_use.is_sorted_by(|a, b| a < b) && in_use[0] == 0 && in_use.last() == Some(&255));
            for code in in_use {
                let mut depth_error = 0.0;
                let depth = f64::from(OPTICAL_DEPTH[usize::from(code)]);
                assert_eq!((scales.opacity_code(depth, &mut depth_error), depth_error), (code, 0.0), "gamma {gamma}");
                let max_code = scales.color[usize::from(code)];
                (0..=max_code as u8).for_each(|k| {
                    let color = code_on_full_scale(f64::from(k), max_code);
                    let s =
                        Supersegment { color: [f32::from(color) / 255.0; 3], ..supersegment(0, 1, [0, 0, 0, code]) };
                    assert_eq!(scales.ray(&[s]), [[color, color, color, code]], "gamma {gamma}");
                });
            }
        }
    }

    #[test]
    fn rounding_changes_a_color_by_a_quarter_of_gamma_and_the_opacity_by_less_than_gamma() {
        for gamma in [0.004, 0.01, 0.03, 0.1, 0.26] {
            let (scales, allowed) = (CodeScales::new(gamma), f64::min(gamma, COARSEST_GAMMA));
            for n in 1..4000 {
                let s = Supersegment {
                    start: 0,
                    end: 1,
                    color: [n as f32 / 4000.0; 3],
                    optical_depth: (n as f32 * 0.001).powi(2),
                };
                let [r, .., opacity] = scales.ray(&[s])[0];
                let back = supersegment(0, 1, [r, r, r, opacity]);
                // Codes are whole: a scale of fewer may be half a code off, and so is one of all.
                let rounding = 1.01 / 255.0;
                let change = f64::from((back.color[0] - s.color[0]).abs()) * back.opacity();
                assert!(change <= 0.25 * allowed + rounding, "gamma {gamma}, {s:?}: {change}");
                let change = (back.opacity() - s.opacity()).abs();
                assert!(change <= 0.77 * allowed + 1.54 * rounding, "gamma {gamma}, {s:?}: {change}");
            }
        }
    }

    #[test]
    fn the_scale_keeps_digits_at_both_ends_and_no_depth_vanishes() {
        // -2 ln(1 - 1/255^2) = 2/65025 + 1/65025^2 + ..
        assert!((f64::from(OPTICAL_DEPTH[1]) - 2.0 / 65025.0 - 1.0 / 65025.0_f64.powi(2)).abs() < 1e-11);
        assert_eq!(OPTICAL_DEPTH[255], f32::INFINITY);
        let code = |depth: f64, mut depth_error: f64| CodeScales::new(0.0).opacity_code(depth, &mut depth_error);
        assert_eq!(code(1e-30, 0.0), 1);
        assert_eq!(code(1e-30, -1.0), 1);
        assert_eq!(code(40.0, 0.0), 255);
        assert_eq!(code(f64::INFINITY, 0.0), 255);
    }

    #[test]
    fn along_a_uniform_ray_the_optical_depth_is_kept() {
        for gamma in [0.0, 0.01, 0.02, 0.05] {
            let scales = CodeScales::new(gamma);
            for depth in [2.08e-4, 1e-3, 3.18e-3, 0.0157, 0.0153, 0.1, 0.3, 0.8] {
                let mut depth_error = 0.0;
                let codes = (0..1000).map(|_| scales.opacity_code(depth, &mut depth_error));
                let sum: f64 = codes.map(|code| f64::from(OPTICAL_DEPTH[usize::from(code)])).sum();
                // Less than the slack and the last code's own rounding, which is half a step of the scale.
                let step = 4.0 * gamma.clamp(1.0 / 255.0, COARSEST_GAMMA);
                assert!(
                    (sum - 1000.0 * depth).abs() < 2.0 * SLACK + step,
                    "gamma {gamma}: {depth} x 1000 became {sum}"
                );
            }
        }
    }

    #[test]
    fn what_is_fainter_than_a_coarse_scale_is_as_it_would_be_on_the_finest() {
        let (fine, coarse) = (CodeScales::new(0.0), CodeScales::new(0.05));
        for depth in [1e-12, 1e-6, 1e-4, 1e-3] {
            let (mut a, mut b) = (0.0, 0.0);
            for n in 0..100 {
                assert_eq!(fine.opacity_code(depth, &mut a), coarse.opacity_code(depth, &mut b), "{n} of {depth}");
            }
        }
    }
}
