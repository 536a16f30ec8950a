//! Boxes, specs and plans of group messages.

use super::window::SourcePoints;
use crate::ingest::{GridBox, RunSpec};
use lamina_field_expression::ShownFields;
use lamina_model::{Coordinates, Grid, Invalid, SamplePlan, Scene, VoxelType, Voxels};
use lamina_raycast::GridPart;
use lamina_rpc::convert::{axes_message, axes_of};
use lamina_rpc::{required, v1};
use std::ops::Range;

/// As a message.
pub(super) fn box_message(b: &GridBox) -> v1::GroupBox {
    let ([x0, y0, z0], [nx, ny, nz]) = (b.start().map(|n| n as u64), b.dims().map(|n| n as u64));
    v1::GroupBox { x0, y0, z0, nx, ny, nz }
}

/// Boxes of `grid`.
pub(super) fn boxes(messages: &[v1::GroupBox], grid: &Grid) -> Result<Vec<GridBox>, Invalid> {
    messages.iter().map(|b| GridBox::new([b.x0, b.y0, b.z0], [b.nx, b.ny, b.nz], grid)).collect()
}

/// What all members make fields of.
pub(super) struct Preparation {
    pub grid: Grid,
    /// Where the points of the boxes are, if that is not even. Fields are of the even points with the same indexes.
    pub coordinates: Option<Coordinates>,
    /// All fields, in the order of a brick's bytes.
    pub fields: Vec<(String, VoxelType)>,
    /// What is shown of them.
    pub shown: String,
    pub scene: Scene,
    /// Of each member.
    pub members: Vec<Vec<GridBox>>,
    /// Statistics are asked for.
    pub statistics: bool,
}

/// What a member makes fields of, and the points that it needs for that.
pub(super) struct Windows {
    pub parts: Vec<GridPart>,
    /// Those of the parts in their order, ghost points among them; then boxes of points that have no cell, and are only counted.
    pub points: Vec<GridBox>,
}

impl Preparation {
    /// What the expressions read.
    pub(super) fn shown_fields(&self) -> Result<ShownFields, Invalid> {
        let names: Vec<&str> = self.fields.iter().map(|(name, _)| name.as_str()).collect();
        ShownFields::under(&self.shown, &self.scene, &names)
    }

    /// Layers of points around a box that its samples need, and what those are computed from.
    fn ghost(&self) -> Result<usize, Invalid> {
        Ok(GridPart::ghost_layers(&self.scene) + self.shown_fields()?.reach())
    }

    /// The parts of member `member`: its boxes, joined where two make up a larger one, as far as they have cells.
    pub(super) fn parts(&self, member: usize) -> Result<Vec<GridPart>, Invalid> {
        let ghost = self.ghost()?;
        let part = |b: &GridBox| GridPart::of_points(&self.grid, b.start(), b.dims(), ghost).transpose();
        joined(self.members[member].clone()).iter().filter_map(part).collect()
    }

    /// What member `member` makes fields of.
    pub(super) fn windows(&self, member: usize) -> Result<Windows, Invalid> {
        let parts = self.parts(member)?;
        let window = |p: &GridPart| GridBox::new(p.start().map(|n| n as u64), p.dims().map(|n| n as u64), &self.grid);
        let mut points = parts.iter().map(window).collect::<Result<Vec<_>, _>>()?;
        // Cells lie between a point and the next one along each axis.
        let is_last = |own: &GridBox| (0..3).any(|a| own.start()[a] > 0 && own.start()[a] + 1 == self.grid.dims()[a]);
        let is_in = |own: &GridBox, window: &GridBox| window.intersection(own).as_ref() == Some(own);
        let alone = |own: &&GridBox| is_last(own) && !points.iter().any(|window| is_in(own, window));
        let without_cells: Vec<GridBox> = self.members[member].iter().filter(alone).copied().collect();
        points.extend(without_cells);
        Ok(Windows { parts, points })
    }

    /// The points that a window of the grid's even points is made from.
    pub(super) fn sources(&self, window: &GridBox) -> Result<SourcePoints, Invalid> {
        let axes = self.coordinates.as_ref().map_or([None, None, None], |of| of.sources(&window.ranges()));
        SourcePoints::new(window, axes, &self.grid)
    }

    /// The even points of `window`, made from the voxels at its [`Preparation::sources`].
    pub(super) fn resampled(&self, voxels: Voxels, window: &GridBox) -> Voxels {
        match &self.coordinates {
            Some(coordinates) => coordinates.resample_part(voxels, &window.ranges()),
            None => voxels,
        }
    }

