//! Colour and opacity in 8 bits each, or in fewer where gamma allows the error.
//!
//! Opacity goes by the square root of 1 - sqrt(T), T = exp(-optical depth): fine steps near transparent and near opaque.
//! Gamma is taken for the share of light that a supersegment may be off. Its opacity has 1/gamma codes, so that rounding
//! moves it by at most 0.77 gamma; the steps of its colour are at most gamma / 2 where it is opaque, and longer the less it
//! shows: colour times opacity moves by a quarter of gamma. (Or by half a code of 256, where that is more; and by up to
//! twice as much where a code is moved for what a ray owes.) Codes that recur are what compressors live on. At gamma = 0
//! all 256 are in use.
//!
//! Rounding errors of many thin supersegments in a row all point the same way where the medium is uniform: 41 dB is all
//! that plain rounding kept of a field whose opacity fell between two codes. So the error is summed along the ray, and
//! once it exceeds [`SLACK`] the neighbouring code is taken that reduces it: 50 dB there, for a few percent more bytes
//! elsewhere. Carrying every error on at once is better still but costs up to a third more bytes (`proto/formats/vdi.md`). Colour is
//! treated likewise, once the light that a ray is off exceeds gamma or 1/128.

use lamina_model::{Supersegment, Vdi, composite};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Optical depth by which a ray of thin supersegments may be off before a code is moved. At most this much of a colour
/// is lost (1/128 is 42 dB), where all light passes.
const SLACK: f64 = 1.0 / 128.0;

/// Where gamma is above, rounding stays what it is here: 32 opacities, so that smooth media show no bands.
const COARSEST: f64 = 1.0 / 31.0;

/// Optical depth of thick supersegments: their errors neither add up nor can be made good further back.
const THICK: f64 = 0.9;

/// The greatest codes of all scales of colour, coarsest first.
const SCALES: [f64; 6] = [7.0, 15.0, 31.0, 63.0, 127.0, FINEST];
/// That of the finest scale.
const FINEST: f64 = 255.0;

/// Red, green, blue, opacity code.
pub(super) type Codes = [u8; 4];

/// Optical depth of each opacity code; 0 is empty and 255 opaque. The table is in the precision decoded values have, so
/// that a decoded value meets its code without error and encoding again changes nothing.
static OPTICAL_DEPTH: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let share = code as f64 / 255.0;
        (-2.0 * (-share * share).ln_1p()) as f32
    })
});

/// The greatest code of each scale: codes up to it are spread evenly over 0..=255, both ends among them.
struct Scales {
    opacity: f64,
    /// For colours, by the opacity code of the supersegment.
    color: [f64; 256],
    /// Light by which a ray's colour may be off before a code is moved.
    slack: f64,
}

impl Scales {
    fn new(gamma: f64) -> Self {
        let gamma = gamma.min(COARSEST);
        // Of the few scales of colour, so that those of neighbouring opacities are mostly the same.
        let color = OPTICAL_DEPTH.map(|depth| greatest_color(0.5 * gamma / opacity_of(depth)));
        Self { opacity: (1.0 / gamma).ceil().min(FINEST), color, slack: gamma.max(SLACK) }
    }

    fn ray(&self, list: &[Supersegment]) -> Vec<Codes> {
        let (mut carry, mut owed) = (0.0, [0.0; 3]);
        let coded = |s: &Supersegment| {
            let opacity = self.opacity_code(f64::from(s.optical_depth), &mut carry);
            let [r, g, b] = self.color_codes(s.color, opacity, &mut owed);
            [r, g, b, opacity]
        };
        list.iter().map(coded).collect()
    }

