//! How far pictures are apart.

use lamina_model::decibels;

/// Differences over pixels and channels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Error {
    /// Root of the mean square.
    pub rms: f64,
    /// The greatest.
    pub max: f64,
}

impl Error {
    /// Between two lists of colors.
    pub(super) fn between<A: Copy + Into<f64>, B: Copy + Into<f64>>(a: &[[A; 3]], b: &[[B; 3]]) -> Self {
        let differences = || a.iter().flatten().zip(b.iter().flatten()).map(|(&a, &b)| (a.into() - b.into()).abs());
        let squares: f64 = differences().map(|d| d * d).sum();
        let count = 3 * a.len().min(b.len());
        Self { rms: (squares / count as f64).sqrt(), max: differences().fold(0.0, f64::max) }
    }

    /// As PSNR, peak 1: infinite where nothing differs.
    pub(super) fn decibels(&self) -> f64 {
        decibels(self.rms * self.rms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_in_one_channel_of_two_pixels() {
        let error = Error::between(&[[0.1_f64, 0.0, 0.0], [0.0; 3]], &[[0.0_f64; 3]; 2]);
        assert!((error.rms - 0.1 / 6.0_f64.sqrt()).abs() < 1e-15 && error.max == 0.1);
        assert!((error.decibels() - 27.78).abs() < 0.01);
    }
}
