//! A recorded time series under one roof: whatever the format, numbered steps with a time and a volume each.

use crate::missing::{Meaning, mark_missing};
use crate::raw::RawSpec;
use crate::source::{self, SeriesSource, SeriesStep};
use crate::{Options, ReadError, vti};
use lamina_field_expression::FieldExpression;
use lamina_model::{Invalid, Volume, Voxels};
use std::path::{Path, PathBuf};

/// A recorded time series, opened: its steps are known, their voxels are read on demand.
#[derive(Debug)]
pub struct Series {
    pub(crate) path: PathBuf,
    name: String,
    field: String,
    pub(crate) shown: FieldExpression,
    /// Of all scalars in a step's file.
    pub(crate) names: Vec<String>,
    missing: Option<f64>,
    steps: Vec<SeriesStep>,
    has_times: bool,
}

impl Series {
    /// Opens a collection, a file or store, or all that a pattern (`*` in the name) or a folder holds; the ending tells the format.
    ///
    /// # Errors
    /// If a file, or of a collection the first step's header, cannot be read, or a step's file is not there.
    pub fn open(path: &Path, options: &Options) -> Result<Self, ReadError> {
        let name = source::split_name(path).0;
        let (steps, has_times) = source::steps(path, options)?;
        let wanted = options.field.as_deref();
        let (field, shown, names) = match steps.first().map(|step| &step.source) {
            Some(SeriesSource::Vti(first)) => choose_in_vti(first, wanted)?,
            Some(SeriesSource::Arrays(first)) => choose_in_arrays(path, first.file()?.names(), wanted)?,
            _ => choose_single(path, wanted)?,
        };
        let raw = steps.iter().all(|step| matches!(step.source, SeriesSource::Raw(_)));
        if !raw && options.raw != RawSpec::default() {
            let remedy = "it tells its own: leave out --dims and --dtype";
            return Err(ReadError::unsupported(path, "a shape from outside", remedy));
        }
        Ok(Self { path: path.into(), name, field, shown, names, missing: options.missing, steps, has_times })
    }

    /// Number of steps, one or more.
    pub fn len(&self) -> usize {
        self.steps.len()
    }
    /// Never true: a series without a step is not opened.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }
    /// The file's name without its ending, fit to name a run.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// The name of the scalar, `scalar` where neither file nor options say, or the expression.
    pub fn field(&self) -> &str {
        &self.field
    }
    /// Whether the recording states times; else they are the steps' numbers.
    pub fn has_times(&self) -> bool {
        self.has_times
    }
    /// The time of step `index`, in the unit of the recording; times ascend.
    ///
    /// # Panics
    /// If there is no such step.
    pub fn time(&self, index: usize) -> f64 {
        self.steps[index].time
    }

    /// Reads the volume of step `index`.
    ///
    /// # Errors
    /// If there is no such step, or its file cannot be read.
    pub fn read(&self, index: usize) -> Result<Volume, ReadError> {
        self.evaluate(index, &self.shown)
    }

    /// What `expression` gives for step `index`.
    fn evaluate(&self, index: usize, expression: &FieldExpression) -> Result<Volume, ReadError> {
        if let Some(field) = expression.plain() {
            return self.read_array(index, field);
        }
        let (mut grid, mut fields) = (None, vec![None; self.names.len()]);
        for source in expression.sources() {
            let (of, voxels, _) = self.read_array(index, source)?.into_parts();
            if *grid.get_or_insert(of) != of {
                return Err(self.other_points(&self.names[source]));
            }
            fields[source] = Some(voxels);
        }
        let constant = || ReadError::unsupported(&self.path, "an expression without a field", "name one in it");
        let grid = grid.ok_or_else(constant)?;
        let values = expression.evaluate(&grid, &fields).map(Voxels::F32);
        values.and_then(|values| Volume::new(grid, values)).map_err(|e| ReadError::grid(&self.path, e))
    }

    /// The array of that place among the names, of step `index`.
    fn read_array(&self, index: usize, field: usize) -> Result<Volume, ReadError> {
        let volume = match &self.step(index)?.source {
            // By name, so that a series does not change its scalar where a step lists its arrays differently.
            SeriesSource::Vti(path) => vti::read(path, Some(&self.names[field])),
            SeriesSource::Nrrd(nrrd) => nrrd.read(),
            SeriesSource::Raw(raw) => raw.read(),
            SeriesSource::Arrays(arrays) => {
                let (file, name) = (arrays.file()?, &self.names[field]);
                let planes = 0..file.grid(name)?.dims()[2];
                file.read(arrays.step, name, planes)
            }
        }?;
        self.marked(volume)
    }

