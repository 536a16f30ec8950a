//! Opacity of an optical depth, 1 - exp(-x), in f32 arithmetic without branches or calls.
//!
//! exp(-x) = 2^n 2^f with n the nearest integer to -x / ln 2 and |f| <= 1/2. So 1 - exp(-x) = (1 - 2^n) - 2^n (2^f -
//! 1), and where n = 0 the first bracket vanishes: small opacities keep their relative precision.

use std::f32::consts::{LN_2, LOG2_E};

/// Beyond it nothing comes through in f32; keeps 2^n a normal number, also for infinity.
const OPAQUE: f32 = 80.0;
/// Adding and subtracting 1.5 x 2^23 rounds to the nearest integer, which is then in the sum's low bits.
const ROUND: f32 = 12_582_912.0;

/// 2^f - 1 = f (SERIES[0] + f (SERIES[1] + ..)): ln(2)^n / n!. The seventh term is below 2e-8 of the sum.
const SERIES: [f32; 6] = {
    let mut terms = [LN_2; 6];
    let mut n = 1;
    while n < terms.len() {
        terms[n] = terms[n - 1] * LN_2 / (n + 1) as f32;
        n += 1;
    }
    terms
};

/// 1 - exp(-`optical_depth`) for an optical depth >= 0, infinity included. Relative error below 6e-7.
#[inline(always)]
pub fn opacity(optical_depth: f32) -> f32 {
    let y = optical_depth.min(OPAQUE) * -LOG2_E;
    let shifted = y + ROUND;
    let n = shifted - ROUND;
    let f = y - n;
    let p = f * (SERIES[0] + f * (SERIES[1] + f * (SERIES[2] + f * (SERIES[3] + f * (SERIES[4] + f * SERIES[5])))));
    let power = f32::from_bits(shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23);
    (1.0 - power) - power * p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_error_is_below_6e_7_from_the_smallest_depth_to_infinity() {
        let mut worst = (0.0, 0.0);
        let mut x = 1e-30_f32;
        while x < 200.0 {
            let exact = -(-f64::from(x)).exp_m1();
            let error = (f64::from(opacity(x)) / exact - 1.0).abs();
            if error > worst.0 {
                worst = (error, x);
            }
            x *= 1.000_37;
        }
        assert!(worst.0 < 6e-7, "relative error {} at {}", worst.0, worst.1);
        assert_eq!(opacity(0.0), 0.0);
        assert_eq!(opacity(f32::INFINITY), 1.0);
    }
}
