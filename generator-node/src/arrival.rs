//! Whole steps as they arrive: from the ranks of a simulation, or from the members of a group.

use crate::group::{Door, GroupArrived, Root};
use crate::ingest::{CompleteStep, Ingest, RunSpec};
use std::sync::Arc;
use std::time::SystemTime;

/// Where whole steps come from.
pub(crate) enum Steps {
    /// From the ranks that bring their bricks to this node.
    Own(Arc<Ingest>),
    /// From the members of a group.
    Group(Arc<Root>, Arc<Door>),
}

/// A whole step.
pub(crate) enum Arrived {
    Own(CompleteStep),
    Group(Arc<Root>, GroupArrived),
}

impl Steps {
    /// Waits until there is one.
    pub(crate) async fn wait(&self) {
        match self {
            Self::Own(ingest) => ingest.complete().await,
            Self::Group(_, door) => door.whole().await,
        }
    }

    /// The one to be worked on now.
    pub(crate) fn take(&self) -> Option<Arrived> {
        match self {
            Self::Own(ingest) => ingest.take().map(Arrived::Own),
            Self::Group(root, door) => Some(Arrived::Group(root.clone(), door.take()?)),
        }
    }
}

impl Arrived {
    /// Run id, step, time, steps dropped so far.
    pub(crate) fn numbers(&self) -> (&str, u64, f64, u64) {
        match self {
            Self::Own(step) => (&step.run_id, step.step, step.time, step.dropped_steps),
            Self::Group(_, step) => (&step.run_id, step.step, step.time, step.dropped_steps),
        }
    }

    /// When it was whole; now, if that is not known.
    pub(crate) fn completed(&self) -> SystemTime {
        match self {
            Self::Own(step) => SystemTime::now() - step.completed.elapsed(),
            Self::Group(..) => SystemTime::now(),
        }
    }

    pub(crate) fn spec(&self) -> &RunSpec {
        match self {
            Self::Own(step) => &step.spec,
            Self::Group(_, step) => &step.spec,
        }
    }
}
