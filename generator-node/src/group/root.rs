//! The root: commands to all members, and a step's field in parts as if it were one.

use super::convert::{Preparation, cast_message};
use super::member::lattice;
use super::{Kind, send, sums};
use crate::ingest::{GridBox, RunSpec};
use crate::triggers::Statistics;
use glam::DVec3;
use lamina_codec::BandStatistics;
use lamina_field_expression::ShownFields;
use lamina_model::{
    Aabb, Coordinates, Grid, Image, Invalid, ReducedVolume, ReferenceSamples, SamplePlan, Scene, Segmentation,
    VdiParams, Volume, VolumeParams, VoxelType, Voxels,
};
use lamina_mpi::Outbox;
use lamina_raycast::{Compositor, GridPart, PartReduction};
use lamina_rpc::v1;
use parking_lot::Mutex;
use prost::Message as _;
use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// The longest that members may take to answer a command: longer than they wait for each other.
const PATIENCE: Duration = Duration::from_secs(90);

/// The most points of a coarse volume on a side.
const COARSE_POINTS: usize = 64;

/// Who answers, to which command, and what.
pub(super) type Answer = (u32, u64, v1::GroupReply);

/// The root's end of a group.
pub(crate) struct Root {
    outbox: Outbox,
    /// One command at a time: its number, and where its answers come.
    asking: Mutex<(u64, Receiver<Answer>)>,
}

impl Root {
    pub(crate) fn new(outbox: Outbox, replies: Receiver<Answer>) -> Self {
        Self { outbox, asking: Mutex::new((0, replies)) }
    }

    /// Sends a command to all members.
    fn tell(&self, sequence: u64, kind: &Kind) {
        (0..self.outbox.size()).for_each(|member| send(&self.outbox, member, sequence, kind.clone()));
    }

    /// The same of one that is answered: their answers in order.
    fn ask(&self, kind: &Kind) -> Result<Vec<v1::GroupReply>, Invalid> {
        let mut asking = self.asking.lock();
        let (sequence, replies) = &mut *asking;
        *sequence += 1;
        self.tell(*sequence, kind);
        let mut answers: Vec<Option<v1::GroupReply>> = vec![None; self.outbox.size() as usize];
        let until = Instant::now() + PATIENCE;
        while answers.iter().any(Option::is_none) {
            let left = until.saturating_duration_since(Instant::now());
            let Ok((from, of, reply)) = replies.recv_timeout(left) else {
                let silent: Vec<usize> = (0..answers.len()).filter(|&n| answers[n].is_none()).collect();
                let why = format!("members {silent:?} did not answer within {PATIENCE:?}; restart the group");
                return Err(Invalid::new("group", why));
            };
            if of == *sequence {
                answers[from as usize] = Some(reply);
            }
        }
        let answers: Vec<v1::GroupReply> = answers.into_iter().flatten().collect();
        if let Some((member, reply)) = answers.iter().enumerate().find(|(_, reply)| !reply.failed.is_empty()) {
            return Err(Invalid::new("group", format!("member {member}: {}", reply.failed)));
        }
        Ok(answers)
    }