    /// Rounds a colour, each channel to one of the two codes next to it; `owed` is how much light of the supersegments in
    /// front is, as far as it is still seen through what is behind them.
    fn color_codes(&self, color: [f32; 3], opacity: u8, owed: &mut [f64; 3]) -> [u8; 3] {
        let greatest = self.color[usize::from(opacity)];
        let shown = opacity_of(OPTICAL_DEPTH[usize::from(opacity)]);
        std::array::from_fn(|i| {
            let (exact, owed) = (f64::from(color[i]), &mut owed[i]);
            let wanted = if owed.abs() > self.slack { exact + *owed / shown } else { exact };
            let (below, above) = ((greatest * exact).floor(), (greatest * exact).ceil());
            let code = spread((greatest * wanted).round().clamp(below, above), greatest);
            *owed = (*owed + shown * (exact - f64::from(code) / 255.0)) * (1.0 - shown);
            code
        })
    }

    /// Rounds one optical depth; `carry` is how much of the ray's depth is still owed. Only ever chooses between the two
    /// codes next to the depth, so that what a thick supersegment lost does not make a thin one behind it visible.
    fn opacity_code(&self, optical_depth: f64, carry: &mut f64) -> u8 {
        if optical_depth == 0.0 {
            return 0;
        }
        // What is fainter than the first code of a coarse scale keeps the finest: it may be all that a ray has.
        let first = f64::from(spread(1.0, self.opacity));
        let (greatest, last) =
            if FINEST * position(optical_depth) < first { (FINEST, first) } else { (self.opacity, self.opacity) };
        let at = |depth: f64| greatest * position(depth);
        let exact = at(optical_depth);
        if optical_depth > THICK {
            *carry = 0.0;
            return spread(exact.round().clamp(1.0, last), greatest);
        }
        let depth_of = |code: f64| f64::from(OPTICAL_DEPTH[usize::from(spread(code, greatest))]);
        let (mut below, mut above) = (exact.floor().max(1.0), exact.ceil().clamp(1.0, last));
        // Codes are whole: one may be on the other side of the depth than its place on the scale is.
        if depth_of(below) > optical_depth {
            below = (below - 1.0).max(1.0);
        }
        if depth_of(above) < optical_depth {
            above = (above + 1.0).min(last);
        }
        let owed = if carry.abs() > SLACK { *carry } else { 0.0 };
        let code = at((optical_depth + owed).max(0.0)).round().clamp(below, above);
        *carry += optical_depth - depth_of(code);
        spread(code, greatest)
    }
}

/// Opacity of an optical depth.
fn opacity_of(depth: f32) -> f64 {
    composite::opacity_from_optical_depth(f64::from(depth))
}

/// The greatest code of the coarsest scale whose steps are at most `step`, a share of the whole; of the finest if none is.
fn greatest_color(step: f64) -> f64 {
    SCALES.into_iter().find(|greatest| greatest * step >= 1.0).unwrap_or(FINEST)
}

/// The code in 0..=255 of one on a scale up to `greatest`.
fn spread(code: f64, greatest: f64) -> u8 {
    (code * (255.0 / greatest)).round() as u8
}

/// The VDI as it comes back, rounded as its gamma allows, after [`super::encode`] with [`super::Layout::Columns`] and [`super::decode`].
pub fn quantize(vdi: &Vdi) -> Vdi {
    let dequantize = |(s, c): (&Supersegment, Codes)| supersegment(s.start, s.end, c);
    let segments = vdi.segments().iter().zip(codes(vdi)).map(dequantize).collect();
    Vdi::new(*vdi.header(), vdi.offsets().to_vec(), segments).expect("depths are the same and codes lie in 0..=255")
}

/// The codes of all supersegments.
pub(super) fn codes(vdi: &Vdi) -> Vec<Codes> {
    let scales = Scales::new(vdi.header().params.gamma());
    let list = |w: &[u32]| scales.ray(&vdi.segments()[w[0] as usize..w[1] as usize]);
    vdi.offsets().par_windows(2).flat_map_iter(list).collect()
}

