//! Generation of a volume that does not fit into memory: slab by slab, as the members of a group make theirs side by side.

use crate::cli;
use crate::scene_file::{scene_for, with_step};
use anyhow::ensure;
use glam::DVec3;
use lamina_model::{
    GenerationParams, Grid, Intermediate, Scene, Segmentation, Vdi, VdiParams, Volume, VoxelType, Voxels,
};
use lamina_raycast::{Backend, Compositor, Field, GridPart, PartReduction, PartSums, RowBand};
use lamina_volume_io::Series;
use std::ops::Range;
use std::time::{Duration, Instant};

/// What the program takes beside a slab and what becomes of it, bytes.
const PROGRAM: u64 = 64 << 20;
/// Bytes that a point of a slab takes beside its value in the file: stored for the kernels; as a position in the range, cut and
/// shrunk along an axis, where it becomes a reduced volume.
const STORED: u64 = 4;
const REDUCED: u64 = 16;
/// What coding a point of a reduced volume takes at most.
const CODED: u64 = 28;
/// Rows of a VDI that are composited at once.
const ROWS: usize = 16;
/// The most points on a side of the volume that a scene is chosen for.
const COARSE_POINTS: usize = 64;

/// A volume that is read in slabs of planes.
pub(crate) struct Slabs<'a> {
    series: &'a Series,
    index: usize,
    grid: Grid,
    scene: Scene,
    /// Planes of a slab.
    planes: usize,
    /// Bytes for what becomes of the slabs.
    room: u64,
}

impl<'a> Slabs<'a> {
    /// Of the step that `input` names, so that generation takes no more than `memory` bytes; its scene is chosen from a part of its
    /// points where a file does not state it.
    pub(crate) fn open(series: &'a Series, input: &cli::Input, memory: u64, is_volume: bool) -> anyhow::Result<Self> {
        let index = input.time_step;
        let grid = series.grid_of_planes(index)?;
        let coarse = coarse(series, index, &grid)?;
        let scene = with_step(scene_for(input.scene.as_deref(), &[&coarse])?, input)?;
        let [nx, ny, nz] = grid.dims();
        let value = coarse.voxels().voxel_type().size_bytes() as u64;
        let plane = (nx * ny) as u64 * (value + STORED + if is_volume { REDUCED } else { 0 });
        // Half for a slab, and half for the lists or sums that become of them.
        let room = memory.saturating_sub(PROGRAM) / 2;
        let beside = 2 * GridPart::ghost_layers(&scene) as u64;
        let planes = (room / plane).saturating_sub(beside) as usize;
        let least = PROGRAM + 2 * (1 + beside) * plane;
        ensure!(planes > 0, "--memory: a plane of {nx} x {ny} points needs {} MB at least", least.div_ceil(1_000_000));
        Ok(Self { series, index, grid, scene, planes: planes.min(nz), room })
    }

    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The fields of all slabs, one after the other.
    fn fields(&self) -> impl Iterator<Item = anyhow::Result<Field>> {
        let [nx, ny, nz] = self.grid.dims();
        (0..nz).step_by(self.planes).filter_map(move |first| {
            let dims = [nx, ny, self.planes.min(nz - first)];
            match GridPart::of_points(&self.grid, [0, 0, first], dims, GridPart::ghost_layers(&self.scene)) {
                Ok(part) => part.map(|part| self.field(part)),
                Err(error) => Some(Err(error.into())),
            }
        })
    }

    fn field(&self, part: GridPart) -> anyhow::Result<Field> {
        let planes: Range<usize> = part.start()[2]..part.start()[2] + part.dims()[2];
        let volume = self.series.read_planes(self.index, planes)?;
        Ok(Field::part(volume, (self.grid, part), &self.scene)?)
    }

