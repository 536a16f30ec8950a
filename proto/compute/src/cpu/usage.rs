//! Statistics of a node's processor time: spent by activity, and work admitted or skipped by priority.

use super::queue::Priority;
use std::time::Duration;

/// Kinds of heavy work, as benchmarks and metrics tell them apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Generation of VDIs or reduced volumes from volumes; preparation of fields; reference samples.
    Generate,
    /// Encoding of VDIs and reduced volumes.
    Encode,
    /// Decoding.
    Decode,
    /// Measurement of quality against reference samples.
    Measure,
    /// Rendering of pictures for users.
    Draw,
}

impl Activity {
    /// All activities.
    pub const ALL: [Self; 5] = [Self::Generate, Self::Encode, Self::Decode, Self::Measure, Self::Draw];

    /// Its name in metrics and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Generate => "generate",
            Self::Encode => "encode",
            Self::Decode => "decode",
            Self::Measure => "measure",
            Self::Draw => "draw",
        }
    }
}

/// Use of a CPU share so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Usage {
    cpu: [Duration; Activity::ALL.len()],
    admitted: [u64; Priority::ALL.len()],
    skipped: [u64; Priority::ALL.len()],
}

impl Usage {
    /// Processor time spent on `activity`.
    pub fn cpu(&self, activity: Activity) -> Duration {
        self.cpu[activity as usize]
    }

    /// Number of pieces of work of this priority that were admitted.
    pub fn admitted(&self, priority: Priority) -> u64 {
        self.admitted[priority as usize]
    }

    /// Number of pieces of work of this priority that were skipped for lack of processor time.
    pub fn skipped(&self, priority: Priority) -> u64 {
        self.skipped[priority as usize]
    }

    pub(crate) fn spend(&mut self, activity: Activity, time: Duration) {
        self.cpu[activity as usize] += time;
    }

    pub(crate) fn admit(&mut self, priority: Priority) {
        self.admitted[priority as usize] += 1;
    }

    pub(crate) fn skip(&mut self, priority: Priority) {
        self.skipped[priority as usize] += 1;
    }
}
