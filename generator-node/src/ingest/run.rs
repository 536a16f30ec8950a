//! A run: what the simulation says of it, which ranks are there, and which steps wait for bricks.

use super::brick::{BrickBytes, BrickOffer, GridBox, missing};
use super::{IngestError, assembly::Assembly};
use lamina_field_expression::ShownFields;
use lamina_model::{ColorField, Coordinates, FullPolicy, Grid, Invalid, Scene, VoxelType};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// What a simulation says when it opens a run; the same from every rank.
#[derive(Debug, Clone, PartialEq)]
pub struct RunSpec {
    /// The run's name, chosen by the user.
    pub name: String,
    /// What the scalar is.
    pub field: String,
    /// The whole grid, with even spacing.
    pub grid: Grid,
    /// Where its sample points are, if that is not even.
    pub coordinates: Option<Coordinates>,
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Name and type of a second field, for colors.
    pub color_field: Option<(String, VoxelType)>,
    /// Names and types of further fields.
    pub more_fields: Vec<(String, VoxelType)>,
    /// What is shown, an expression over the fields; `None`: the first.
    pub shown: Option<String>,
    /// Number of ranks, each with its own brick.
    pub ranks: u32,
    /// What happens when the node is full.
    pub full_policy: FullPolicy,
    /// How to show it, if the simulation or the node's configuration says.
    pub scene: Option<Scene>,
    /// Nodes that share its steps.
    pub members: u32,
}

impl RunSpec {
    /// A run of one rank, of one field in single precision on `grid`.
    #[cfg(test)]
    pub(crate) fn of_one_rank(field: &str, grid: Grid) -> Self {
        Self {
            name: "run".into(),
            field: field.into(),
            grid,
            coordinates: None,
            voxel_type: VoxelType::F32,
            color_field: None,
            more_fields: Vec::new(),
            shown: None,
            ranks: 1,
            full_policy: FullPolicy::Block,
            scene: None,
            members: 1,
        }
    }

    /// All fields, in the order of a brick's bytes.
    pub fn fields(&self) -> impl Iterator<Item = (&str, VoxelType)> {
        let others = self.color_field.iter().chain(&self.more_fields).map(|(name, t)| (name.as_str(), *t));
        std::iter::once((self.field.as_str(), self.voxel_type)).chain(others)
    }

    /// What is shown where nobody asks for another field.
    pub fn shown(&self) -> &str {
        self.shown.as_deref().unwrap_or(&self.field)
    }

    /// What the expression `shown` reads. Colors are those of `scene`; where that is still to be chosen the second field, unless
    /// somebody has chosen what is shown: its colors are those of its values.
    ///
    /// # Errors
    /// If the run has no such fields.
    pub fn shown_fields(&self, shown: &str, scene: Option<&Scene>) -> Result<ShownFields, Invalid> {
        let names: Vec<&str> = self.fields().map(|(name, _)| name).collect();
        let second = self.color_field.as_ref().filter(|_| shown == self.shown()).map(|(name, _)| name.as_str());
        scene.map_or_else(|| ShownFields::new(shown, second, &names), |scene| ShownFields::under(shown, scene, &names))
    }

    /// Bytes of one sample point, of all fields.
    pub fn point_bytes(&self) -> usize {
        self.fields().map(|(_, voxel_type)| voxel_type.size_bytes()).sum()
    }

    /// Bytes of a step.
    pub fn step_bytes(&self) -> u64 {
        self.voxels_here() * self.point_bytes() as u64
    }

    /// Voxels of a step; of a group's node its even share of them.
    fn voxels_here(&self) -> u64 {
        (self.grid.voxels() as u64).div_ceil(u64::from(self.members))
    }

    /// Bytes besides waiting steps: one step's bricks and joined volume, three fields (in work, newest, in trials), each with its
    /// colors, and what computing the one `shown` takes.
    pub fn working_bytes(&self, shown: &ShownFields) -> u64 {
        let fields = 3 * (1 + u64::from(shown.has_colors()));
        // A field before and after it is resampled.
        let resampled = if self.coordinates.is_some() { 2 * size_of::<f64>() as u64 } else { 0 };
        // A group's node resamples its part from up to two points for each of its own along each axis, wherever those are.
        let elsewhere = if self.coordinates.is_some() && self.members > 1 {
            self.voxels_here().saturating_mul(8).min(self.grid.voxels() as u64) * self.point_bytes() as u64
        } else {
            0
        };
        elsewhere + 2 * self.step_bytes() + (fields * 4 + shown.point_bytes() as u64 + resampled) * self.voxels_here()
    }