/// What a reader makes of codes.
pub(super) fn supersegment(start: u32, end: u32, codes: Codes) -> Supersegment {
    let [r, g, b, opacity] = codes;
    let color = [r, g, b].map(|c| f32::from(c) / 255.0);
    Supersegment { start, end, color, optical_depth: OPTICAL_DEPTH[usize::from(opacity)] }
}

pub(super) fn color_codes(color: [f32; 3]) -> [u8; 3] {
    color.map(|c| (255.0 * c).round() as u8)
}

/// Position of an optical depth on the scale of codes, 0 to 1.
fn position(optical_depth: f64) -> f64 {
    (-(-0.5 * optical_depth).exp_m1()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_in_use_comes_back_from_its_optical_depth_and_owes_nothing() {
        for gamma in [0.0, 0.003, 0.01, 0.02, 0.05, 0.26] {
            let scales = Scales::new(gamma);
            let faint = 0..spread(1.0, scales.opacity);
            let in_use: Vec<u8> =
                faint.chain((1..=scales.opacity as u8).map(|k| spread(k.into(), scales.opacity))).collect();
            assert!(in_use.is_sorted_by(|a, b| a < b) && in_use[0] == 0 && in_use.last() == Some(&255));
            for code in in_use {
                let mut carry = 0.0;
                let depth = f64::from(OPTICAL_DEPTH[usize::from(code)]);
                assert_eq!((scales.opacity_code(depth, &mut carry), carry), (code, 0.0), "gamma {gamma}");
                let greatest = scales.color[usize::from(code)];
                (0..=greatest as u8).for_each(|k| {
                    let color = spread(f64::from(k), greatest);
                    let s =
                        Supersegment { color: [f32::from(color) / 255.0; 3], ..supersegment(0, 1, [0, 0, 0, code]) };
                    assert_eq!(scales.ray(&[s]), [[color, color, color, code]], "gamma {gamma}");
                });
            }
        }
    }

    #[test]
    fn rounding_changes_a_colour_by_a_quarter_of_gamma_and_the_opacity_by_less_than_gamma() {
        for gamma in [0.004, 0.01, 0.03, 0.1, 0.26] {
            let (scales, allowed) = (Scales::new(gamma), f64::min(gamma, COARSEST));
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
        let code = |depth: f64, mut carry: f64| Scales::new(0.0).opacity_code(depth, &mut carry);
        assert_eq!(code(1e-30, 0.0), 1);
        assert_eq!(code(1e-30, -1.0), 1);
        assert_eq!(code(40.0, 0.0), 255);
        assert_eq!(code(f64::INFINITY, 0.0), 255);
    }

    #[test]
    fn along_a_uniform_ray_the_optical_depth_is_kept() {
        for gamma in [0.0, 0.01, 0.02, 0.05] {
            let scales = Scales::new(gamma);
            for depth in [2.08e-4, 1e-3, 3.18e-3, 0.0157, 0.0153, 0.1, 0.3, 0.8] {
                let mut carry = 0.0;
                let codes = (0..1000).map(|_| scales.opacity_code(depth, &mut carry));
                let sum: f64 = codes.map(|code| f64::from(OPTICAL_DEPTH[usize::from(code)])).sum();
                // Less than the slack and the last code's own rounding, which is half a step of the scale.
                let step = 4.0 * gamma.clamp(1.0 / 255.0, COARSEST);
                assert!(
                    (sum - 1000.0 * depth).abs() < 2.0 * SLACK + step,
                    "gamma {gamma}: {depth} x 1000 became {sum}"
                );
            }
        }
    }

    #[test]
    fn what_is_fainter_than_a_coarse_scale_is_as_it_would_be_on_the_finest() {
        let (fine, coarse) = (Scales::new(0.0), Scales::new(0.05));
        for depth in [1e-12, 1e-6, 1e-4, 1e-3] {
            let (mut a, mut b) = (0.0, 0.0);
            for n in 0..100 {
                assert_eq!(fine.opacity_code(depth, &mut a), coarse.opacity_code(depth, &mut b), "{n} of {depth}");
            }
        }
    }
}
