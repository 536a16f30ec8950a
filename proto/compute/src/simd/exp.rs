//! Opacity from optical depth, 1 - exp(-x), in lanes.

use super::{Lanes, SimdF32, SimdI32};

/// 1 - exp(-x) for x >= 0, within 3e-7.
///
/// exp(-x) = 2^n 2^f with integer n and f in -1/2..1/2. The polynomial interpolates 2^f at the Chebyshev nodes of degree 5,
/// within 8e-8; its terms are evaluated in pairs, to shorten the chain of dependent additions.
#[inline(always)]
pub fn opacity<L: Lanes>(x: L::F) -> L::F {
    let s = L::F::splat;
    let y = (x * s(-std::f32::consts::LOG2_E)).max(s(-126.0));
    // Round to the nearest integer: y is not positive, and `to_int` rounds towards zero.
    let n = (y - s(0.5)).to_int();
    let f = y - L::F::from(n);
    let square = f * f;
    let p01 = s(1.000_000_1) + s(std::f32::consts::LN_2) * f;
    let p23 = s(0.240_221_08) + s(0.055_503_57) * f;
    let p45 = s(0.009_676_032) + s(0.001_339_086_3) * f;
    let p = p01 + square * (p23 + square * p45);
    s(1.0) - p * L::F::exp2_int(n.max(L::I::splat(-126)))
}

/// Largest optical depth for [`small_opacity`].
pub const SMALL_OPTICAL_DEPTH: f32 = 0.25;

/// 1 - exp(-x) for x in 0..=[`SMALL_OPTICAL_DEPTH`], with a relative error below 3e-7: the Taylor series, which has no
/// cancellation near 0.
#[inline(always)]
pub fn small_opacity<L: Lanes>(x: L::F) -> L::F {
    let s = L::F::splat;
    let rest = s(-1.0 / 2.0) + x * (s(1.0 / 6.0) + x * (s(-1.0 / 24.0) + x * (s(1.0 / 120.0) - x * s(1.0 / 720.0))));
    x + x * (x * rest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Portable, WIDTH};

    #[test]
    fn it_is_within_its_bound_from_nothing_to_opaque() {
        for n in 0..200_000_u32 {
            let x = (n as f32 * 1e-4).exp() - 1.0 + n as f32 * 1e-9;
            let ours = opacity::<Portable>(<Portable as Lanes>::F::from_array([x; WIDTH])).to_array()[0];
            let exact = -(-f64::from(x)).exp_m1();
            assert!((f64::from(ours) - exact).abs() < 3e-7, "{x}: {ours} {exact}");
        }
    }

    #[test]
    fn what_is_nearly_nothing_keeps_its_digits() {
        for n in 0..100_000_u32 {
            let x = SMALL_OPTICAL_DEPTH * (n as f32 * -2e-4).exp();
            let ours = small_opacity::<Portable>(<Portable as Lanes>::F::from_array([x; WIDTH])).to_array()[0];
            let exact = -(-f64::from(x)).exp_m1();
            assert!((f64::from(ours) / exact - 1.0).abs() < 3e-7, "{x}: {ours} {exact}");
        }
        let none = small_opacity::<Portable>(<Portable as Lanes>::F::splat(0.0)).to_array();
        assert_eq!(none, [0.0; WIDTH]);
    }
}
