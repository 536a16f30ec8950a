//! How well a sampled quality is known.
//!
//! Batches are independent samples of equal size, so their mean has Student's t distribution about the whole picture's mean
//! squared error. In decibels the interval is taken to first order: the relative error of the mean, times 10 / ln 10.

use lamina_model::Quality;

/// 0.975 quantile of Student's t with n degrees of freedom, n = 1, 2, ... (NIST/SEMATECH e-Handbook of Statistical Methods,
/// table 1.3.6.7.2).
const STUDENT_T: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
    2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];
/// The same with infinitely many.
const NORMAL: f64 = 1.960;

fn student_t(freedom: usize) -> f64 {
    // Beyond the table the quantile nears its limit as 1/n: 30 degrees are 0.082 above it.
    STUDENT_T.get(freedom - 1).copied().unwrap_or(NORMAL + 2.46 / freedom as f64)
}

/// Half the width of a 95 % interval about the mean of `values`; infinite for fewer than two.
fn half_width(values: &[f64]) -> f64 {
    let n = values.len();
    if n < 2 {
        return f64::INFINITY;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
    student_t(n - 1) * (variance / n as f64).sqrt()
}

/// Half the width of the 95 % interval about the PSNR, decibels; infinite where fewer than two batches were measured, 0 where
/// all pixels are identical.
pub fn half_width_db(quality: &Quality) -> f64 {
    let mse = quality.mse();
    if mse == 0.0 { 0.0 } else { 10.0 / std::f64::consts::LN_10 * half_width(&quality.batch_mse()) / mse }
}

/// The 95 % interval of by how many decibels `a` is better than `b`, from the batches that both have: the same pixels, so
/// that what makes them hard counts for both.
pub fn difference_db(a: &Quality, b: &Quality) -> (f64, f64) {
    let (a, b) = (a.batch_mse(), b.batch_mse());
    let n = a.len().min(b.len());
    let mean = |v: &[f64]| v[..n].iter().sum::<f64>() / n as f64;
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let better = 10.0 * (mean_b / mean_a).log10();
    if !better.is_finite() {
        return (better, better);
    }
    // To first order ln(b / a) varies as b / mean b - a / mean a.
    let relative: Vec<f64> = a.iter().zip(&b).map(|(a, b)| b / mean_b - a / mean_a).collect();
    let width = 10.0 / std::f64::consts::LN_10 * half_width(&relative);
    (better - width, better + width)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::ViewError;

    fn quality(batch_mse: &[f64]) -> Quality {
        Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: batch_mse.to_vec(), ssim: None }] }
    }

    #[test]
    fn widths_are_those_of_the_textbook() {
        // Mean 2, standard deviation 1, n = 3: 4.303 / sqrt(3).
        assert!((half_width(&[1.0, 2.0, 3.0]) - 4.303 / 3_f64.sqrt()).abs() < 1e-12);
        let db = half_width_db(&quality(&[0.01, 0.02, 0.03]));
        assert!((db - 10.0 / std::f64::consts::LN_10 * 4.303 / 3_f64.sqrt() / 2.0).abs() < 1e-9);
        assert_eq!(half_width_db(&quality(&[0.1])), f64::INFINITY);
        assert_eq!(half_width_db(&quality(&[0.0, 0.0])), 0.0);
        // The table's own values at 40 and 100 degrees of freedom.
        assert!((student_t(40) - 2.021).abs() < 1e-3 && (student_t(100) - 1.984).abs() < 1e-3);
    }

    #[test]
    fn what_is_hard_for_both_does_not_blur_their_difference() {
        let a = quality(&[1e-4, 9e-4, 2e-4, 5e-4]);
        let b = quality(&[2e-4, 18e-4, 4e-4, 10e-4]);
        let (low, high) = difference_db(&a, &b);
        assert!((low - 3.0103).abs() < 1e-3 && (high - 3.0103).abs() < 1e-3);
        assert!(half_width_db(&a) > 3.0);
        let (low, high) = difference_db(&a, &quality(&[9e-4, 1e-4, 5e-4, 2e-4]));
        assert!(low < 0.0 && high > 0.0);
        assert_eq!(difference_db(&quality(&[0.0, 0.0]), &b), (f64::INFINITY, f64::INFINITY));
    }
}
