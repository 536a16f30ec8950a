//! q: the PSNR of a VDI's pictures against reference samples.

use super::PreparedVdi;
use lamina_model::{Camera, Invalid, Quality, ReferenceSamples, SquaredError, Vdi};
use std::ops::Deref;

/// PSNR per view and pooled over the sampled pixels.
///
/// # Errors
/// If the samples do not fit their plan.
#[doc(alias = "q")]
pub fn quality(vdi: &Vdi, reference: &ReferenceSamples) -> Result<Quality, Invalid> {
    PreparedVdi::new(vdi).quality(reference)
}

impl<V: Deref<Target = Vdi>> PreparedVdi<V> {
    /// PSNR per view and pooled over the sampled pixels.
    ///
    /// # Errors
    /// If the samples do not fit their plan.
    #[doc(alias = "q")]
    pub fn quality(&self, reference: &ReferenceSamples) -> Result<Quality, Invalid> {
        quality_of(reference, |camera, size, pixels| Ok(self.render_pixels(camera, size, size, pixels)))
    }
}

/// The same for whatever draws pixels of a square picture.
pub fn quality_of(
    reference: &ReferenceSamples,
    render_pixels: impl Fn(&Camera, u32, &[(u32, u32)]) -> Result<Vec<[f32; 3]>, Invalid>,
) -> Result<Quality, Invalid> {
    let plan = reference.plan.clone().check()?;
    let cameras = plan.test_cameras(&reference.scene.camera)?;
    if reference.colors.len() != cameras.len() || reference.colors.iter().any(|c| c.len() != plan.samples_per_view()) {
        return Err(Invalid::new("reference", "the number of colours does not fit the sample plan"));
    }
    let mut pooled = SquaredError::default();
    let mut views = Vec::new();
    for (v, (camera, colors)) in cameras.iter().zip(&reference.colors).enumerate() {
        let rendered = render_pixels(camera, plan.image_size, &plan.pixels(v))?;
        let mut error = SquaredError::default();
        error.add_all(&rendered, colors);
        views.push((plan.angles_deg[v], error.psnr_db()));
        pooled.merge(error);
    }
    Ok(Quality { psnr_db: pooled.psnr_db(), views })
}