    /// The step on a lattice so coarse that it has few points, to choose a scene from.
    /// Derivatives are those of the lattice.
    pub(crate) fn coarse(
        &self,
        (run_id, step): (&str, u64),
        (spec, shown): (&RunSpec, &ShownFields),
        members: &[Vec<GridBox>],
    ) -> Result<Volume, Invalid> {
        let grid = &spec.grid;
        let stride = grid.dims().into_iter().max().unwrap_or(1).div_ceil(COARSE_POINTS).max(1);
        let dims = grid.dims().map(|n| n.div_ceil(stride));
        let coarse = Grid::new(dims, grid.spacing() * stride as f64, grid.origin())?;
        let answers =
            self.ask(&Kind::Sample(v1::GroupSample { step: Some(message(run_id, step)), stride: stride as u32 }))?;
        let types: Vec<VoxelType> = spec.fields().map(|(_, voxel_type)| voxel_type).collect();
        let mut fields: Vec<Vec<u8>> = types.iter().map(|t| vec![0; coarse.voxels() * t.size_bytes()]).collect();
        for (member, (boxes, answer)) in members.iter().zip(answers).enumerate() {
            let mut rest = &answer.payload[..];
            for b in boxes {
                for (field, size) in fields.iter_mut().zip(types.iter().map(|t| t.size_bytes())) {
                    for [x, y, z] in lattice(b, stride as u32) {
                        let short = || Invalid::new("group", format!("member {member} lacks points of step {step}"));
                        let (point, others) = rest.split_at_checked(size).ok_or_else(short)?;
                        let at = ((z / stride * dims[1] + y / stride) * dims[0] + x / stride) * size;
                        field[at..at + size].copy_from_slice(point);
                        rest = others;
                    }
                }
            }
        }
        let mut sampled: Vec<_> =
            types.iter().zip(&fields).map(|(t, bytes)| Voxels::from_le_bytes(*t, bytes)).collect();
        let mut grid = coarse;
        if let Some(coordinates) = &spec.coordinates {
            let every = coordinates.axes().each_ref().map(|axis| axis.iter().copied().step_by(stride).collect());
            let coordinates = Coordinates::new(every)?;
            grid = coordinates.grid()?;
            sampled = sampled.into_iter().map(|voxels| coordinates.resample(voxels)).collect();
        }
        shown.volume(grid, sampled.into_iter().map(Some).collect())
    }
}

/// A VDI that all members have generated and encoded together.
pub(crate) struct GroupVdi {
    /// As a reader gets it.
    pub bytes: Vec<u8>,
    /// Supersegments.
    pub segments: u64,
    /// Wall time of the slowest member.
    pub generation: Duration,
    /// Wall time of the slowest member.
    pub encoding: Duration,
}

/// A step whose field is in parts at all members; they forget it when this is dropped.
pub(crate) struct GroupField {
    root: Arc<Root>,
    step: v1::GroupStep,
    grid: Grid,
    scene: Scene,
    /// Of all members, in their order.
    parts: Vec<GridPart>,
    empty_voxels: u64,
    /// Some member has such voxels, also among its ghost points.
    empty_seen: bool,
    /// Of what is shown, if they were asked for.
    statistics: Option<Statistics>,
}

impl GroupField {
    /// Lets all members prepare what is `shown` of the step whose boxes are those of `members`, and gather its `statistics`.
    pub(crate) fn prepare(
        root: &Arc<Root>,
        (run_id, step): (&str, u64),
        (spec, shown, statistics): (&RunSpec, &str, bool),
        scene: Scene,
        members: Vec<Vec<GridBox>>,
    ) -> Result<Self, Invalid> {
        let preparation = Preparation::of_run(spec, (shown, statistics), scene, members);
        let step = message(run_id, step);
        let answers = root.ask(&Kind::Prepare(preparation.message(step.clone())))?;
        let prepared = answers.iter().map(|reply| v1::GroupPrepared::decode(&reply.payload[..]));
        let prepared = prepared.collect::<Result<Vec<_>, _>>().map_err(|e| Invalid::new("group", e.to_string()))?;
        let empty_voxels = prepared.iter().map(|of_member| of_member.empty_voxels).sum();
        let empty_seen = prepared.iter().any(|of_member| of_member.empty_seen);
        let statistics = prepared.into_iter().filter_map(|of_member| of_member.statistics).collect();
        let statistics = super::statistics::of_all(statistics, &preparation.grid);
        let parts = (0..preparation.members.len()).map(|member| preparation.parts(member));
        let parts = parts.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        let Preparation { grid, scene, .. } = preparation;
        Ok(Self { root: root.clone(), step, grid, scene, parts, empty_voxels, empty_seen, statistics })
    }

