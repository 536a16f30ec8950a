//! A member at work: carries out the root's commands on the bricks of its own ranks.

use super::convert::{Preparation, Windows, read_cast};
use super::window::{OwnPoints, SourcePoints};
use super::{Kind, send, sums, window};
use crate::ingest::{BrickBytes, GridBox, RunSpec};
use glam::DVec3;
use lamina_model::{GenerationParams, Grid, Invalid, Scene, VoxelType, Voxels};
use lamina_mpi::Outbox;
use lamina_raycast::{Backend, Field, PartSums};
use lamina_rpc::v1;
use parking_lot::Mutex;
use prost::Message as _;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// The longest that a member waits for what another one owes it.
const PATIENCE: Duration = Duration::from_secs(60);

/// A member's bricks of a step.
#[derive(Debug)]
pub(crate) struct HeldStep {
    /// What the simulation says of the run.
    pub spec: RunSpec,
    /// The bricks of all its ranks.
    pub bricks: Vec<(GridBox, BrickBytes)>,
}

/// Whole steps that wait for the root's commands.
pub(crate) type HeldSteps = Arc<Mutex<BTreeMap<StepKey, HeldStep>>>;

/// A run's id and the number of a step of it: those begin anew with each run.
pub(crate) type StepKey = (String, u64);

/// Of a command.
pub(super) fn key(step: Option<v1::GroupStep>) -> StepKey {
    let v1::GroupStep { run_id, step } = step.unwrap_or_default();
    (run_id, step)
}

/// The fields of a step, one for each of its parts.
pub(super) struct PartFields {
    pub grid: Grid,
    pub scene: Scene,
    pub parts: Vec<Field>,
}

/// The executor.
pub(crate) struct Member {
    pub(super) outbox: Outbox,
    inbox: Receiver<(u32, v1::GroupMessage)>,
    /// What came before it was asked for.
    early: VecDeque<(u32, v1::GroupMessage)>,
    held: HeldSteps,
    pub(super) fields: BTreeMap<StepKey, PartFields>,
    pub(super) backend: Backend,
}

pub(super) fn missing((run_id, step): &StepKey) -> Invalid {
    Invalid::new("group", format!("this member has nothing of step {step} of run \"{run_id}\""))
}

impl Member {
    pub(crate) fn new(
        outbox: Outbox,
        inbox: Receiver<(u32, v1::GroupMessage)>,
        held: HeldSteps,
        backend: Backend,
    ) -> Self {
        let (early, fields) = (VecDeque::new(), BTreeMap::new());
        Self { outbox, inbox, early, held, fields, backend }
    }

    /// Works until nobody sends any more.
    pub(crate) fn run(mut self) {
        loop {
            let next = self.early.iter().position(|(_, m)| !is_between_members(m));
            let (from, message) = match next.and_then(|n| self.early.remove(n)) {
                Some(early) => early,
                None => match self.inbox.recv() {
                    Ok(arrived) if is_between_members(&arrived.1) => {
                        self.early.push_back(arrived);
                        continue;
                    }
                    Ok(arrived) => arrived,
                    Err(_) => return,
                },
            };
            self.obey(from, message);
        }
    }

    fn obey(&mut self, from: u32, message: v1::GroupMessage) {
        let (sequence, begun) = (message.sequence, Instant::now());
        // What other members sent for commands before this one, which then failed.
        self.early.retain(|(_, m)| m.sequence >= sequence || !is_between_members(m));
        let mut encode = Duration::ZERO;
        let outcome = match message.kind {
            Some(Kind::Prepare(command)) => self.prepare(sequence, command).map_err(|e| self.give_up(sequence, e)),
            Some(Kind::Generate(command)) => {
                self.generate(sequence, command, &mut encode).map_err(|e| self.give_up(sequence, e))
            }
            Some(Kind::Reduce(command)) => self.reduce(command),
            Some(Kind::Cast(command)) => self.cast(command),
            Some(Kind::Sample(command)) => self.sample(&command),
            Some(Kind::Release(v1::GroupRelease { step })) => {
                let released = key(step);
                self.fields.remove(&released);
                self.held.lock().retain(|held, _| held.0 != released.0 || held.1 > released.1);
                return;
            }
            _ => return,
        };
        let elapsed_ns = begun.elapsed().as_nanos() as u64;
        let (payload, failed) = match outcome {
            Ok(payload) => (payload, String::new()),
            Err(error) => (Vec::new(), error.to_string()),
        };
        let reply = v1::GroupReply { payload, elapsed_ns, failed, encode_ns: encode.as_nanos() as u64 };
        send(&self.outbox, from, sequence, Kind::Reply(reply));
    }

