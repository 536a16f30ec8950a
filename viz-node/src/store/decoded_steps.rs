//! The steps decoded last, prepared for drawing.

use lamina_codec::volume::ReferenceVolume;
use lamina_vdi_render::Drawable;
use std::collections::VecDeque;
use std::sync::Arc;

/// Steps kept.
const DECODED: usize = 4;

/// The steps decoded last.
#[derive(Debug, Default)]
pub(super) struct DecodedSteps(VecDeque<DecodedStep>);

/// One of them.
#[derive(Debug)]
pub(super) struct DecodedStep {
    pub run_id: String,
    pub step: u64,
    /// The CRC-32 that its bytes end with.
    pub checksum: u32,
    pub shown: Arc<Drawable>,
}

impl DecodedSteps {
    /// Step `step` of a run, if it is one of them.
    pub(super) fn get(&self, run_id: &str, step: u64) -> Option<&DecodedStep> {
        self.0.iter().find(|known| known.run_id == run_id && known.step == step)
    }

    /// Those of a run.
    pub(super) fn of_run(&self, run_id: &str) -> impl Iterator<Item = u64> {
        self.0.iter().filter(move |known| known.run_id == run_id).map(|known| known.step)
    }

    /// Adds one in place of the oldest.
    pub(super) fn keep(&mut self, step: DecodedStep) {
        self.0.push_back(step);
        if self.0.len() > DECODED {
            self.0.pop_front();
        }
    }
}

impl DecodedStep {
    /// What others are coded after, if it is a volume.
    pub(super) fn reference(&self) -> Option<ReferenceVolume> {
        self.shown.units().map(|(dims, units)| ReferenceVolume::of(self.checksum, dims, units))
    }
}
