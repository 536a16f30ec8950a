//! An open file of fields: parts of them as volumes, whatever the format.

use super::axes::{AxisOrder, AxisRole, reordered};
use super::coordinates::Placement;
use crate::ReadError;
use crate::missing::{Meaning, mark_missing};
use crate::vti::AXES;
use glam::DVec3;
use lamina_model::{Grid, Volume, Voxels};
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Points along an axis, and steps of a file, at most: a header may state any number.
pub(super) const MOST_POINTS: usize = 1 << 20;

/// A field that a file holds: an array of three axes of space, and perhaps one of time.
#[derive(Debug, Clone)]
pub(super) struct FieldArray {
    pub(super) name: String,
    /// What the store calls it.
    pub(super) key: usize,
    /// Points along each stored axis, the slowest first, and what the axis is.
    pub(super) shape: Vec<usize>,
    pub(super) roles: Vec<AxisRole>,
    /// Along x, y and z.
    pub(super) placement: [Placement; 3],
    pub(super) meaning: Meaning,
}

/// What reads parts of arrays.
pub(super) trait ArrayStore: fmt::Debug + Send + Sync {
    /// The values in a region of an array, a range of each axis, in the order of storage.
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError>;
}

/// An open file of fields.
#[derive(Debug)]
pub(crate) struct ArrayFile {
    path: PathBuf,
    /// Ascending, one or more.
    times: Vec<f64>,
    /// Whether the file states the times.
    has_times: bool,
    fields: Vec<FieldArray>,
    store: Box<dyn ArrayStore>,
}

/// What the user says of arrays that do not say it themselves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct ArrayOptions {
    pub(crate) axes: AxisOrder,
    /// Of an adaptive mesh: the level whose cells are read; the finest, if none is stated.
    pub(crate) level: Option<usize>,
}

impl ArrayFile {
    /// Of fields with the same number of steps each, or one.
    pub(super) fn new(
        path: &Path,
        stated: Option<Vec<f64>>,
        fields: Vec<FieldArray>,
        store: impl ArrayStore + 'static,
    ) -> Result<Self, ReadError> {
        let steps = fields.iter().map(FieldArray::steps).max().unwrap_or(1);
        if let Some(other) = fields.iter().find(|field| field.has_time() && field.steps() != steps) {
            let reason = format!("\"{}\" has {} steps, another field {steps}", other.name, other.steps());
            return Err(ReadError::damaged(path, reason));
        }
        if fields.is_empty() || steps == 0 {
            let present = String::from("none");
            let reason = "there is no array of three axes of space and at least one step".to_owned();
            return Err(ReadError::Field { path: path.into(), reason, present });
        }
        if steps > MOST_POINTS {
            let what = format!("a series of {steps} steps");
            return Err(ReadError::unsupported(path, what, "cut it into files of fewer steps"));
        }
        let ascends = |times: &Vec<f64>| times.len() == steps && times.windows(2).all(|pair| pair[0] < pair[1]);
        let stated = stated.filter(|times| ascends(times) && times.iter().all(|time| time.is_finite()));
        let has_times = stated.is_some();
        let times = stated.unwrap_or_else(|| (0..steps).map(|step| step as f64).collect());
        Ok(Self { path: path.into(), times, has_times, fields, store: Box::new(store) })
    }

    /// Time of each step.
    pub(crate) fn times(&self) -> &[f64] {
        &self.times
    }

    /// Whether these are the file's own.
    pub(crate) fn has_times(&self) -> bool {
        self.has_times
    }

    /// The fields' names.
    pub(crate) fn names(&self) -> Vec<String> {
        self.fields.iter().map(|field| field.name.clone()).collect()
    }

    fn field(&self, name: &str) -> Result<&FieldArray, ReadError> {
        let missing = || ReadError::Field {
            path: self.path.clone(),
            reason: format!("there is no array \"{name}\""),
            present: self.names().join(", "),
        };
        self.fields.iter().find(|field| field.name == name).ok_or_else(missing)
    }

    /// The grid of a field.
    pub(crate) fn grid(&self, name: &str) -> Result<Grid, ReadError> {
        let field = self.field(name)?;
        let mut both = [(0.0, 0.0); 3];
        for ((place, placement), axis) in both.iter_mut().zip(&field.placement).zip(AXES) {
            let uneven = || {
                let what = format!("\"{name}\", whose coordinates along {axis} are not evenly spaced,");
                ReadError::unsupported(&self.path, what, "resample it to an even grid")
            };
            *place = placement.even().ok_or_else(uneven)?;
        }
        let [origin, spacing] = [both.map(|place| place.0), both.map(|place| place.1)].map(DVec3::from_array);
        Grid::new(field.dims(), spacing, origin).map_err(|e| ReadError::grid(&self.path, e))
    }

