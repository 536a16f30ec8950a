//! Missing voxels: a value that a file uses where it has none becomes NaN.

use lamina_model::{Invalid, Volume, Voxels};

/// `volume` with NaN where it holds `value`. Integers become single precision.
pub(crate) fn mark_missing(volume: Volume, value: f64) -> Result<Volume, Invalid> {
    let (grid, voxels, second) = volume.into_parts();
    let single = |x: f32| if x == value as f32 { f32::NAN } else { x };
    let voxels = match voxels {
        Voxels::F64(v) => Voxels::F64(v.into_iter().map(|x| if x == value { f64::NAN } else { x }).collect()),
        // Every other type fits into single precision.
        other => Voxels::F32((0..other.len()).map(|n| single(other.get(n) as f32)).collect()),
    };
    let volume = Volume::new(grid, voxels)?;
    match second {
        Some((name, second)) => volume.with_color_field(&name, second),
        None => Ok(volume),
    }
}
