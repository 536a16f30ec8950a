//! Peak signal-to-noise ratio with peak 1: -10 log10(MSE) over all pixels and channels.

use crate::{Image, Invalid, decibels};

/// Squared differences gathered so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SquaredError {
    sum: f64,
    count: u64,
}

impl SquaredError {
    /// Adds one pixel.
    pub fn add(&mut self, a: [f32; 3], b: [f32; 3]) {
        for c in 0..3 {
            let d = f64::from(a[c]) - f64::from(b[c]);
            self.sum += d * d;
        }
        self.count += 3;
    }

    /// Adds all pixel pairs of two equally long slices.
    pub fn add_all(&mut self, a: &[[f32; 3]], b: &[[f32; 3]]) {
        debug_assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(b) {
            self.add(*a, *b);
        }
    }

    /// Pools another set of differences.
    pub fn merge(&mut self, other: Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// Mean squared error; NaN of nothing.
    pub fn mse(&self) -> f64 {
        self.sum / self.count as f64
    }

    /// PSNR in decibels; +infinity if identical, NaN of nothing.
    pub fn psnr_db(&self) -> f64 {
        decibels(self.mse())
    }
}

/// PSNR of two pictures in decibels.
///
/// # Errors
/// If their sizes differ.
pub fn psnr(a: &Image, b: &Image) -> Result<f64, Invalid> {
    if (a.width(), a.height()) != (b.width(), b.height()) {
        let (aw, ah, bw, bh) = (a.width(), a.height(), b.width(), b.height());
        return Err(Invalid::new("images", format!("sizes differ: {aw} x {ah} and {bw} x {bh}")));
    }
    let mut error = SquaredError::default();
    error.add_all(a.pixels(), b.pixels());
    Ok(error.psnr_db())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_everywhere_is_twenty_decibels_and_nothing_is_infinite() {
        let a = Image::new(2, 2, vec![[0.5; 3]; 4]).unwrap();
        let b = Image::new(2, 2, vec![[0.6; 3]; 4]).unwrap();
        assert!((psnr(&a, &b).unwrap() - 20.0).abs() < 1e-5);
        assert_eq!(psnr(&a, &a).unwrap(), f64::INFINITY);
        assert!(psnr(&a, &Image::new(1, 1, vec![[0.5; 3]]).unwrap()).is_err());
        assert!(SquaredError::default().psnr_db().is_nan());
    }
}
