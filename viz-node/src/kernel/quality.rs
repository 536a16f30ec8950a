//! q: the PSNR of pictures against reference samples.

use lamina_model::{Camera, Invalid, Quality, ReferenceSamples, SquaredError, ViewError};
use std::ops::Range;

/// Errors of some batches of the sampled pixels, which `render_pixels` draws of a square picture.
///
/// # Errors
/// If the samples do not fit their plan, or hold fewer batches.
pub fn quality_of(
    reference: &ReferenceSamples,
    batches: Range<u32>,
    render_pixels: impl Fn(&Camera, u32, &[(u32, u32)]) -> Result<Vec<[f32; 3]>, Invalid>,
) -> Result<Quality, Invalid> {
    let plan = reference.plan.clone().check()?;
    let cameras = plan.test_cameras(&reference.scene.camera)?;
    if reference.colors.len() != cameras.len() || reference.colors.iter().any(|c| c.len() != plan.samples_per_view()) {
        return Err(Invalid::new("reference", "the number of colours does not fit the sample plan"));
    }
    if batches.is_empty() || batches.end > plan.batches {
        return Err(Invalid::new("batches", format!("{batches:?} asked for; the plan has 0..{}", plan.batches)));
    }
    let size = plan.samples_per_batch();
    let mut quality = Quality::default();
    for (v, (camera, colors)) in cameras.iter().zip(&reference.colors).enumerate() {
        // One call for all batches: neighbouring pixels of different batches share work.
        let pixels: Vec<_> = batches.clone().flat_map(|b| plan.pixels(v, b)).collect();
        let rendered = render_pixels(camera, plan.image_size, &pixels)?;
        let wanted = &colors[batches.start as usize * size..batches.end as usize * size];
        let mse = |(a, b): (&[[f32; 3]], &[[f32; 3]])| {
            let mut error = SquaredError::default();
            error.add_all(a, b);
            error.mse()
        };
        let batch_mse = rendered.chunks(size).zip(wanted.chunks(size)).map(mse).collect();
        quality.views.push(ViewError { angle_deg: plan.angles_deg[v], batch_mse });
    }
    Ok(quality)
}