    /// All members but this one.
    pub(super) fn others(&self) -> Vec<u32> {
        (0..self.outbox.size()).filter(|&other| other != self.outbox.rank()).collect()
    }

    /// Tells the other members, which may wait for what comes of command `sequence`, why nothing does.
    fn give_up(&self, sequence: u64, error: Invalid) -> Invalid {
        for other in self.others() {
            send(&self.outbox, other, sequence, Kind::Failed(error.to_string()));
        }
        error
    }

    /// What `take` takes of the messages of command `sequence` from all `members`.
    pub(super) fn gather(
        &mut self,
        sequence: u64,
        mut members: Vec<u32>,
        take: fn(&Kind) -> Option<&[u8]>,
    ) -> Result<Vec<(u32, Vec<u8>)>, Invalid> {
        let (mut gathered, until) = (Vec::new(), Instant::now() + PATIENCE);
        let mut early = std::mem::take(&mut self.early);
        while !members.is_empty() {
            let arrived = match early.pop_front() {
                Some(arrived) => arrived,
                None => {
                    let left = until.saturating_duration_since(Instant::now());
                    self.inbox.recv_timeout(left).map_err(|_| {
                        Invalid::new("group", format!("members {members:?} sent nothing within {PATIENCE:?}"))
                    })?
                }
            };
            let (from, message) = &arrived;
            let kind = message.kind.as_ref().filter(|_| message.sequence == sequence);
            if let Some(Kind::Failed(why)) = kind {
                self.early.extend(early);
                return Err(Invalid::new("group", format!("member {from}: {why}")));
            }
            match (kind.and_then(take), members.iter().position(|m| m == from)) {
                (Some(bytes), Some(n)) => {
                    gathered.push((*from, bytes.to_vec()));
                    members.swap_remove(n);
                }
                _ => self.early.push_back(arrived),
            }
        }
        self.early.extend(early);
        gathered.sort_by_key(|(from, _)| *from);
        Ok(gathered)
    }

