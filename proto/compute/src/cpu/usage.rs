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

/// A number for each activity or priority, for metrics.
#[derive(Debug, Clone, PartialEq)]
pub struct UsageCounter {
    /// Its name.
    pub name: &'static str,
    /// What it is.
    pub help: &'static str,
    /// What the numbers are told apart by.
    pub label: &'static str,
    /// Values of the label, and their numbers.
    pub values: Vec<(&'static str, f64)>,
}

impl Usage {
    /// All of it, for metrics.
    pub fn counters(&self) -> [UsageCounter; 3] {
        let of =
            |priorities: &[u64]| Priority::ALL.iter().zip(priorities).map(|(p, n)| (p.name(), *n as f64)).collect();
        let (name, help) = ("cpu_seconds_total", "Processor time of heavy work.");
        let values = Activity::ALL.map(|activity| (activity.name(), self.cpu(activity).as_secs_f64()));
        let spent = UsageCounter { name, help, label: "activity", values: values.to_vec() };
        let (name, help) = ("work_admitted_total", "Pieces of heavy work that were admitted.");
        let admitted = UsageCounter { name, help, label: "priority", values: of(&self.admitted) };
        let (name, help) = ("work_skipped_total", "Pieces of heavy work left out for want of processor time.");
        [spent, admitted, UsageCounter { name, help, label: "priority", values: of(&self.skipped) }]
    }

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
