//! Nouns and leaf mathematics shared by every node of Lamina.
//!
//! Nothing here does I/O, reads a clock, waits, or knows of the wire: a value of these types that exists is valid,
//! because its constructor checked it. Source of the method, "the paper" throughout: S. Frey and T. Ertl,
//! "Auto-Tuning Intermediate Representations for In Situ Visualization", NYSDS 2016.

mod appearance;
pub mod camera;
mod color_field;
pub mod composite;
mod coordinates;
mod corners;
mod cost;
mod diagnostics;
pub mod effects;
mod frame;
mod full_policy;
pub mod image;
pub mod indicators;
mod inpaint;
mod limits;
mod names;
pub mod params;
pub mod psnr;
mod range;
pub mod reduced;
mod run;
pub mod samples;
pub mod scene;
mod scene_change;
mod setting;
pub mod ssim;
mod steering;
mod step_report;
pub mod suggest;
pub mod transfer;
mod trigger;
mod tuning_state;
pub mod vdi;
pub mod volume;

pub use appearance::Appearance;
pub use camera::{Aabb, Camera, Ray};
pub use coordinates::Coordinates;
pub use cost::Cost;
pub use diagnostics::Diagnostics;
pub use effects::{ColorField, Effects};
pub use frame::Frame;
pub use full_policy::FullPolicy;
pub use image::Image;
pub use indicators::{Indicators, Quality, ViewError, decibels};
pub use inpaint::inpaint;
pub use limits::Limits;
pub use params::{GenerationParams, ParamsKey, Representation, Segmentation, VdiParams, VolumeParams};
pub use psnr::{SquaredError, psnr};
pub use range::{ScalarRange, Scale};
pub use reduced::{Intermediate, ReducedVolume};
pub use run::RunInfo;
pub use samples::{ReferenceSamples, SamplePlan};
pub use scene::Scene;
pub use scene_change::SceneChange;
pub use setting::{Objective, Setting};
pub use steering::{Steerable, SteerableNumber, Steering, SteeringRequest};
pub use step_report::StepReport;
pub use transfer::{ControlPoint, TransferFunction};
pub use trigger::{TriggerAction, TriggerChange, TriggerSpec};
pub use tuning_state::TuningState;
pub use vdi::{Supersegment, Vdi, VdiHeader};
pub use volume::{Grid, Volume, VoxelType, Voxels};

/// A value that cannot be what it claims to be: the thing, what is wrong with it, and what would be right.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{thing}: {reason}")]
pub struct Invalid {
    /// What is wrong, in the user's words: `camera.up`, `gamma`, `grid.dims`.
    pub thing: &'static str,
    /// What is wrong with it and what would be accepted.
    pub reason: String,
}

impl Invalid {
    /// An error about `thing`.
    pub fn new(thing: &'static str, reason: impl Into<String>) -> Self {
        Self { thing, reason: reason.into() }
    }
}
