//! Where the steps of a series lie: in one file, in those that a collection lists, or in all that a pattern or a folder names.

use crate::arrays::{self, ArrayFile, ArrayOptions};
use crate::nrrd::Nrrd;
use crate::pvd::read_collection;
use crate::raw::RawFile;
use crate::{Options, ReadError};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug)]
pub(crate) struct SeriesStep {
    pub(crate) time: f64,
    pub(crate) source: SeriesSource,
}

#[derive(Debug)]
pub(crate) enum SeriesSource {
    Vti(PathBuf),
    Nrrd(Box<Nrrd>),
    Raw(RawFile),
    Arrays(ArrayStep),
}

/// A step of a file of arrays.
#[derive(Debug)]
pub(crate) struct ArrayStep {
    path: PathBuf,
    options: ArrayOptions,
    /// Within the file.
    pub(crate) step: usize,
    /// Of a file alone; those of a pattern are opened when they are read, as they may be more than a process can have open.
    open: Option<Arc<ArrayFile>>,
}

impl ArrayStep {
    /// The file.
    pub(crate) fn file(&self) -> Result<Arc<ArrayFile>, ReadError> {
        match &self.open {
            Some(file) => Ok(Arc::clone(file)),
            None => open_arrays(&self.path, self.options).map(Arc::new),
        }
    }
}

fn open_arrays(path: &Path, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let ending = split_name(path).1;
    arrays::kind(path, &ending).ok_or_else(|| ReadError::Extension { path: path.into() })?(path, options)
}

/// The steps at `path`, one or more, and whether their times are stated there.
pub(crate) fn steps(path: &Path, options: &Options) -> Result<(Vec<SeriesStep>, bool), ReadError> {
    if split_name(path).1 == "pvd" {
        return Ok((open_collection(path)?, true));
    }
    let Some(files) = members(path)? else { return of_file(path, options, true) };
    let (mut steps, mut states_times) = (Vec::new(), true);
    for file in &files {
        let (of_file, has_times) = of_file(file, options, false)?;
        states_times &= has_times;
        steps.extend(of_file);
    }
    // Names may have fractions in them, of which files are sorted otherwise than their times.
    if states_times {
        steps.sort_by(|a, b| a.time.total_cmp(&b.time));
    }
    // Times of files that start anew, or state none, are the steps' numbers.
    states_times &= steps.windows(2).all(|pair: &[SeriesStep]| pair[0].time < pair[1].time);
    if !states_times {
        steps.iter_mut().enumerate().for_each(|(n, step)| step.time = n as f64);
    }
    Ok((steps, states_times))
}

/// The steps of one file, and whether it states their times.
fn of_file(path: &Path, options: &Options, is_alone: bool) -> Result<(Vec<SeriesStep>, bool), ReadError> {
    let single = |source| (vec![SeriesStep { time: 0.0, source }], false);
    Ok(match split_name(path).1.as_str() {
        "vti" => {
            // One that is missing is reported before a long run starts, not in its middle.
            fs::metadata(path).map_err(|e| ReadError::while_reading(path, e))?;
            single(SeriesSource::Vti(path.into()))
        }
        "nrrd" | "nhdr" => single(SeriesSource::Nrrd(Box::new(Nrrd::open(path)?))),
        "raw" | "raw.gz" => single(SeriesSource::Raw(RawFile::open(path, &options.raw)?)),
        _ => {
            let reading = ArrayOptions { axes: options.axes, level: options.level };
            let file = Arc::new(open_arrays(path, reading)?);
            let open = is_alone.then(|| Arc::clone(&file));
            let step = |(step, &time): (usize, &f64)| {
                let source = ArrayStep { path: path.into(), options: reading, step, open: open.clone() };
                SeriesStep { time, source: SeriesSource::Arrays(source) }
            };
            (file.times().iter().enumerate().map(step).collect(), file.has_times())
        }
    })
}

fn open_collection(path: &Path) -> Result<Vec<SeriesStep>, ReadError> {
    let entries = read_collection(path)?;
    for entry in &entries {
        if split_name(&entry.file).1 != "vti" {
            let what = format!("{} in a collection", entry.file.display());
            return Err(ReadError::unsupported(path, what, "convert the steps to .vti"));
        }
        fs::metadata(&entry.file).map_err(|e| ReadError::while_reading(&entry.file, e))?;
    }
    Ok(entries.into_iter().map(|e| SeriesStep { time: e.time, source: SeriesSource::Vti(e.file) }).collect())
}

/// The files that a pattern or a folder names, by the numbers in their names; none for what is one file or store.
fn members(path: &Path) -> Result<Option<Vec<PathBuf>>, ReadError> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let (folder, pattern) = match name.contains('*') && !path.exists() {
        true => (path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new(".")), name.as_str()),
        false if path.is_dir() && !is_recording(path) && split_name(path).1 != "vti" => (path, "*"),
        false => return Ok(None),
    };
    let entries = fs::read_dir(folder).map_err(|e| ReadError::while_reading(folder, e))?;
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .filter(|entry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            !name.starts_with('.') && matches_pattern(&name, pattern) && is_recording(&entry.path())
        })
        .map(|entry| entry.path())
        .collect();
    found.sort_by_cached_key(|file| numbered(file));
    if found.is_empty() {
        return Err(ReadError::Extension { path: path.into() });
    }
    Ok(Some(found))
}

/// Whether a file, store or folder is of a kind that is read.
fn is_recording(path: &Path) -> bool {
    let ending = split_name(path).1;
    let is_volume = ["vti", "nrrd", "nhdr", "raw", "raw.gz"].contains(&ending.as_str());
    match path.is_dir() {
        true => ending == "zarr" || arrays::is_plotfile(path),
        false => is_volume || (ending != "zarr" && arrays::kind(path, &ending).is_some()),
    }
}

/// Whether `*` in the pattern may stand for what the name has there.
fn matches_pattern(name: &str, pattern: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return name == pattern };
    let Some(mut name) = name.strip_prefix(start) else { return false };
    let parts: Vec<&str> = rest.split('*').collect();
    let Some((end, middle)) = parts.split_last() else { return true };
    for part in middle {
        match name.find(part) {
            Some(at) => name = &name[at + part.len()..],
            None => return false,
        }
    }
    name.len() >= end.len() && name.ends_with(end)
}

/// Order of files: by the numbers in their names, of any length, then by these.
fn numbered(path: &Path) -> (Vec<(usize, String)>, String) {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let runs = name.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
    let numbers =
        runs.map(|digits| digits.trim_start_matches('0')).map(|digits| (digits.len(), digits.to_owned())).collect();
    (numbers, name)
}

/// The name's stem and its lower-case ending; `.raw.gz` counts as one ending.
pub(crate) fn split_name(path: &Path) -> (String, String) {
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

    #[test]
    fn patterns_match_and_files_come_by_number() {
        assert!(matches_pattern("step_0010.h5", "step_*.h5") && matches_pattern("a.h5", "*"));
        assert!(matches_pattern("abcabc", "a*bc") && !matches_pattern("abcab", "a*bc"));
        assert!(!matches_pattern("step.h5", "step_*.h5") && !matches_pattern("aa", "a*aa"));
        let order = |a: &str, b: &str| numbered(Path::new(a)) < numbered(Path::new(b));
        assert!(order("x_9.h5", "x_10.h5") && order("plt00010", "plt00020"));
    }
}