    pub(crate) fn step(&self, index: usize) -> Result<&SeriesStep, ReadError> {
        let last = self.steps.len().saturating_sub(1);
        self.steps.get(index).ok_or_else(|| ReadError::Step { path: self.path.clone(), index, last })
    }

    /// `volume` without what stands for missing voxels.
    pub(crate) fn marked(&self, volume: Volume) -> Result<Volume, ReadError> {
        match self.missing {
            Some(value) => mark_missing(volume, &Meaning { missing: vec![value], ..Meaning::default() })
                .map_err(|e| ReadError::grid(&self.path, e)),
            None => Ok(volume),
        }
    }

    fn other_points(&self, name: &str) -> ReadError {
        let what = format!("array \"{name}\" on other points than those beside it");
        ReadError::unsupported(&self.path, what, "write all as point data, or all as cell data")
    }

    /// `volume`, which is step `index`, with the array `name` of the same file, or an expression, as its second field.
    ///
    /// # Errors
    /// If there is no such array, it lies on other points, or it cannot be read.
    pub fn with_color_field(&self, index: usize, name: &str, volume: Volume) -> Result<Volume, ReadError> {
        if name == self.field {
            let itself = volume.voxels().clone();
            return volume.with_color_field(name, itself).map_err(|e| ReadError::grid(&self.path, e));
        }
        let expression = match (expression(&self.path, name, &self.names), self.steps.get(index).map(|s| &s.source)) {
            (Err(_), Some(SeriesSource::Nrrd(_) | SeriesSource::Raw(_))) => {
                let what = format!("a second field, \"{name}\"");
                return Err(ReadError::unsupported(&self.path, what, "a .vti can hold several arrays"));
            }
            (expression, _) => expression?,
        };
        let second = self.evaluate(index, &expression)?;
        if second.grid() != volume.grid() {
            return Err(self.other_points(name));
        }
        volume.with_color_field(name, second.into_parts().1).map_err(|e| ReadError::grid(&self.path, e))
    }
}

fn expression(path: &Path, text: &str, names: &[String]) -> Result<FieldExpression, ReadError> {
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    let refused = |e: Invalid| ReadError::Field { path: path.into(), reason: e.reason, present: names.join(", ") };
    FieldExpression::new(text, &known).map_err(refused)
}

/// What is shown, and the names of the scalars that it may be made of.
type FieldChoice = (String, FieldExpression, Vec<String>);

fn choose_in_vti(path: &Path, wanted: Option<&str>) -> Result<FieldChoice, ReadError> {
    let names = vti::field_names(path)?;
    let field = match (vti::field_name(path, wanted), wanted) {
        // Not the name of an array: an expression, if it has the signs of one.
        (Err(ReadError::Field { .. }), Some(text)) if text.contains(['(', '+', '-', '*', '/', '^']) => text.to_owned(),
        (field, _) => field?,
    };
    let shown = expression(path, &field, &names)?;
    Ok((field, shown, names))
}

/// The same of a file of arrays, whose names may be paths: the last part is enough.
fn choose_in_arrays(path: &Path, names: Vec<String>, wanted: Option<&str>) -> Result<FieldChoice, ReadError> {
    let last = |name: &str| name.rsplit('/').next().map(str::to_owned);
    let found = match wanted {
        None => names.first(),
        Some(wanted) => {
            let whole = names.iter().find(|name| *name == wanted);
            whole.or_else(|| names.iter().find(|name| last(name).as_deref() == Some(wanted)))
        }
    };
    let field = found.cloned().or(wanted.map(str::to_owned)).unwrap_or_default();
    let shown = expression(path, &field, &names)?;
    Ok((field, shown, names))
}

/// The same of a file whose one array has no name.
fn choose_single(path: &Path, wanted: Option<&str>) -> Result<FieldChoice, ReadError> {
    let unnamed = vec![vti::UNNAMED_FIELD.to_owned()];
    let derived = wanted.and_then(|text| Some((text, expression(path, text, &unnamed).ok()?)));
    if let Some((text, shown)) = derived.filter(|(_, shown)| !shown.sources().is_empty()) {
        return Ok((text.to_owned(), shown, unnamed));
    }
    let names = vec![wanted.unwrap_or(vti::UNNAMED_FIELD).to_owned()];
    Ok((names[0].clone(), expression(path, &names[0], &names)?, names))
}
