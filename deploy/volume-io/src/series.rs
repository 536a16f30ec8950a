//! A recorded time series under one roof: whatever the format, numbered steps with a time and a volume each.

use crate::missing::mark_missing;
use crate::nrrd::Nrrd;
use crate::pvd::read_collection;
use crate::raw::{RawFile, RawSpec};
use crate::{ReadError, vti};
use lamina_field_expression::FieldExpression;
use lamina_model::{Invalid, Volume, Voxels};
use std::fs;
use std::path::{Path, PathBuf};

/// What a user may say about a file that the file does not, or not unambiguously.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// The shape of raw files; none for files that describe themselves.
    pub raw: RawSpec,
    /// The array to read where a file has several, or an expression over them ([`FieldExpression`]). Raw and NRRD files have a
    /// single, nameless one, which expressions call `scalar`: it takes any other name.
    pub field: Option<String>,
    /// The value that stands where a voxel is missing; NaN is missing in any case.
    pub missing: Option<f64>,
}

/// A recorded time series, opened: its steps are known, their voxels are read on demand.
#[derive(Debug)]
pub struct Series {
    pub(crate) path: PathBuf,
    name: String,
    field: String,
    pub(crate) shown: FieldExpression,
    /// Of all scalars in a step's file.
    names: Vec<String>,
    missing: Option<f64>,
    steps: Vec<SeriesStep>,
}

#[derive(Debug)]
pub(crate) struct SeriesStep {
    time: f64,
    pub(crate) source: SeriesSource,
}

#[derive(Debug)]
pub(crate) enum SeriesSource {
    Vti(PathBuf),
    Nrrd(Box<Nrrd>),
    Raw(RawFile),
}

impl Series {
    /// Opens a collection or a single file, which the ending tells. A single file is a series of one step at time 0.
    ///
    /// # Errors
    /// If the file, or of a collection the first step's header, cannot be read, or a step's file is not there.
    pub fn open(path: &Path, options: &Options) -> Result<Self, ReadError> {
        let (stem, ending) = split_name(path);
        let single = |source| vec![SeriesStep { time: 0.0, source }];
        let wanted = options.field.as_deref();
        let steps = match ending.as_str() {
            "pvd" => open_collection(path)?,
            "vti" => single(SeriesSource::Vti(path.into())),
            "nrrd" | "nhdr" => single(SeriesSource::Nrrd(Box::new(Nrrd::open(path)?))),
            "raw" | "raw.gz" => single(SeriesSource::Raw(RawFile::open(path, &options.raw)?)),
            _ => return Err(ReadError::Extension { path: path.into() }),
        };
        let (field, shown, names) = match steps.first().map(|step| &step.source) {
            Some(SeriesSource::Vti(first)) => choose_in_vti(first, wanted)?,
            _ => choose_single(path, wanted)?,
        };
        let raw = steps.iter().all(|step| matches!(step.source, SeriesSource::Raw(_)));
        if !raw && options.raw != RawSpec::default() {
            let remedy = "it tells its own: leave out --dims and --dtype";
            return Err(ReadError::unsupported(path, "a shape from outside", remedy));
        }
        Ok(Self { path: path.into(), name: stem, field, shown, names, missing: options.missing, steps })
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
            Some(value) => mark_missing(volume, value).map_err(|e| ReadError::grid(&self.path, e)),
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

fn open_collection(path: &Path) -> Result<Vec<SeriesStep>, ReadError> {
    let entries = read_collection(path)?;
    // A file that is missing is reported before a long run starts, not in its middle.
    for entry in &entries {
        if split_name(&entry.file).1 != "vti" {
            let what = format!("{} in a collection", entry.file.display());
            return Err(ReadError::unsupported(path, what, "convert the steps to .vti"));
        }
        fs::metadata(&entry.file).map_err(|e| ReadError::while_reading(&entry.file, e))?;
    }
    Ok(entries.into_iter().map(|e| SeriesStep { time: e.time, source: SeriesSource::Vti(e.file) }).collect())
}

/// The name's stem and its lower-case ending; `.raw.gz` counts as one ending.
fn split_name(path: &Path) -> (String, String) {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let lower = name.to_ascii_lowercase();
    let dot = if lower.ends_with(".raw.gz") { Some(name.len() - ".raw.gz".len()) } else { name.rfind('.') };
    match dot {
        Some(dot) => (name[..dot].to_owned(), lower[dot + 1..].to_owned()),
        None => (name, String::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_are_told_from_stems() {
        let split = |name: &str| split_name(Path::new(name));
        assert_eq!(split("a/run.1.PVD"), ("run.1".into(), "pvd".into()));
        assert_eq!(split("a/x_2x2x2_uint8.Raw.gz"), ("x_2x2x2_uint8".into(), "raw.gz".into()));
        assert_eq!(split("x.tar.gz"), ("x.tar".into(), "gz".into()));
        assert_eq!(split("a/none"), ("none".into(), String::new()));
        assert_eq!(split("/"), (String::new(), String::new()));
    }
}