    /// Exchanges ghost points, and makes a field of each box.
    fn prepare(&mut self, sequence: u64, command: v1::GroupPrepare) -> Result<Vec<u8>, Invalid> {
        let (step, preparation) = (key(command.step.clone()), Preparation::read(command)?);
        let (me, members) = (self.outbox.rank() as usize, preparation.members.len());
        let held = self.held.lock().remove(&step);
        let bricks = match held {
            Some(held) => held.bricks,
            None if preparation.members[me].is_empty() => Vec::new(),
            None => return Err(missing(&step)),
        };
        if bricks.iter().map(|(b, _)| *b).ne(preparation.members[me].iter().copied()) {
            return Err(Invalid::new(
                "group",
                format!("step {}: these are not the bricks that were announced", step.1),
            ));
        }
        let mut of_members = (0..members).map(|m| preparation.windows(m)).collect::<Result<Vec<_>, _>>()?;
        let sources_of = |windows: &Windows| windows.points.iter().map(|w| preparation.sources(w)).collect();
        let windows = of_members.iter().map(sources_of).collect::<Result<Vec<Vec<SourcePoints>>, Invalid>>()?;
        let (shown, types) = (preparation.shown_fields()?, preparation.fields.iter().map(|(_, t)| *t));
        let types: Vec<VoxelType> = types.collect();
        let sources = shown.sources();
        // Each field's own bytes of each brick; nothing is exchanged of those that are not read.
        let mut own: Vec<Vec<(GridBox, &[u8])>> = vec![Vec::new(); types.len()];
        for (brick, bytes) in &bricks {
            let mut rest = &bytes[..];
            for (n, (own, voxel_type)) in own.iter_mut().zip(&types).enumerate() {
                let (field, behind) = rest.split_at(brick.voxels() * voxel_type.size_bytes());
                if sources.contains(&n) {
                    own.push((*brick, field));
                }
                rest = behind;
            }
        }
        let filled = self.exchange_ghosts(sequence, &preparation, (&windows, &sources), (&own, &types))?;
        // The simulation gets its memory back.
        drop(bricks);
        let Windows { parts, points } = of_members.swap_remove(me);
        let (mut volumes, mut without_cells) = (Vec::new(), Vec::new());
        for (n, (window, of_window)) in points.iter().zip(filled).enumerate() {
            let resampled = |voxels| preparation.resampled(voxels, window);
            let mut of_window: Vec<Option<Voxels>> = of_window.into_iter().map(|v| v.map(resampled)).collect();
            if let Some(part) = parts.get(n) {
                let grid = Grid::new(part.dims(), preparation.grid.spacing(), DVec3::ZERO)?;
                volumes.push((part.clone(), shown.volume(grid, of_window)?));
            } else if let Some(voxels) = shown.plain().and_then(|plain| of_window[plain].take()) {
                without_cells.push((*window, voxels));
            }
        }
        let windowed = points.iter().zip(volumes.iter().map(|(_, volume)| volume.voxels()));
        let windowed: Vec<(&GridBox, &Voxels)> = windowed.chain(without_cells.iter().map(|(w, v)| (w, v))).collect();
        let empty_seen =
            windowed[..volumes.len()].iter().any(|(window, voxels)| not_finite(voxels, window, window) > 0);
        // Each box is counted in the first window that has all of it: a point may be in several.
        let own_points = |own: &GridBox| {
            let (window, voxels) =
                windowed.iter().find(|(window, _)| window.intersection(own).as_ref() == Some(own))?;
            Some(OwnPoints { own: *own, window: **window, voxels })
        };
        let own: Vec<OwnPoints<'_>> = preparation.members[me].iter().filter_map(own_points).collect();
        let empty_voxels = own.iter().map(|points| not_finite(points.voxels, &points.window, &points.own)).sum();
        let mut statistics = None;
        if preparation.statistics {
            statistics = Some(self.statistics_of(sequence, &own, &preparation.grid)?);
        }
        let Preparation { grid, scene, .. } = preparation;
        let field = |(part, volume)| Field::part(volume, (grid, part), &scene);
        let fields = volumes.into_iter().map(field).collect::<Result<Vec<_>, _>>()?;
        let parts = if scene.effects.needs_light_volume() { self.light(sequence, fields)? } else { fields };
        self.fields.insert(step, PartFields { grid, scene, parts });
        Ok(v1::GroupPrepared { empty_voxels, empty_seen, statistics }.encode_to_vec())
    }

    /// Its parts, in the light that all members' parts let through.
    fn light(&mut self, sequence: u64, parts: Vec<Field>) -> Result<Vec<Field>, Invalid> {
        let mut own = Vec::new();
        parts.iter().filter_map(Field::extinction_sums).for_each(|part| sums::write(&part, &mut own));
        let others = self.others();
        others.iter().for_each(|&other| send(&self.outbox, other, sequence, Kind::Extinction(own.clone())));
        let mut gathered = self.gather(sequence, others, extinction_sums)?;
        gathered.push((self.outbox.rank(), own));
        // In one order at all members, so that all have the same light.
        gathered.sort_by_key(|(from, _)| *from);
        let all = gathered.iter().map(|(_, bytes)| sums::read_all(bytes)).collect::<Result<Vec<_>, _>>()?.concat();
        Field::lit(parts, &all)
    }

