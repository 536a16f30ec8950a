//! Time steps in: runs, admission, bricks put together.

mod assembly;
mod brick;
mod complete_step;
mod core;
mod error;
mod lost_ranks;
mod membership;
mod remarks;
mod run;
mod service;
#[cfg(test)]
mod tests;

pub use brick::{BrickBytes, BrickOffer, GridBox};
pub use complete_step::CompleteStep;
pub use core::{Admit, Core, IngestFigures};
pub use error::IngestError;
pub use remarks::Remarks;
pub(crate) use run::LOST_AFTER;
pub use run::RunSpec;
pub use service::{AssignMember, Ingest, IngestService, SharedMemory};
