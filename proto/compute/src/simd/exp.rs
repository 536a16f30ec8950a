//! The exponential in lanes.

use super::{Floats, Ints, Lanes};

/// 1 - exp(-x) for x >= 0, within 3e-7.
///
/// exp(-x) = 2^n 2^f with whole n and f in -1/2..1/2. The polynomial is 2^f interpolated at the Chebyshev nodes of degree
/// 5, within 8e-8; its terms are paired, because a chain of sums waits for each one.
#[inline(always)]
pub fn opacity<L: Lanes>(x: L::F) -> L::F {
    let s = L::F::splat;
    let y = (x * s(-std::f32::consts::LOG2_E)).max(s(-126.0));
    // Towards zero after moving half down: the nearest whole number of what is not positive.
    let n = (y - s(0.5)).to_int();
    let f = y - L::F::from(n);
    let square = f * f;
    let p01 = s(1.000_000_1) + s(std::f32::consts::LN_2) * f;
    let p23 = s(0.240_221_08) + s(0.055_503_57) * f;
    let p45 = s(0.009_676_032) + s(0.001_339_086_3) * f;
    let p = p01 + square * (p23 + square * p45);
    s(1.0) - p * L::F::exp2_int(n.max(L::I::splat(-126)))
}

/// Below it [`small_opacity`] holds.
pub const SMALL: f32 = 0.25;

/// 1 - exp(-x) for x in 0..=[`SMALL`], within 3e-7 of its value: the series, which keeps the digits of what is nearly
/// nothing.
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
            let x = SMALL * (n as f32 * -2e-4).exp();
            let ours = small_opacity::<Portable>(<Portable as Lanes>::F::from_array([x; WIDTH])).to_array()[0];
            let exact = -(-f64::from(x)).exp_m1();
            assert!((f64::from(ours) / exact - 1.0).abs() < 3e-7, "{x}: {ours} {exact}");
        }
        let none = small_opacity::<Portable>(<Portable as Lanes>::F::splat(0.0)).to_array();
        assert_eq!(none, [0.0; WIDTH]);
    }
}