    /// Voxels that are NaN or infinite.
    pub(crate) fn empty_voxels(&self) -> u64 {
        self.empty_voxels
    }

    /// Its statistics, once, if they were asked for.
    pub(crate) fn take_statistics(&mut self) -> Option<Statistics> {
        self.statistics.take()
    }

    /// A picture from the scene's camera, turned about the y axis by `angle_deg`, `side` pixels a side.
    pub(crate) fn picture(&self, angle_deg: f64, side: u32) -> Result<Image, Invalid> {
        let plan = SamplePlan { image_size: side, tile: 1, batches: 1, angles_deg: vec![angle_deg] };
        Image::new(side, side, self.reference_slice(&plan, 0..1)?.colors.swap_remove(0))
    }

    /// The VDI of the whole, encoded.
    pub(crate) fn generate(&self, params: &VdiParams, segmentation: Segmentation) -> Result<GroupVdi, Invalid> {
        let compositor = Compositor::new(&self.grid, &self.scene, params, segmentation)?;
        let answers = self.ask_to_generate(params, segmentation, true)?;
        let coded = answers.iter().map(|reply| v1::GroupCoded::decode(&reply.payload[..]));
        let coded = coded.collect::<Result<Vec<_>, _>>().map_err(|e| Invalid::new("group", e.to_string()))?;
        let whole = BandStatistics::read(coded.first().map_or(&[], |first| &first.statistics))?;
        let members = coded.len();
        let mut of_members: Vec<_> = coded.into_iter().map(|of_member| of_member.parts.into_iter()).collect();
        let bands = whole.bands(params.resolution()).len();
        let parts = (0..2 * bands).map(|part| of_members[part % members].next().unwrap_or_default());
        let mut geometry: Vec<Vec<u8>> = parts.collect();
        let colors = geometry.split_off(bands);
        let bands: Vec<[Vec<u8>; 2]> = geometry.into_iter().zip(colors).map(Into::into).collect();
        Ok(GroupVdi {
            bytes: whole.encoded(compositor.header(), &bands)?,
            segments: whole.segments(),
            generation: slowest(answers.iter().map(|reply| reply.elapsed_ns.saturating_sub(reply.encode_ns))),
            encoding: slowest(answers.iter().map(|reply| reply.encode_ns)),
        })
    }

    /// The time that generation of a VDI takes the slowest member.
    pub(crate) fn time(&self, params: &VdiParams, segmentation: Segmentation) -> Result<Duration, Invalid> {
        let answers = self.ask_to_generate(params, segmentation, false)?;
        Ok(slowest(answers.iter().map(|reply| reply.elapsed_ns)))
    }

    fn ask_to_generate(
        &self,
        params: &VdiParams,
        segmentation: Segmentation,
        encode: bool,
    ) -> Result<Vec<v1::GroupReply>, Invalid> {
        let command = v1::GroupGenerate {
            step: Some(self.step.clone()),
            params: Some((&lamina_model::GenerationParams::Vdi(*params)).into()),
            greedy: segmentation == Segmentation::Greedy,
            encode,
        };
        self.root.ask(&Kind::Generate(command))
    }

    /// The reduced volume of the whole, and the time that the slowest member took.
    pub(crate) fn reduce(&self, params: &VolumeParams) -> Result<(ReducedVolume, Duration), Invalid> {
        let command = v1::GroupReduce {
            step: Some(self.step.clone()),
            params: Some((&lamina_model::GenerationParams::Volume(*params)).into()),
            masked: self.empty_seen,
        };
        let answers = self.root.ask(&Kind::Reduce(command))?;
        let time = slowest(answers.iter().map(|reply| reply.elapsed_ns));
        let mut whole = PartReduction::new(&self.grid, &self.scene, params);
        for answer in answers {
            sums::read_all(&answer.payload)?.iter().try_for_each(|part| whole.add(part))?;
        }
        Ok((whole.finish(&self.grid, &self.scene, params)?, time))
    }

