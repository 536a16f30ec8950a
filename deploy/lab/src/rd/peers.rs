//! What users would ship instead, measured by the same eyes: a table of codings made elsewhere.

use super::RateDistortion;
use super::curve::{RateCurve, Sample};
use anyhow::{Context, ensure};
use lamina_model::{Volume, Voxels};
use lamina_raycast::Field;
use lamina_vdi_render::{Detail, Drawable};
use std::path::Path;

/// First line of such a table. A coding of pictures states its PSNR, one of volumes the time it took and the decoded volume, 32-bit
/// floats in a file beside the table; what is not stated is empty.
const HEADER: &str = "coding,how,bytes,psnr_db,encode_ms,volume";

/// The curves in `table`, its volumes shown by `bench` as its own are.
///
/// # Errors
/// If the table or a volume cannot be read or used.
pub(super) fn curves(table: &Path, bench: &RateDistortion) -> anyhow::Result<Vec<RateCurve>> {
    let name = table.display();
    let text = std::fs::read_to_string(table).with_context(|| format!("{name}: cannot be read"))?;
    let mut lines = text.lines();
    ensure!(lines.next() == Some(HEADER), "{name}: the first line must be {HEADER}");
    let mut curves: Vec<RateCurve> = Vec::new();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let &[coding, how, bytes, psnr_db, encode_ms, volume] = fields.as_slice() else {
            anyhow::bail!("{name}: \"{line}\" has not the fields {HEADER}");
        };
        let psnr_db = if volume.is_empty() {
            psnr_db.parse().with_context(|| format!("{name}: PSNR of \"{line}\""))?
        } else {
            let path = table.with_file_name(volume);
            let bytes = std::fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
            let voxels = Voxels::from_le_bytes(lamina_model::VoxelType::F32, &bytes);
            let volume = Volume::new(*bench.field.grid(), voxels).with_context(|| path.display().to_string())?;
            bench.psnr_db(&Drawable::Volume(Box::new(Field::new(volume, bench.field.scene()))), Detail::Cubic)?
        };
        let bytes = bytes.parse().with_context(|| format!("{name}: bytes of \"{line}\""))?;
        let encode_ms = match encode_ms {
            "" => f64::NAN,
            stated => stated.parse().with_context(|| format!("{name}: time of \"{line}\""))?,
        };
        let sample = Sample { bytes, psnr_db, how: how.to_owned(), times_ms: [f64::NAN, encode_ms, f64::NAN] };
        match curves.iter_mut().find(|c| c.coding == coding) {
            Some(curve) => curve.samples.push(sample),
            None => curves.push(RateCurve::new(coding, vec![sample])),
        }
    }
    Ok(curves.into_iter().map(|c| RateCurve::new(c.coding, c.samples)).collect())
}
