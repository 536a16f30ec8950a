//! A limit on structural similarity: what breaks it, and which PSNR a study has to expect to keep it.
//!
//! The models of a search predict PSNR. Among parameters of one representation on one step both rise together: -10 log10(1 - SSIM)
//! is nearly linear in PSNR, so the trials measured so far tell at how many decibels the limit lies. Whether a trial keeps it is told
//! by its own SSIM alone.

use crate::Contract;
use crate::evaluator::Measurement;
use crate::tune::Trial;
use lamina_model::{Invalid, Limits, Quality};

/// Decibels of PSNR by decibels of SSIM before trials tell: `OFFSET + SLOPE * ssim`, about what recorded fields give.
const OFFSET: f64 = 14.0;
const SLOPE: f64 = 1.25;
/// Slopes between two trials beyond this range are noise.
const SLOPES: std::ops::RangeInclusive<f64> = 0.4..=2.0;

/// SSIM in decibels: -10 log10(1 - ssim), +infinity for 1.
fn ssim_db(ssim: f64) -> f64 {
    -10.0 * (1.0 - ssim).log10()
}

impl Contract {
    /// True if the structural similarity is known to be less than the limit.
    pub(crate) fn breaks_ssim(&self, quality: &Quality) -> bool {
        self.is_above(quality.ssim())
    }

    /// True if the limit lies above a structural similarity that was measured.
    pub(crate) fn is_above(&self, ssim: Option<f64>) -> bool {
        self.ssim.zip(ssim).is_some_and(|(least, ssim)| ssim < least)
    }

    /// True if a trial keeps every limit that it was measured against.
    pub fn keeps(&self, measured: &Measurement) -> bool {
        self.excess(&measured.cost, measured.quality.psnr_db()) <= 0.0 && !self.breaks_ssim(&measured.quality)
    }

    /// Passes a quality that can be judged.
    ///
    /// # Errors
    /// If structural similarity is limited, and it was measured on some of the pixels only.
    pub(crate) fn check_ssim(&self, quality: &Quality) -> Result<(), Invalid> {
        if self.ssim.is_some() && quality.batches() > 0 && quality.ssim().is_none() {
            let reason = "ssim: the generator-node has some of the pixels compared, and it takes all of them; set image_size = 256, \
                 tile = 1 and batches = 1 under [samples] there, or start the nodes with this contract";
            return Err(Invalid::new("contract", reason));
        }
        Ok(())
    }

    /// What [`Self::describe`] says of it.
    pub(crate) fn describe_ssim(&self, quality: &Quality) -> String {
        let of = |(least, ssim): (f64, f64)| format!(", ssim {ssim:.4} (limit {least})");
        self.ssim.zip(quality.ssim()).map_or_else(String::new, of)
    }

    /// This contract with its limit on structural similarity as one on PSNR, as far as `tried` tell.
    #[must_use]
    pub(crate) fn with_psnr_for_ssim<'a>(&self, tried: impl Iterator<Item = &'a Trial>) -> Self {
        let Some(least) = self.ssim.map(ssim_db).filter(|db| db.is_finite()) else { return self.clone() };
        let point = |row: &Trial| Some([ssim_db(row.measured.quality.ssim()?), row.measured.quality.psnr_db()]);
        let mut known: Vec<[f64; 2]> = tried.filter_map(point).filter(|p| p.iter().all(|v| v.is_finite())).collect();
        known.sort_by(|a, b| (a[0] - least).abs().total_cmp(&(b[0] - least).abs()));
        let equal = match known[..] {
            [] => OFFSET + SLOPE * least,
            [[at, psnr]] => psnr + SLOPE * (least - at),
            [[at, psnr], [next, further], ..] => {
                let slope = (further - psnr) / (next - at);
                let slope = if slope.is_nan() { SLOPE } else { slope.clamp(*SLOPES.start(), *SLOPES.end()) };
                psnr + slope * (least - at)
            }
        };
        let psnr_db = Some(self.limits.psnr_db.map_or(equal, |own| own.max(equal)));
        Self { limits: Limits { psnr_db, ..self.limits }, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{GenerationParams, ViewError};

    fn trial(psnr: f64, ssim: Option<f64>) -> Trial {
        let batch_mse = vec![10_f64.powf(-psnr / 10.0)];
        let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse, ssim }] };
        let measured = Measurement { quality, ..Measurement::default() };
        Trial { params: GenerationParams::vdi(64, 0.02).unwrap(), measured, cost: 0.0 }
    }

    #[test]
    fn the_line_through_the_nearest_trials_tells_the_decibels() {
        let contract: Contract = "ssim >= 0.99, psnr >= 30dB".parse().unwrap();
        let floor = |rows: &[Trial]| contract.with_psnr_for_ssim(rows.iter()).limits.psnr_db.unwrap();
        // 0.9 and 0.999 are 10 and 30 dB, 0.99 lies in the middle.
        let [low, high, far] = [trial(35.0, Some(0.9)), trial(51.0, Some(0.999)), trial(20.0, Some(0.0))];
        assert!((floor(&[low.clone(), far, high]) - 43.0).abs() < 1e-9);
        assert!((floor(&[low]) - (35.0 + SLOPE * 10.0)).abs() < 1e-9);
        assert!((floor(&[trial(35.0, None)]) - (OFFSET + SLOPE * 20.0)).abs() < 1e-9);
        let alone: Contract = "size <= 1kB".parse().unwrap();
        assert_eq!(alone.with_psnr_for_ssim([trial(35.0, Some(0.9))].iter()), alone);
    }

    #[test]
    fn a_trial_is_judged_by_its_own_similarity() {
        let contract: Contract = "ssim >= 0.98".parse().unwrap();
        assert_eq!(contract.cost(&trial(40.0, Some(0.979)).measured), f64::INFINITY);
        assert_eq!(contract.cost(&trial(30.0, Some(0.98)).measured), 0.0, "its bytes, as quality alone is limited");
        let sampled = trial(40.0, None).measured.quality;
        assert!(contract.check_ssim(&sampled).unwrap_err().to_string().contains("tile = 1"));
        assert!(contract.check_ssim(&Quality::default()).is_ok(), "only the cost was asked for");
        assert!(contract.describe(&trial(40.0, Some(0.979)).measured).ends_with("ssim 0.9790 (limit 0.98)"));
    }
}