    /// Planes along z of a field at a step of this file.
    pub(crate) fn read(&self, step: usize, name: &str, planes: Range<usize>) -> Result<Volume, ReadError> {
        let (field, grid) = (self.field(name)?, self.grid(name)?);
        let [nx, ny, _] = grid.dims();
        // As it is stored, in order, and with missing values as a number.
        check_memory(&self.path, name, 3 * 4 * (nx * ny * planes.len()) as u64)?;
        let mut dims = field.dims();
        dims[2] = planes.len();
        let voxels = self.store.read(field.key, &field.region(step, planes.clone()))?;
        let voxels = reordered(voxels, &field.roles, dims, field.placement.each_ref().map(Placement::is_descending));
        let origin = grid.origin() + DVec3::Z * grid.spacing().z * planes.start as f64;
        let slab = Grid::new(dims, grid.spacing(), origin);
        let volume = slab.and_then(|slab| Volume::new(slab, voxels));
        let marked = volume.and_then(|volume| match field.meaning == Meaning::default() {
            true => Ok(volume),
            false => mark_missing(volume, &field.meaning),
        });
        marked.map_err(|e| ReadError::grid(&self.path, e))
    }
}

impl FieldArray {
    /// The components of the vector that it is, which lie along the stored axis `at`.
    pub(super) fn components(self, at: usize) -> Vec<Self> {
        let component = |(n, axis): (usize, &str)| {
            let mut of_axis = Self { name: format!("{}.{axis}", self.name), ..self.clone() };
            of_axis.roles[at] = AxisRole::Index(n);
            of_axis
        };
        AXES.into_iter().enumerate().map(component).collect()
    }

    /// Points along x, y and z.
    fn dims(&self) -> [usize; 3] {
        [AxisRole::X, AxisRole::Y, AxisRole::Z].map(|axis| self.along(axis).unwrap_or(1))
    }

    fn along(&self, axis: AxisRole) -> Option<usize> {
        self.roles.iter().position(|&role| role == axis).map(|n| self.shape[n])
    }

    fn has_time(&self) -> bool {
        self.roles.contains(&AxisRole::Time)
    }

    fn steps(&self) -> usize {
        self.along(AxisRole::Time).unwrap_or(1)
    }

    /// What is to be read of each axis. Of an axis that descends, planes are counted from its other end.
    fn region(&self, step: usize, planes: Range<usize>) -> Vec<Range<usize>> {
        let of = |(&role, &length): (&AxisRole, &usize)| match role {
            AxisRole::Time => step..step + 1,
            AxisRole::Index(n) => n..n + 1,
            AxisRole::Z if self.placement[2].is_descending() => length - planes.end..length - planes.start,
            AxisRole::Z => planes.clone(),
            AxisRole::X | AxisRole::Y => 0..length,
        };
        self.roles.iter().zip(&self.shape).map(of).collect()
    }
}

/// An array that is so many times as large as its file was not written into it: no packing does that with more than these bytes.
const MOST_PACKED: u64 = 1 << 14;
const SMALL: u64 = 64 << 20;

/// Refuses an array of `bytes` that the file at `path` cannot hold.
pub(super) fn check_claim(path: &Path, name: &str, bytes: u64) -> Result<(), ReadError> {
    let size = std::fs::metadata(path).map_err(|e| ReadError::while_reading(path, e))?.len();
    if bytes > SMALL && bytes / MOST_PACKED > size {
        let reason = format!("\"{name}\" is said to have {bytes} bytes, which {size} bytes of file cannot hold");
        return Err(ReadError::damaged(path, reason));
    }
    Ok(())
}

/// Refuses what the memory that is free cannot hold, before it is set aside: a small file may claim a large array.
fn check_memory(path: &Path, name: &str, bytes: u64) -> Result<(), ReadError> {
    let free = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
        line.trim().trim_end_matches(" kB").parse::<u64>().ok()
    });
    match free.map(|kib| kib << 10) {
        Some(free) if bytes > free => Err(ReadError::Memory { path: path.into(), name: name.into(), bytes, free }),
        _ => Ok(()),
    }
}
