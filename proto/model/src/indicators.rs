//! What a measurement of generation parameters yields: the paper's sigma, q and tau.

use crate::Invalid;
use std::time::Duration;

/// The three indicators of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indicators {
    /// Bytes of the encoded VDI.
    #[doc(alias = "sigma")]
    pub size_bytes: u64,
    /// PSNR pooled over all test views, decibels; +infinity if identical.
    #[doc(alias = "q")]
    pub psnr_db: f64,
    /// Wall time of generation, without encoding.
    #[doc(alias = "tau")]
    pub generation_time: Duration,
}

/// Measured quality: the mean squared error of every batch of sampled pixels, view by view.
///
/// Batches are independent samples of equal size, so their scatter tells how well the whole is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Quality {
    /// Per test view, in the plan's order; all hold the same number of batches.
    pub views: Vec<ViewError>,
}

/// Errors of one test view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewError {
    /// Rotation of the generation camera about +y through its target, degrees.
    pub angle_deg: f64,
    /// Mean squared error of each batch, 0 or more; colors lie in 0..=1.
    pub batch_mse: Vec<f64>,
    /// Structural similarity ([`crate::ssim::ssim`]), where every pixel of the view was compared.
    pub ssim: Option<f64>,
}

/// -10 log10 of a mean squared error of colors in 0..=1: decibels, +infinity for 0.
pub fn decibels(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    values.sum::<f64>() / n
}

impl ViewError {
    /// PSNR of this view in decibels.
    pub fn psnr_db(&self) -> f64 {
        decibels(mean(self.batch_mse.iter().copied()))
    }
}

impl Quality {
    /// Batches measured.
    pub fn batches(&self) -> usize {
        self.views.first().map_or(0, |v| v.batch_mse.len())
    }

    /// Mean squared error of each batch, pooled over the views.
    pub fn batch_mse(&self) -> Vec<f64> {
        (0..self.batches()).map(|b| mean(self.views.iter().map(|v| v.batch_mse[b]))).collect()
    }

    /// Mean squared error pooled over views and batches; NaN of nothing.
    pub fn mse(&self) -> f64 {
        mean(self.batch_mse().into_iter())
    }

    /// PSNR of the pooled error, decibels; +infinity if identical, NaN of nothing.
    #[doc(alias = "q")]
    pub fn psnr_db(&self) -> f64 {
        decibels(self.mse())
    }

    /// Mean structural similarity of all views; `None` where only some of their pixels were compared.
    pub fn ssim(&self) -> Option<f64> {
        let views: Option<Vec<f64>> = self.views.iter().map(|v| v.ssim).collect();
        views.filter(|views| !views.is_empty()).map(|views| mean(views.into_iter()))
    }

    /// The first `batches` of it; nothing of none.
    #[must_use]
    pub fn first(&self, batches: usize) -> Self {
        let first = |v: &ViewError| ViewError {
            angle_deg: v.angle_deg,
            batch_mse: v.batch_mse.iter().copied().take(batches).collect(),
            ssim: v.ssim,
        };
        Self { views: if batches == 0 { Vec::new() } else { self.views.iter().map(first).collect() } }
    }

    /// Adds further batches of the same views.
    ///
    /// # Errors
    /// If the views are others.
    pub fn extend(&mut self, more: &Self) -> Result<(), Invalid> {
        let angles = |q: &Self| q.views.iter().map(|v| v.angle_deg).collect::<Vec<_>>();
        if self.views.is_empty() {
            *self = more.clone();
        } else if angles(self) == angles(more) {
            for (view, more) in self.views.iter_mut().zip(&more.views) {
                view.batch_mse.extend_from_slice(&more.batch_mse);
            }
        } else {
            return Err(Invalid::new("quality", "further batches are of other views"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_pool_to_the_mean_over_views_and_batches() {
        let view = |angle_deg, batch_mse: &[f64]| ViewError { angle_deg, batch_mse: batch_mse.to_vec(), ssim: None };
        let mut q = Quality { views: vec![view(10.0, &[0.01, 0.03]), view(20.0, &[0.03, 0.05])] };
        assert_eq!(q.batch_mse(), [0.02, 0.04]);
        assert!((q.mse() - 0.03).abs() < 1e-15 && (q.views[0].psnr_db() - 10.0 * 50_f64.log10()).abs() < 1e-12);
        q.extend(&Quality { views: vec![view(10.0, &[0.0]), view(20.0, &[0.0])] }).unwrap();
        assert!((q.mse() - 0.02).abs() < 1e-15 && q.batches() == 3);
        assert!(q.extend(&Quality { views: vec![view(11.0, &[0.0])] }).is_err());
        assert!(Quality::default().psnr_db().is_nan());
        assert_eq!(decibels(0.0), f64::INFINITY);
    }
}