    /// Passes what memory of `memory_bytes` has room for: a step that waits and one that is shown as `shown`.
    pub fn check_memory(&self, shown: &ShownFields, memory_bytes: u64) -> Result<(), IngestError> {
        let needed_bytes = self.step_bytes().saturating_add(self.working_bytes(shown));
        if needed_bytes <= memory_bytes {
            return Ok(());
        }
        let types: Vec<String> = self.fields().map(|(_, voxel_type)| voxel_type.to_string()).collect();
        Err(IngestError::Exhausted { dims: self.grid.dims(), voxels: types.join(" and "), needed_bytes, memory_bytes })
    }

    /// Passes what `rank` says of the run, on a node with so much memory; gives what is shown.
    pub fn check(&self, rank: u32, memory_bytes: u64) -> Result<ShownFields, IngestError> {
        if self.name.is_empty() || self.name.len() > 200 || self.field.len() > 200 {
            return Err(IngestError::Refused("run name and field name must have 1 to 200 bytes".to_owned()));
        }
        if self.ranks == 0 || self.ranks > 1 << 20 || rank >= self.ranks {
            let ranks = self.ranks;
            return Err(IngestError::Refused(format!(
                "rank {rank} of {ranks}: ranks must be 1 to 1048576, counted from 0"
            )));
        }
        if self.more_fields.len() > MOST_FIELDS {
            let fields = self.more_fields.len();
            return Err(IngestError::Refused(format!("{fields} further fields; at most {MOST_FIELDS} are taken")));
        }
        let mut names = BTreeSet::new();
        for (name, _) in self.fields().skip(1) {
            let named = ColorField::check_name(name);
            named?;
            if !names.insert(name) || name == self.field {
                return Err(IngestError::Refused(format!("two fields are named \"{name}\"")));
            }
        }
        let shown = self.shown_fields(self.shown(), self.scene.as_ref())?;
        self.check_memory(&shown, memory_bytes)?;
        Ok(shown)
    }
}

/// Further fields of a run.
const MOST_FIELDS: usize = 64;

/// A run that is open, or was.
#[derive(Debug)]
pub(super) struct IngestRun {
    /// Its id.
    pub id: String,
    /// What the simulation says of it.
    pub spec: RunSpec,
    /// Bytes besides waiting steps.
    pub working_bytes: u64,
    /// Ranks that have come.
    pub attached: BTreeSet<u32>,
    /// Those of them that are done.
    pub closed: BTreeSet<u32>,
    /// The newest step of each rank.
    pub last_step: Vec<Option<u64>>,
    /// Steps that lack bricks.
    pub steps: BTreeMap<u64, Assembly>,
    dropped: BTreeSet<u64>,
    /// How many steps were dropped.
    pub dropped_steps: u64,
    /// When a rank last called.
    pub last_heard: Instant,
    /// How many of a group's ranks come here.
    pub told_ranks: Option<u32>,
    /// Where the bricks of a group's ranks that come here lay in the newest whole step.
    pub boxes: BTreeMap<u32, Vec<GridBox>>,
    /// The newest step that was whole.
    pub newest_whole: Option<u64>,
    /// When each rank last called, and the newest step that it offered.
    calls: BTreeMap<u32, (Instant, Option<u64>)>,
    /// Ranks that fell silent while the others went on.
    pub lost: BTreeSet<u32>,
    /// What a group's root has to say to ranks at their next brick.
    pub refusals: BTreeMap<u32, String>,
}

/// A rank that is silent for longer, while all others are past a step that lacks its bricks, is lost.
pub(crate) const LOST_AFTER: Duration = Duration::from_secs(3);

/// Bricks of one rank and step.
const MOST_BRICKS: u32 = 1 << 16;

/// Dropped steps remembered so that their other ranks' bricks are dropped too.
const REMEMBERED_DROPS: usize = 1024;

