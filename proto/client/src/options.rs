//! A run as the simulation describes it, and what became of a brick.

use lamina_model::{Coordinates, FullPolicy, Grid, Scene, SteerableNumber, VoxelType};
use std::path::PathBuf;
use std::time::Duration;

/// A run as the simulation describes it.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// The generator-node, such as `http://127.0.0.1:7101`.
    pub generator: String,
    /// Name of the run.
    pub name: String,
    /// What the scalar is, such as `density`.
    pub field: String,
    /// The whole grid of all ranks.
    pub grid: Grid,
    /// Where its sample points are, if they are not evenly spaced: cells' centers of a rectilinear grid, for one. The node shows steps on
    /// [`Coordinates::grid`], which `grid` then has to be, linear between the points. Default: none.
    pub coordinates: Option<Coordinates>,
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Name and type of a second field, from which a scene may take its colors; every brick then carries both. Default: none.
    pub color_field: Option<(String, VoxelType)>,
    /// Names and types of further fields, which every brick carries behind those: people who watch may choose one, or an expression
    /// over several. `v.x`, `v.y` and `v.z` are together the vector `v`. Default: none.
    pub more_fields: Vec<(String, VoxelType)>,
    /// What is shown first: a field or an expression, such as `magnitude(v)`. Default: `field`.
    pub shown: Option<String>,
    /// This process among `ranks`, counted from 0.
    pub rank: u32,
    /// Processes that push bricks of every step.
    pub ranks: u32,
    /// What the node does with a step that finds its memory full. Default: the oldest waiting step makes room, so that the
    /// simulation never waits.
    pub full_policy: FullPolicy,
    /// How to show the run; if absent the node decides.
    pub scene: Option<Scene>,
    /// Folder of keys that `lamina keys` made, for a generator-node at `https://`. Default: where the environment variable
    /// LAMINA_CREDENTIALS says.
    pub credentials: Option<PathBuf>,
    /// Numbers that people who watch may change; they may also ask to pause, to go on and to stop:
    /// [`steering`](crate::Client::steering). Of one rank, which tells the others. Default: nobody can ask for anything.
    pub steering: Option<Vec<SteerableNumber>>,
    /// The longest any call may take. Default 5 s.
    pub deadline: Duration,
}

impl RunOptions {
    /// All fields, in the order of a brick's.
    pub(crate) fn fields(&self) -> impl Iterator<Item = (&str, VoxelType)> {
        let others = self.color_field.iter().chain(&self.more_fields).map(|(name, t)| (name.as_str(), *t));
        std::iter::once((self.field.as_str(), self.voxel_type)).chain(others)
    }

    /// A run of one rank that never waits for the viewer.
    pub fn new(generator: &str, name: &str, field: &str, grid: Grid, voxel_type: VoxelType) -> Self {
        Self {
            generator: generator.to_owned(),
            name: name.to_owned(),
            field: field.to_owned(),
            grid,
            coordinates: None,
            voxel_type,
            color_field: None,
            more_fields: Vec::new(),
            shown: None,
            rank: 0,
            ranks: 1,
            full_policy: FullPolicy::DropOldest,
            scene: None,
            credentials: None,
            steering: None,
            deadline: Duration::from_secs(5),
        }
    }
}

/// What became of a pushed brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Receipt {
    /// It is in; `true` if it completed its step.
    Admitted(bool),
    /// The node is full and dropped the step, as the run's policy says; or the step was not sent, to keep a limit on overhead.
    Dropped,
}