    /// Lists of all slabs, composited some rows at a time.
    fn generate(
        &self,
        backend: &Backend,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> anyhow::Result<(Vdi, Duration)> {
        let compositor = Compositor::new(&self.grid, &self.scene, params, segmentation)?;
        let rows: Vec<u32> = (0..params.resolution()).collect();
        let mut parts: Vec<(&[u32], Vec<RowBand>)> = rows.chunks(ROWS).map(|rows| (rows, Vec::new())).collect();
        let (mut lists, mut time) = (0, Duration::ZERO);
        for field in self.fields() {
            let (vdi, of_slab) = backend.generate(&field?, compositor.part_params(), Segmentation::Greedy)?;
            time += of_slab;
            parts.iter_mut().for_each(|(rows, of_rows)| of_rows.push(RowBand::of_rows(&vdi, rows)));
            lists += (size_of_val(vdi.offsets()) + size_of_val(vdi.segments())) as u64;
            let need = (PROGRAM + 2 * lists).div_ceil(1_000_000);
            let remedy = "fewer rays or a larger --gamma make fewer";
            ensure!(lists <= self.room, "--memory: the lists of some slabs need {need} MB already; {remedy}");
        }
        let start = Instant::now();
        let mut failed = None;
        let bands = parts.into_iter().map_while(|(rows, of_rows)| match compositor.rows(rows, &of_rows) {
            Ok(band) => Some(band),
            Err(error) => {
                failed = Some(error);
                None
            }
        });
        let vdi = compositor.finish(bands);
        if let Some(error) = failed {
            return Err(error.into());
        }
        Ok((vdi?, time + start.elapsed()))
    }

    /// The whole generated with `params`, and the time that it took without reading.
    pub(crate) fn represent(
        &self,
        backend: &Backend,
        params: &GenerationParams,
        segmentation: Segmentation,
    ) -> anyhow::Result<(Intermediate, Duration)> {
        match params {
            GenerationParams::Vdi(params) => {
                let (vdi, time) = self.generate(backend, params, segmentation)?;
                Ok((Intermediate::Vdi(Box::new(vdi)), time))
            }
            GenerationParams::Volume(params) => {
                // Whether any voxel is missing is known only once all were read.
                let sum = |is_masked: bool| -> anyhow::Result<(PartReduction, bool, Duration)> {
                    let (mut whole, mut time) = (PartReduction::new(&self.grid, &self.scene, params), Duration::ZERO);
                    let mut some_missing = false;
                    for field in self.fields() {
                        let (field, start) = (field?, Instant::now());
                        some_missing |= field.empty_voxels() > 0;
                        whole.add(&PartSums::of(&field, params, is_masked)?)?;
                        time += start.elapsed();
                    }
                    Ok((whole, some_missing, time))
                };
                let (mut whole, some_missing, mut time) = sum(false)?;
                if some_missing {
                    (whole, _, time) = sum(true)?;
                }
                let start = Instant::now();
                let volume = whole.finish(&self.grid, &self.scene, params)?;
                time += start.elapsed();
                let need = PROGRAM + CODED * volume.grid().voxels() as u64;
                let (least, most) = (need.div_ceil(1_000_000), PROGRAM + 2 * self.room);
                ensure!(
                    need <= most,
                    "--memory: to code so many points takes {least} MB; a smaller --resolution has fewer"
                );
                Ok((Intermediate::Volume(Box::new(volume)), time))
            }
        }
    }
}

/// The step on a lattice of few points, to choose a scene from: that of a group of nodes.
fn coarse(series: &Series, index: usize, grid: &Grid) -> anyhow::Result<Volume> {
    let stride = grid.dims().into_iter().max().unwrap_or(1).div_ceil(COARSE_POINTS).max(1);
    let dims = grid.dims().map(|n| n.div_ceil(stride));
    let (mut bytes, mut voxel_type) = (Vec::new(), VoxelType::F32);
    for z in (0..grid.dims()[2]).step_by(stride) {
        let (of, plane, _) = series.read_planes(index, z..z + 1)?.into_parts();
        let [nx, ny, _] = of.dims();
        let points = (0..ny).step_by(stride).flat_map(|y| (0..nx).step_by(stride).map(move |x| y * nx + x));
        bytes.extend(points.flat_map(|n| plane.to_le_bytes(n..n + 1)));
        voxel_type = plane.voxel_type();
    }
    // In the whole grid's box, which the camera is chosen for.
    let stretch = |a: usize| grid.spacing()[a] * (grid.dims()[a] - 1).max(1) as f64 / (dims[a] - 1).max(1) as f64;
    let coarse = Grid::new(dims, DVec3::from_array([0, 1, 2].map(stretch)), grid.origin())?;
    Ok(Volume::new(coarse, Voxels::from_le_bytes(voxel_type, &bytes))?)
}