    /// As the command.
    pub(super) fn message(&self, step: v1::GroupStep) -> v1::GroupPrepare {
        let boxes = |b: &Vec<GridBox>| v1::GroupBoxes { boxes: b.iter().map(box_message).collect() };
        v1::GroupPrepare {
            step: Some(step),
            grid: Some((&self.grid).into()),
            fields: self.fields.iter().map(Into::into).collect(),
            shown: self.shown.clone(),
            scene: Some((&self.scene).into()),
            members: self.members.iter().map(boxes).collect(),
            statistics: self.statistics,
            coordinates: axes_message(self.coordinates.as_ref()),
        }
    }

    /// Of the command.
    pub(super) fn read(message: v1::GroupPrepare) -> Result<Self, Invalid> {
        let grid = required(message.grid, "grid")?.try_into()?;
        Ok(Self {
            fields: message.fields.iter().map(TryInto::try_into).collect::<Result<_, _>>()?,
            shown: message.shown,
            scene: required(message.scene, "scene")?.try_into()?,
            members: message.members.iter().map(|m| boxes(&m.boxes, &grid)).collect::<Result<_, _>>()?,
            statistics: message.statistics,
            coordinates: axes_of(message.coordinates, &grid)?,
            grid,
        })
    }

    /// Of a run of which `shown` is shown.
    pub(super) fn of_run(
        spec: &RunSpec,
        (shown, statistics): (&str, bool),
        scene: Scene,
        members: Vec<Vec<GridBox>>,
    ) -> Self {
        let fields = spec.fields().map(|(name, voxel_type)| (name.to_owned(), voxel_type)).collect();
        let (grid, coordinates) = (spec.grid, spec.coordinates.clone());
        Self { grid, coordinates, fields, shown: shown.to_owned(), scene, members, statistics }
    }
}

/// The most boxes of a member among which pairs are looked for.
const MOST_JOINED: usize = 1024;

/// `boxes` with those joined that share a whole face: fewer faces cut fewer rays.
fn joined(mut boxes: Vec<GridBox>) -> Vec<GridBox> {
    if boxes.len() > MOST_JOINED {
        return boxes;
    }
    let mut n = 0;
    while n < boxes.len() {
        let union = (n + 1..boxes.len()).find_map(|m| Some((m, boxes[n].union(&boxes[m])?)));
        match union {
            Some((m, union)) => {
                boxes.swap_remove(m);
                boxes[n] = union;
                // A larger box may fit to those before it.
                n = 0;
            }
            None => n += 1,
        }
    }
    boxes
}

/// The command to cast some batches of a plan.
pub(super) fn cast_message(step: v1::GroupStep, plan: &SamplePlan, batches: &Range<u32>) -> v1::GroupCast {
    v1::GroupCast {
        step: Some(step),
        image_size: plan.image_size,
        tile: plan.tile,
        batches: plan.batches,
        angles_deg: plan.angles_deg.clone(),
        first_batch: batches.start,
        cast_batches: batches.len() as u32,
    }
}

/// Of the command.
pub(super) fn read_cast(message: v1::GroupCast) -> Result<(SamplePlan, Range<u32>), Invalid> {
    let v1::GroupCast { image_size, tile, batches, angles_deg, first_batch, cast_batches, .. } = message;
    let plan = SamplePlan { image_size, tile, batches, angles_deg }.check()?;
    let slice = plan.slice(first_batch, cast_batches)?;
    Ok((plan, slice))
}

/// Rows of member `member`'s tile of an image of `resolution` rows: every so many, because those in the middle take more work.
pub(super) fn tile(resolution: u32, member: u32, members: u32) -> Vec<u32> {
    (member..resolution).step_by(members as usize).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn boxes_that_make_up_a_larger_one_are_joined_and_others_are_left() {
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO).unwrap();
        let at = |start, dims| GridBox::new(start, dims, &grid).unwrap();
        let l = vec![at([0; 3], [8, 3, 8]), at([0, 3, 0], [4, 5, 8])];
        assert_eq!(joined(l.clone()), l);
        let corner = vec![at([4, 3, 0], [4, 5, 6]), at([4, 3, 6], [4, 5, 2])];
        assert_eq!(joined([l, corner].concat()), [at([0; 3], [8; 3])]);
        let apart = vec![at([0; 3], [8, 8, 2]), at([0, 0, 3], [8, 8, 2])];
        assert_eq!(joined(apart.clone()), apart);
    }
}
