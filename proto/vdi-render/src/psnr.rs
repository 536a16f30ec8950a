//! Quality: PSNR of rendered pixels against reference samples; where every pixel of the views is compared, their structural
//! similarity too.

use lamina_model::ssim::{self, ssim};
use lamina_model::{Camera, Image, Invalid, Quality, ReferenceSamples, SquaredError, ViewError};
use std::ops::Range;

/// Quality estimated from sampled pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct QualityEstimate {
    /// Errors of the batches measured.
    pub quality: Quality,
    /// Half the width of the 95 % confidence interval of its PSNR, decibels.
    pub half_width_db: f64,
}

/// Squared errors of sampled pixels, per view, batch after batch.
struct PixelErrors {
    angles_deg: Vec<f64>,
    per_batch: usize,
    errors: Vec<Vec<f64>>,
    /// Per view; `None` where only some pixels were compared.
    ssim: Vec<Option<f64>>,
}

impl PixelErrors {
    fn quality(&self) -> Quality {
        let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
        let view = |((angle_deg, errors), ssim): ((&f64, &Vec<f64>), &Option<f64>)| ViewError {
            angle_deg: *angle_deg,
            batch_mse: errors.chunks(self.per_batch).map(mean).collect(),
            ssim: *ssim,
        };
        Quality { views: self.angles_deg.iter().zip(&self.errors).zip(&self.ssim).map(view).collect() }
    }

    /// Half-width of the interval: the mean of n pixels has a standard error of at most s / sqrt(n), as stratification only
    /// reduces it; converted to decibels to first order.
    fn half_width_db(&self) -> f64 {
        let all = || self.errors.iter().flatten();
        let n = all().count() as f64;
        let mean = all().sum::<f64>() / n;
        if mean == 0.0 {
            return 0.0;
        }
        let variance = all().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        10.0 / std::f64::consts::LN_10 * NORMAL_975 * (variance / n).sqrt() / mean
    }
}

/// 0.975 quantile of the normal distribution.
const NORMAL_975: f64 = 1.960;

/// Quality on some batches of the reference samples, whose pixels `render_pixels` renders (camera, side of the picture, pixels).
///
/// # Errors
/// If the samples do not fit their plan, or hold fewer batches.
pub(crate) fn quality_of(
    reference: &ReferenceSamples,
    batches: Range<u32>,
    render_pixels: impl Fn(&Camera, u32, &[(u32, u32)]) -> Result<Vec<[f32; 3]>, Invalid>,
) -> Result<Quality, Invalid> {
    Ok(pixel_errors(reference, batches, render_pixels)?.quality())
}

/// Quality on all batches that the reference holds, with its confidence interval.
///
/// # Errors
/// As [`quality_of`].
pub(crate) fn estimate_of(
    reference: &ReferenceSamples,
    render_pixels: impl Fn(&Camera, u32, &[(u32, u32)]) -> Result<Vec<[f32; 3]>, Invalid>,
) -> Result<QualityEstimate, Invalid> {
    let errors = pixel_errors(reference, reference.batches.clone(), render_pixels)?;
    Ok(QualityEstimate { quality: errors.quality(), half_width_db: errors.half_width_db() })
}

fn pixel_errors(
    reference: &ReferenceSamples,
    batches: Range<u32>,
    render_pixels: impl Fn(&Camera, u32, &[(u32, u32)]) -> Result<Vec<[f32; 3]>, Invalid>,
) -> Result<PixelErrors, Invalid> {
    let plan = reference.plan.clone().check()?;
    let cameras = plan.test_cameras(&reference.scene.camera)?;
    let held = reference.batches.len() * plan.samples_per_batch();
    if reference.colors.len() != cameras.len() || reference.colors.iter().any(|c| c.len() != held) {
        return Err(Invalid::new("reference", "the number of colors does not fit the sample plan"));
    }
    if batches.is_empty() || batches.end > plan.batches {
        return Err(Invalid::new("batches", format!("{batches:?} asked for; the plan has 0..{}", plan.batches)));
    }
    let missing = || Invalid::new("batches", format!("{batches:?} asked for; {:?} are here", reference.batches));
    let (mut errors, mut similarities) = (Vec::with_capacity(cameras.len()), Vec::with_capacity(cameras.len()));
    let side = plan.image_size;
    let is_whole = plan.is_whole() && side as usize >= ssim::WINDOW;
    for (v, camera) in cameras.iter().enumerate() {
        let wanted = reference.batch_colors(v, &batches).ok_or_else(missing)?;
        // Render all batches in one call: neighboring pixels of different batches share work.
        let pixels: Vec<_> = batches.clone().flat_map(|b| plan.pixels(v, b)).collect();
        let rendered = render_pixels(camera, plan.image_size, &pixels)?;
        let error = |(a, b): (&[f32; 3], &[f32; 3])| {
            let mut error = SquaredError::default();
            error.add(*a, *b);
            error.mse()
        };
        errors.push(rendered.iter().zip(wanted).map(error).collect());
        // With one pixel a block, the pixels are the rows of the picture.
        let picture = |pixels: &[[f32; 3]]| Image::new(side, side, pixels.to_vec());
        similarities.push(if is_whole { Some(ssim(&picture(&rendered)?, &picture(wanted)?)?) } else { None });
    }
    Ok(PixelErrors { per_batch: plan.samples_per_batch(), angles_deg: plan.angles_deg, errors, ssim: similarities })
}