impl IngestRun {
    /// Opened by `rank`.
    pub(super) fn new(id: String, spec: RunSpec, working_bytes: u64, rank: u32, now: Instant) -> Self {
        let last_step = vec![None; spec.ranks as usize];
        Self {
            id,
            spec,
            working_bytes,
            attached: BTreeSet::from([rank]),
            closed: BTreeSet::new(),
            last_step,
            steps: BTreeMap::new(),
            dropped: BTreeSet::new(),
            dropped_steps: 0,
            last_heard: now,
            told_ranks: None,
            boxes: BTreeMap::new(),
            newest_whole: None,
            calls: BTreeMap::from([(rank, (now, None))]),
            lost: BTreeSet::new(),
            refusals: BTreeMap::new(),
        }
    }

    /// `rank` opens the run, or offers or brings a brick of `step`; one that was lost is back.
    pub(super) fn called(&mut self, rank: u32, step: Option<u64>, now: Instant) {
        let (last, newest) = self.calls.entry(rank).or_insert((now, None));
        (*last, *newest) = (now, step.max(*newest));
        self.lost.remove(&rank);
    }

    /// Finds ranks that are lost; true if there are any. Those that have not come yet are waited for: ranks may start far apart.
    pub(super) fn find_lost(&mut self, now: Instant) -> bool {
        if self.spec.members > 1 || self.calls.len() < self.spec.ranks as usize {
            return false;
        }
        let Some((&oldest, waiting)) = self.steps.first_key_value() else { return false };
        let is_silent = |rank: &u32| self.is_silent(*rank, now);
        let is_in = waiting.ranks_in();
        let lacking: BTreeSet<u32> = (0..self.spec.ranks).filter(|rank| !is_in.contains(rank)).collect();
        let others_are_past = self
            .calls
            .iter()
            .filter(|(rank, _)| !lacking.contains(rank))
            .all(|(_, (_, newest))| *newest > Some(oldest));
        if others_are_past && lacking.len() < self.spec.ranks as usize && lacking.iter().all(is_silent) {
            self.lost.extend(lacking);
        }
        !self.lost.is_empty()
    }

    fn is_silent(&self, rank: u32, now: Instant) -> bool {
        self.calls.get(&rank).is_some_and(|(last, _)| now.saturating_duration_since(*last) >= LOST_AFTER)
    }

    /// The same of a group's node, where all other nodes are past `step`: those of its own ranks that the step lacks are lost, if all
    /// of them are silent.
    pub(super) fn find_lost_of_group(&mut self, step: u64, now: Instant) -> bool {
        let is_in = self.steps.get(&step).map(Assembly::ranks_in).unwrap_or_default();
        let lacking: Vec<u32> = self.boxes.keys().copied().filter(|rank| !is_in.contains(rank)).collect();
        // Ranks may start far apart: only those that were here can be lost.
        let is_known = self.told_ranks == u32::try_from(self.boxes.len()).ok();
        let can_be_lost = self.spec.members > 1 && is_known && self.newest_whole < Some(step);
        if !can_be_lost || lacking.is_empty() || !lacking.iter().all(|rank| self.is_silent(*rank, now)) {
            return false;
        }
        self.lost.extend(lacking);
        true
    }

    /// What stands for the bricks of `lost` ranks in a group's step, which all members have to have a part of.
    pub(super) fn holes(&self, lost: &[u32], bricks: &[(GridBox, BrickBytes)]) -> Vec<(GridBox, BrickBytes)> {
        let boxes = lost.iter().filter_map(|rank| self.boxes.get(rank)).flatten();
        let is_free = |place: &&GridBox| !bricks.iter().any(|(brick, _)| brick.overlaps(place));
        let hole = |place: &GridBox| {
            let of_fields = self.spec.fields().map(|(_, voxel_type)| missing(voxel_type).repeat(place.voxels()));
            (*place, of_fields.flatten().collect::<Vec<u8>>().into())
        };
        boxes.filter(is_free).map(hole).collect()
    }

    /// Ranks whose bricks come here; as good as none of a group's node that has not been told.
    pub(super) fn ranks_here(&self) -> u32 {
        if self.spec.members == 1 { self.spec.ranks } else { self.told_ranks.unwrap_or(u32::MAX) }
    }

    /// True once all its ranks have been here and closed. One that was not yet is waited for: ranks may start far apart.
    pub(super) fn ended(&self) -> bool {
        // A group's root without a rank of its own does not hear of the end; silence tells.
        self.ranks_here() > 0 && self.closed.len() == self.ranks_here() as usize
    }

    /// True once all ranks that have been here closed.
    pub(super) fn is_left(&self) -> bool {
        self.closed.len() == self.attached.len()
    }

