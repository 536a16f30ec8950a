//! A step with all its bricks, and the volume they make.

use super::brick::BrickBytes;
use super::run::RunSpec;
use super::{GridBox, Remarks, brick};
use lamina_field_expression::ShownFields;
use lamina_model::{Invalid, Volume};
use std::time::{Duration, Instant};

/// A step with all its bricks, to be made into a VDI.
#[derive(Debug)]
pub struct CompleteStep {
    /// The run's id.
    pub run_id: String,
    /// The run's description.
    pub spec: RunSpec,
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// Steps of the run dropped so far.
    pub dropped_steps: u64,
    /// Ranks whose bricks it lacks, because they fell silent.
    pub lost_ranks: Vec<u32>,
    /// What ranks told beside their bricks.
    pub remarks: Remarks,
    /// When its last brick came in.
    pub completed: Instant,
    pub(super) bricks: Vec<(GridBox, BrickBytes)>,
}

impl CompleteStep {
    /// Its bricks.
    pub fn into_bricks(self) -> (RunSpec, Vec<(GridBox, BrickBytes)>) {
        (self.spec, self.bricks)
    }

    /// Where its bricks lie.
    pub fn boxes(&self) -> impl Iterator<Item = &GridBox> {
        self.bricks.iter().map(|(place, _)| place)
    }

    /// What is `shown` of the step; NaN where bricks of lost ranks would be, integers then in single precision. Also the time that
    /// computing took what is no field itself.
    ///
    /// # Errors
    /// If the bricks do not make up the grid.
    pub fn into_volume(self, shown: &ShownFields) -> Result<(Volume, Duration), Invalid> {
        let (grid, sources, mut before) = (&self.spec.grid, shown.sources(), 0);
        let mut fields = Vec::new();
        for (n, (_, voxel_type)) in self.spec.fields().enumerate() {
            let size = voxel_type.size_bytes();
            let of = |brick: &GridBox| brick.voxels() * before..brick.voxels() * (before + size);
            let bricks = self.bricks.iter().map(|(brick, bytes)| (*brick, &bytes[of(brick)]));
            // What nothing reads stays as it came.
            fields.push(sources.contains(&n).then(|| {
                let joined = brick::join(grid, voxel_type, bricks);
                match &self.spec.coordinates {
                    Some(of) => of.resample(joined),
                    None => joined,
                }
            }));
            before += size;
        }
        let begun = Instant::now();
        let volume = shown.volume(*grid, fields)?;
        Ok((volume, if shown.is_derived() { begun.elapsed() } else { Duration::ZERO }))
    }
}
