//! Reference samples on the wire: an announcement and 16-bit colors (error below 1e-5, past 100 dB).

use crate::{required, v1};
use lamina_model::{Invalid, ReferenceSamples, SamplePlan};

/// The announcement and the colors' bytes.
pub fn encode(run_id: &str, samples: &ReferenceSamples) -> (v1::Reference, Vec<u8>) {
    let code = |c: &f32| ((c.clamp(0.0, 1.0) * 65535.0).round() as u16).to_le_bytes();
    let mut bytes = Vec::with_capacity(6 * samples.colors.iter().map(Vec::len).sum::<usize>());
    bytes.extend(samples.colors.iter().flatten().flatten().flat_map(code));
    let reference = v1::Reference {
        run_id: run_id.to_owned(),
        step: samples.step,
        scene: Some((&samples.scene).into()),
        image_size: samples.plan.image_size,
        tile: samples.plan.tile,
        batches: samples.plan.batches,
        angles_deg: samples.plan.angles_deg.clone(),
        bytes: bytes.len() as u64,
        first_batch: samples.batches.start,
        held_batches: samples.batches.len() as u32,
    };
    (reference, bytes)
}

/// Samples from an announcement and its bytes.
///
/// # Errors
/// If the scene or plan is not valid or the bytes are not as many as the plan needs.
pub fn decode(reference: v1::Reference, bytes: &[u8]) -> Result<ReferenceSamples, Invalid> {
    let v1::Reference { image_size, tile, batches, angles_deg, first_batch, held_batches, .. } = reference;
    let plan = SamplePlan { image_size, tile, batches, angles_deg }.check()?;
    let held = if held_batches == 0 { batches } else { held_batches };
    let slice = plan.slice(first_batch, held)?;
    let per_view = 6 * plan.samples_per_batch() * held as usize;
    if bytes.len() != per_view * plan.angles_deg.len() {
        return Err(Invalid::new("reference", format!("{} bytes do not fit its sample plan", bytes.len())));
    }
    let color = |b: &[u8; 6]| [0, 2, 4].map(|k| f32::from(u16::from_le_bytes([b[k], b[k + 1]])) / 65535.0);
    let view = |b: &[u8]| b.as_chunks().0.iter().map(color).collect();
    Ok(ReferenceSamples {
        step: reference.step,
        scene: required(reference.scene, "reference.scene")?.try_into()?,
        colors: bytes.chunks_exact(per_view).map(view).collect(),
        batches: slice,
        plan,
    })
}