    /// True if `rank`, which describes its run as `spec` and had it as `resume` before the node was restarted (or as nothing), is
    /// one of this run's; false if its run may take this one's place, of which nothing was heard for `silent`.
    ///
    /// # Errors
    /// If neither: this run lives, and `rank` is of another or describes it differently.
    pub(super) fn is_of(
        &self,
        spec: &RunSpec,
        rank: u32,
        resume: &str,
        silent: Duration,
        idle: Duration,
    ) -> Result<bool, IngestError> {
        let (name, differs) = (&self.spec.name, self.spec != *spec);
        let idles = silent >= idle;
        // Late ranks of a run that others have left, or that was killed, are waited for, but not against another run.
        let replaceable = self.ended() || idles && self.is_left() || (idles || self.is_left()) && differs;
        let joins = *name == spec.name && !self.attached.contains(&rank) && !replaceable;
        // Also those whose id is from before another rank opened the run anew: ranks meet in one run.
        if joins || !resume.is_empty() && self.id == resume {
            if differs {
                return Err(IngestError::Conflict(format!(
                    "run \"{name}\": rank {rank} describes it differently (grid, type, fields, ranks, policy or scene) than the ranks before; correct it, or wait until that run is silent for {:.0} s",
                    idle.as_secs_f64()
                )));
            }
            return Ok(true);
        }
        if replaceable || idles {
            return Ok(false);
        }
        if *name != spec.name {
            return Err(IngestError::Conflict(format!(
                "this generator-node serves run \"{name}\", last heard {:.0} s ago; close that run, wait until it is silent for {:.0} s, or use another node",
                silent.as_secs_f64(),
                idle.as_secs_f64()
            )));
        }
        if !resume.is_empty() {
            return Err(IngestError::Conflict(format!(
                "run \"{name}\": rank {rank} comes with id \"{resume}\", but a newer start of the simulation serves this rank as \"{}\"; stop one of the two",
                self.id
            )));
        }
        Ok(false)
    }

    /// Counts `step` as dropped, once however many ranks still bring their bricks of it.
    pub(super) fn drop_step(&mut self, step: u64) {
        let full = self.dropped.len() == REMEMBERED_DROPS;
        let forgotten = full && self.dropped.first().is_some_and(|&oldest| step < oldest);
        if forgotten || !self.dropped.insert(step) {
            return;
        }
        self.dropped_steps += 1;
        if full {
            self.dropped.pop_first();
        }
    }

    /// True if `step` was dropped, or if nothing of it is here though some rank is past it: steps ascend.
    pub(super) fn cannot_complete(&self, step: u64) -> bool {
        let passed = || self.newest_whole >= Some(step) || self.last_step.iter().any(|last| *last >= Some(step));
        self.dropped.contains(&step) || !self.steps.contains_key(&step) && passed()
    }

    /// An incomplete step that lacks the brick of `rank`, which is at `step` now: its memory is better used.
    pub(super) fn passed_by(&self, rank: u32, step: u64) -> Option<u64> {
        self.steps.range(..step).find(|(_, assembly)| !assembly.has(rank)).map(|(passed, _)| *passed)
    }

    /// The brick of a push that can be right; `None` where the rank has none of the step.
    pub(super) fn check_push(&self, offer: &BrickOffer) -> Result<Option<GridBox>, IngestError> {
        let BrickOffer { step, time, rank, index, bricks, start, dims } = *offer;
        if rank >= self.spec.ranks {
            return Err(IngestError::Refused(format!(
                "rank {rank}: the run has {} ranks, counted from 0",
                self.spec.ranks
            )));
        }
        if !time.is_finite() {
            return Err(IngestError::Refused(format!("step {step}: time {time} must be finite")));
        }
        if let Some(last) = self.last_step[rank as usize]
            && (step < last || step == last && index == 0)
        {
            return Err(IngestError::Refused(format!("rank {rank}: step {step} after step {last}; steps must ascend")));
        }
        if bricks > MOST_BRICKS || index >= bricks.max(1) {
            return Err(IngestError::Refused(format!(
                "rank {rank}: brick {index} of {bricks}; they count from 0, and a rank has at most {MOST_BRICKS} a step"
            )));
        }
        if bricks == 0 {
            return Ok(None);
        }
        Ok(Some(GridBox::new(start, dims, &self.spec.grid)?))
    }
}