    /// The most points on a side of a reduced volume; 0 if there can be none.
    pub(crate) fn longest_side(&self) -> u32 {
        if self.scene.effects.color_field.is_some() { 0 } else { self.grid.longest_side() }
    }

    /// Reference samples of some batches, composited of what the parts have of each pixel.
    pub(crate) fn reference_slice(&self, plan: &SamplePlan, batches: Range<u32>) -> Result<ReferenceSamples, Invalid> {
        let plan = plan.clone().check()?;
        let answers = self.root.ask(&Kind::Cast(cast_message(self.step.clone(), &plan, &batches)))?;
        let bytes: Vec<u8> = answers.iter().flat_map(|reply| reply.payload.iter().copied()).collect();
        let layers: Vec<[f32; 4]> = bytes.as_chunks::<16>().0.iter().map(layer).collect();
        let cameras = plan.test_cameras(&self.scene.camera)?;
        let per_view = batches.len() * plan.samples_per_batch();
        let per_part = per_view * cameras.len();
        if layers.len() != per_part * self.parts.len() {
            return Err(Invalid::new("group", "colors of another number of pixels arrived"));
        }
        let boxes = self.parts.iter().map(|part| self.bounds(part)).collect::<Result<Vec<_>, _>>()?;
        let view = |(v, camera): (usize, &lamina_model::Camera)| {
            let pixels = batches.clone().flat_map(|b| plan.pixels(v, b));
            let color = |(n, (i, j)): (usize, (u32, u32))| {
                let ray = camera.pixel_ray(i, j, plan.image_size, plan.image_size);
                let met = boxes.iter().enumerate().filter_map(|(part, b)| Some((b.clip(&ray)?.0, part)));
                let mut order: Vec<(f64, usize)> = met.collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                let (mut color, mut transmittance) = ([0.0; 3], 1.0);
                for (_, part) in order {
                    let [r, g, b, through] = layers[part * per_part + v * per_view + n];
                    color = [color[0] + transmittance * r, color[1] + transmittance * g, color[2] + transmittance * b];
                    transmittance *= through;
                }
                std::array::from_fn(|c| color[c] + transmittance * self.scene.background[c])
            };
            pixels.enumerate().map(color).collect()
        };
        let colors = cameras.iter().enumerate().map(view).collect();
        Ok(ReferenceSamples { step: self.step.step, plan, scene: self.scene.clone(), batches, colors })
    }

    /// The box of a part's own cells.
    fn bounds(&self, part: &GridPart) -> Result<Aabb, Invalid> {
        let whole = self.grid.bounds();
        let corner = |end: bool| {
            DVec3::from_array([0, 1, 2].map(|a| {
                if self.grid.dims()[a] == 1 {
                    return if end { whole.max[a] } else { whole.min[a] };
                }
                let cell = if end { part.cells()[a].end } else { part.cells()[a].start };
                self.grid.origin()[a] + cell as f64 * self.grid.spacing()[a]
            }))
        };
        Aabb::new(corner(false), corner(true))
    }
}

impl Drop for GroupField {
    fn drop(&mut self) {
        self.root.tell(0, &Kind::Release(v1::GroupRelease { step: Some(self.step.clone()) }));
    }
}

fn message(run_id: &str, step: u64) -> v1::GroupStep {
    v1::GroupStep { run_id: run_id.to_owned(), step }
}

/// The longest of some times.
fn slowest(nanoseconds: impl Iterator<Item = u64>) -> Duration {
    Duration::from_nanos(nanoseconds.max().unwrap_or(0))
}

fn layer(bytes: &[u8; 16]) -> [f32; 4] {
    std::array::from_fn(|n| f32::from_le_bytes([bytes[4 * n], bytes[4 * n + 1], bytes[4 * n + 2], bytes[4 * n + 3]]))
}
