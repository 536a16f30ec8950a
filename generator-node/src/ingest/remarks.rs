//! What ranks tell with the bricks of a step.

use lamina_model::{Diagnostics, Invalid};
use std::collections::BTreeMap;
use std::time::Duration;

/// What a rank tells with a brick, or all ranks of a step.
#[derive(Debug, Clone, Default)]
pub struct Remarks {
    /// Numbers beside the field.
    pub diagnostics: Diagnostics,
    /// Of the simulation's first rank: the mean time of a step since its last push, and what that push took.
    pub pace: Option<[Duration; 2]>,
}

impl Remarks {
    /// As they come: times in nanoseconds, 0 where they are not known.
    ///
    /// # Errors
    /// If the names of diagnostics cannot be right, or they are too many.
    pub fn new(diagnostics: BTreeMap<String, f64>, [interval, push]: [u64; 2]) -> Result<Self, Invalid> {
        let pace = (interval > 0).then(|| [interval, push].map(Duration::from_nanos));
        Ok(Self { diagnostics: diagnostics.try_into()?, pace })
    }

    /// Takes in those of another brick; false if there are too many diagnostics, and some are left out.
    pub(crate) fn merge(&mut self, other: &Self) -> bool {
        self.pace = other.pace.or(self.pace);
        self.diagnostics.merge(&other.diagnostics)
    }
}