    /// Sums what each of its boxes gives to the reduced volume.
    fn reduce(&self, command: v1::GroupReduce) -> Result<Vec<u8>, Invalid> {
        let v1::GroupReduce { step, params, masked } = command;
        let GenerationParams::Volume(params) = lamina_rpc::required(params, "params")?.try_into()? else {
            return Err(Invalid::new("representation", "a VDI is generated, a volume reduced"));
        };
        let step = key(step);
        let fields = self.fields.get(&step).ok_or_else(|| missing(&step))?;
        let mut out = Vec::new();
        for part in &fields.parts {
            sums::write(&PartSums::of(part, &params, masked)?, &mut out);
        }
        Ok(out)
    }

    /// Casts pixels through each of its boxes.
    fn cast(&mut self, command: v1::GroupCast) -> Result<Vec<u8>, Invalid> {
        let step = command.step.clone();
        let (plan, batches) = read_cast(command)?;
        let step = key(step);
        let fields = self.fields.get(&step).ok_or_else(|| missing(&step))?;
        let (cameras, size) = (plan.test_cameras(&fields.scene.camera)?, plan.image_size);
        let mut out = Vec::new();
        for field in &fields.parts {
            for (v, camera) in cameras.iter().enumerate() {
                let pixels: Vec<_> = batches.clone().flat_map(|b| plan.pixels(v, b)).collect();
                let layers = self.backend.raycast_layers(field, camera, size, size, &pixels)?;
                out.extend(layers.iter().flatten().flat_map(|x| x.to_le_bytes()));
            }
        }
        Ok(out)
    }

    /// The points of the command's lattice.
    fn sample(&mut self, command: &v1::GroupSample) -> Result<Vec<u8>, Invalid> {
        let held = self.held.lock();
        // A member without ranks holds nothing; the root knows which have points.
        let Some(step) = held.get(&key(command.step.clone())) else { return Ok(Vec::new()) };
        let sizes: Vec<usize> = step.spec.fields().map(|(_, voxel_type)| voxel_type.size_bytes()).collect();
        let mut out = Vec::new();
        for (brick, bytes) in &step.bricks {
            let mut before = 0;
            for &size in &sizes {
                let [nx, ny, _] = brick.dims();
                for [x, y, z] in lattice(brick, command.stride) {
                    let [x, y, z] = [x - brick.start()[0], y - brick.start()[1], z - brick.start()[2]];
                    let at = before + ((z * ny + y) * nx + x) * size;
                    out.extend_from_slice(&bytes[at..at + size]);
                }
                before += brick.voxels() * size;
            }
        }
        Ok(out)
    }
}

fn extinction_sums(kind: &Kind) -> Option<&[u8]> {
    if let Kind::Extinction(bytes) = kind { Some(bytes) } else { None }
}

fn is_between_members(message: &v1::GroupMessage) -> bool {
    use Kind::{Extinction, Failed, Ghost, Lists, Moments, Rows, Statistics};
    matches!(message.kind, Some(Ghost(_) | Lists(_) | Statistics(_) | Rows(_) | Extinction(_) | Moments(_) | Failed(_)))
}

/// Points of a box whose index is a multiple of `stride` on all axes, x fastest.
pub(super) fn lattice(of: &GridBox, stride: u32) -> impl Iterator<Item = [usize; 3]> {
    let stride = stride.max(1) as usize;
    let (start, dims) = (of.start(), of.dims());
    let axis = move |a: usize| (start[a].div_ceil(stride) * stride..start[a] + dims[a]).step_by(stride);
    axis(2).flat_map(move |z| axis(1).flat_map(move |y| axis(0).map(move |x| [x, y, z])))
}

/// The number of points of `own` that are NaN or infinite in `voxels`, which are those of `window`.
fn not_finite(voxels: &Voxels, window: &GridBox, own: &GridBox) -> u64 {
    if matches!(voxels, Voxels::U8(_) | Voxels::U16(_) | Voxels::I16(_)) {
        return 0;
    }
    let Some(shared) = window.intersection(own) else { return 0 };
    let rows = window::row_starts(window, &shared);
    let count = |first: usize| (first..first + shared.dims()[0]).filter(|&n| !voxels.get(n).is_finite()).count();
    rows.map(count).sum::<usize>() as u64
}
