//! Colour and opacity in 8 bits each.
//!
//! Opacity goes by the square root of 1 - sqrt(T), T = exp(-optical depth): fine steps near transparent and near opaque.
//!
//! Rounding errors of many thin supersegments in a row all point the same way where the medium is uniform: 41 dB is all
//! that plain rounding kept of a field whose opacity fell between two codes. So the error is summed along the ray, and
//! once it exceeds [`SLACK`] the neighbouring code is taken that reduces it: 50 dB there, for a few percent more bytes
//! elsewhere. Carrying every error on at once is better still but costs up to a third more bytes (VDI-FORMAT.md).

use lamina_model::{Supersegment, Vdi};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Optical depth by which a ray of thin supersegments may be off before a code is moved. At most this much of a colour
/// is lost (1/128 is 42 dB), where all light passes.
const SLACK: f64 = 1.0 / 128.0;

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

/// The VDI as it comes back after [`super::encode`] with [`super::Layout::Columns`] and [`super::decode`].
pub fn quantize(vdi: &Vdi) -> Vdi {
    let dequantize = |(s, c): (&Supersegment, Codes)| supersegment(s.start, s.end, c);
    let segments = vdi.segments().iter().zip(codes(vdi)).map(dequantize).collect();
    Vdi::new(*vdi.header(), vdi.offsets().to_vec(), segments).expect("depths are the same and codes lie in 0..=255")
}

/// The codes of all supersegments.
pub(super) fn codes(vdi: &Vdi) -> Vec<Codes> {
    let list = |w: &[u32]| ray_codes(&vdi.segments()[w[0] as usize..w[1] as usize]);
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

/// Position of an optical depth on the scale of codes.
fn position(optical_depth: f64) -> f64 {
    255.0 * (-(-0.5 * optical_depth).exp_m1()).sqrt()
}

fn ray_codes(list: &[Supersegment]) -> Vec<Codes> {
    let mut carry = 0.0;
    let coded = |s: &Supersegment| {
        let [r, g, b] = color_codes(s.color);
        [r, g, b, opacity_code(f64::from(s.optical_depth), &mut carry)]
    };
    list.iter().map(coded).collect()
}

/// Rounds one optical depth; `carry` is how much of the ray's depth is still owed. Only ever chooses between the two codes
/// next to the depth, so that what a thick supersegment lost does not make a thin one behind it visible.
fn opacity_code(optical_depth: f64, carry: &mut f64) -> u8 {
    if optical_depth == 0.0 {
        return 0;
    }
    let exact = position(optical_depth);
    let (below, above) = (exact.floor().max(1.0), exact.ceil().max(1.0));
    let depth_of = |code: f64| f64::from(OPTICAL_DEPTH[code as usize]);
    // Steps this coarse belong to thick supersegments: their errors neither add up nor can be made good further back.
    if depth_of(above) - depth_of(below) > 2.0 * SLACK || above == 255.0 {
        *carry = 0.0;
        return exact.round().max(1.0) as u8;
    }
    let owed = if carry.abs() > SLACK { *carry } else { 0.0 };
    let code = position((optical_depth + owed).max(0.0)).round().clamp(below, above);
    *carry += optical_depth - depth_of(code);
    code as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_comes_back_from_its_optical_depth_and_owes_nothing() {
        for code in 0..=255_u8 {
            let mut carry = 0.0;
            assert_eq!(opacity_code(f64::from(OPTICAL_DEPTH[usize::from(code)]), &mut carry), code);
            assert_eq!(carry, 0.0);
        }
    }

    #[test]
    fn the_scale_keeps_digits_at_both_ends_and_no_depth_vanishes() {
        // -2 ln(1 - 1/255^2) = 2/65025 + 1/65025^2 + ..
        assert!((f64::from(OPTICAL_DEPTH[1]) - 2.0 / 65025.0 - 1.0 / 65025.0_f64.powi(2)).abs() < 1e-11);
        assert_eq!(OPTICAL_DEPTH[255], f32::INFINITY);
        assert_eq!(opacity_code(1e-30, &mut 0.0), 1);
        assert_eq!(opacity_code(1e-30, &mut -1.0), 1);
        assert_eq!(opacity_code(40.0, &mut 0.0), 255);
        assert_eq!(opacity_code(f64::INFINITY, &mut 0.0), 255);
    }

    #[test]
    fn along_a_uniform_ray_the_optical_depth_is_kept() {
        for depth in [1e-3, 0.0157, 0.0153, 0.1, 0.3] {
            let mut carry = 0.0;
            let sum: f64 =
                (0..1000).map(|_| f64::from(OPTICAL_DEPTH[usize::from(opacity_code(depth, &mut carry))])).sum();
            assert!((sum - 1000.0 * depth).abs() < 2.0 * SLACK, "{depth} x 1000 became {sum}");
        }
    }
}
