//! Steps decoded and prepared for drawing: those that were coded after others, after these.

use super::decoded_steps::DecodedStep;
use super::{StepRow, Store, StoreError};
use lamina_codec::volume::{ReferenceVolume, checksum};
use lamina_codec::{decode_any_after, sequence};
use lamina_model::Intermediate;
use lamina_vdi_render::Drawable;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

impl Store {
    /// `step` in one piece that decodes without any other: its bytes, or a [sequence](sequence()) of those since the last key frame.
    ///
    /// # Errors
    /// If it, or one that it was coded after, is not held.
    pub fn self_contained(&self, step: u64) -> Result<Arc<Vec<u8>>, StoreError> {
        let steps = chain(&self.state().rows, step, |_| false)?;
        in_one_piece(steps, |step| self.encoded(step))
    }

    /// What stands for `step`, decoded and prepared for drawing.
    ///
    /// # Errors
    /// If it, or one that it was coded after, is not held or damaged.
    pub fn prepared(&self, step: u64) -> Result<Arc<Drawable>, StoreError> {
        let run_id = self.run().map(|r| r.id).unwrap_or_default();
        if let Some(known) = self.state().decoded.get(&run_id, step) {
            return Ok(known.shown.clone());
        }
        let known: Vec<u64> = self.state().decoded.of_run(&run_id).collect();
        let chain = chain(&self.state().rows, step, |step| known.contains(&step))?;
        let before = self.row(chain[0]).and_then(|row| row.after_step);
        let mut reference =
            before.and_then(|before| self.state().decoded.get(&run_id, before).and_then(DecodedStep::reference));
        for number in chain {
            let bytes = self.encoded(number)?;
            let damaged = |reason| StoreError::Damaged { step: number, reason };
            let decoded = decode_any_after(&bytes, &self.limits, |_| reference.take()).map_err(damaged)?;
            if number == step {
                return self.keep(run_id, (step, checksum(&bytes)), Arc::new(Drawable::new(decoded)));
            }
            if let Intermediate::Volume(volume) = decoded {
                reference = Some(ReferenceVolume::new(&bytes, &volume));
            }
        }
        Err(StoreError::NoStep(step))
    }

    fn keep(
        &self,
        run_id: String,
        (step, checksum): (u64, u32),
        shown: Arc<Drawable>,
    ) -> Result<Arc<Drawable>, StoreError> {
        let mut state = self.state();
        if state.run.as_ref().is_none_or(|r| r.id != run_id) {
            // Another run began meanwhile; these bytes may be of either.
            return Err(StoreError::NoStep(step));
        }
        state.decoded.keep(DecodedStep { run_id, step, checksum, shown: shown.clone() });
        Ok(shown)
    }
}

/// `step` and those that it was coded after, the first one first: a key frame, or the first after one that `is_known`.
pub(super) fn chain(
    rows: &BTreeMap<u64, StepRow>,
    step: u64,
    is_known: impl Fn(u64) -> bool,
) -> Result<Vec<u64>, StoreError> {
    let mut chain = VecDeque::from([step]);
    let mut row = rows.get(&step).ok_or(StoreError::NoStep(step))?;
    // Backwards only, so that no circle is followed.
    while let Some(before) = row.after_step.filter(|before| *before < row.step && !is_known(*before)) {
        row = rows.get(&before).ok_or(StoreError::NoStep(before))?;
        chain.push_front(before);
    }
    Ok(chain.into())
}

/// The bytes of `steps`, of which each is coded after the one before it, in one piece.
pub(super) fn in_one_piece(
    steps: Vec<u64>,
    encoded: impl Fn(u64) -> Result<Arc<Vec<u8>>, StoreError>,
) -> Result<Arc<Vec<u8>>, StoreError> {
    let mut files = steps.into_iter().map(encoded).collect::<Result<Vec<_>, _>>()?;
    if files.len() == 1 {
        Ok(files.remove(0))
    } else {
        Ok(Arc::new(sequence(&files.iter().map(|f| &f[..]).collect::<Vec<_>>())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Run, StepRow};
    use glam::DVec3;
    use lamina_codec::{DecodeLimits, ErrorMeasure, decode_any, volume::encode_after};
    use lamina_model::{Frame, Grid, ReducedVolume, Volume, VolumeParams, Voxels, suggest::suggest};

    fn volume(at: f32) -> ReducedVolume {
        let grid = Grid::new([16; 3], DVec3::ONE, DVec3::ZERO).unwrap();
        let unit = |n: usize| {
            let [x, y, z] = [n % 16, n / 16 % 16, n / 256].map(|i| i as f32 - 8.0);
            0.9 * (-0.08 * ((x - at).powi(2) + y * y + z * z)).exp()
        };
        let units: Vec<f32> = (0..grid.voxels()).map(unit).collect();
        let mut scene = suggest(&[&Volume::new(grid, Voxels::F32(units.clone())).unwrap()]).unwrap();
        scene.transfer = scene.transfer.with_unit_length(1.0);
        ReducedVolume::new(grid, scene, VolumeParams::new(16, 0.01).unwrap(), units).unwrap()
    }

    #[test]
    fn steps_coded_after_others_are_decoded_in_any_order_and_given_away_whole() {
        let limits = DecodeLimits::default();
        let mut reference: Option<ReferenceVolume> = None;
        let coded: Vec<Vec<u8>> = (0..7)
            .map(|step| {
                // A key frame at 0 and at 4.
                let before = reference.take().filter(|_| step % 4 > 0);
                let (bytes, next) = encode_after(&volume(0.3 * step as f32), ErrorMeasure::Maximum, before.as_ref());
                reference = Some(next);
                bytes
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        for root in [None, Some(folder.path())] {
            let store = Store::open(root, 1 << 20, limits).unwrap();
            store.begin(Run { id: "r-1".into(), name: "r".into(), field: "f".into(), dims: [16; 3] }).unwrap();
            for (step, bytes) in coded.iter().enumerate().filter(|(step, _)| *step != 5) {
                let after_step = (step % 4 > 0).then(|| step as u64 - 1);
                let frame = Frame { step: step as u64, after_step, ..Frame::default() };
                store.record(StepRow::live(&frame, false), bytes.clone()).unwrap();
            }
            let units = |step| store.prepared(step).unwrap().units().unwrap().1.to_vec();
            // Back and forth: from nothing known, from a known one before, and a known one itself.
            let seen = [3, 2, 1, 3, 0, 4].map(units);
            assert!(seen[0] == seen[3] && seen[0] != seen[1]);
            for (step, units) in [3, 2, 1, 3, 0, 4].into_iter().zip(&seen) {
                let whole = store.self_contained(step).unwrap();
                let Intermediate::Volume(decoded) = decode_any(&whole, &limits).unwrap() else { unreachable!() };
                assert!(decoded.units() == units, "step {step}");
            }
            assert_eq!(*store.self_contained(4).unwrap(), coded[4]);
            for lost in [store.prepared(6).map(drop), store.self_contained(6).map(drop)] {
                assert!(matches!(lost, Err(StoreError::NoStep(5))), "step 5 was not recorded");
            }
        }
    }
}
