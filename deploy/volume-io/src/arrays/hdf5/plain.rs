//! Arrays of any names, and netCDF-4, which names the axes of its arrays by their coordinates.

use super::datasets::{Datasets, failed, numbers, shape, width};
use crate::ReadError;
use crate::arrays::described::{DescribedArray, GatheredFields};
use crate::arrays::file::{ArrayFile, ArrayOptions};
use hdf5_reader::Dataset;
use hdf5_reader::group::Group;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Groups within groups that are looked into, and arrays in all: a file may hold circles of links.
const DEEPEST: usize = 32;
const MOST_ARRAYS: usize = 10_000;

/// Opens a file by its root.
pub(super) fn open(path: &Path, root: &Group, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let mut found = Vec::new();
    visit(path, root, "", &mut HashSet::new(), &mut found)?;
    let scales: HashMap<u64, String> = found.iter().map(|(name, dataset)| (dataset.address(), name.clone())).collect();
    let points = |of: &str| {
        let (_, dataset) = found.iter().find(|(name, _)| name == of)?;
        // Of a dimension without coordinates netCDF keeps an array without meaning.
        let says_nothing = dataset.attribute("NAME").and_then(|a| a.read_string());
        if says_nothing.is_ok_and(|text| text.starts_with("This is a netCDF dimension but not a netCDF variable")) {
            return None;
        }
        numbers(dataset)
    };
    let mut fields = GatheredFields::default();
    for (key, (name, dataset)) in found.iter().enumerate() {
        let (Some(shape), Some(width)) = (shape(dataset), width(dataset.dtype())) else { continue };
        let axes = dimension_scales(dataset, &scales);
        // A scale goes by its whole name, of which the last part says what it is.
        let short = axes.as_ref().map(|axes| axes.iter().map(|name| last_part(name).to_owned()).collect());
        let whole = |short: &str| axes.as_ref()?.iter().find(|name| last_part(name) == short);
        let stored = DescribedArray { name: name.clone(), key, shape, width, axes: short, attributes: dataset };
        fields.add(stored, options.axes, |axis| points(whole(axis)?));
    }
    let datasets = found.into_iter().map(|(_, dataset)| dataset).collect();
    fields.into_file(path, Some(root), Datasets { path: path.into(), datasets })
}

fn last_part(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// All arrays under `group`, by their paths without the first slash.
fn visit(
    path: &Path,
    group: &Group,
    prefix: &str,
    seen: &mut HashSet<u64>,
    found: &mut Vec<(String, Dataset)>,
) -> Result<(), ReadError> {
    if !seen.insert(group.address()) || prefix.matches('/').count() > DEEPEST {
        return Ok(());
    }
    let (groups, datasets) = group.members().map_err(|error| failed(path, prefix, error))?;
    found.extend(datasets.into_iter().map(|dataset| (format!("{prefix}{}", dataset.name()), dataset)));
    if found.len() > MOST_ARRAYS {
        let what = format!("a file of more than {MOST_ARRAYS} arrays");
        return Err(ReadError::unsupported(path, what, "copy those to be seen to a file of their own (h5copy)"));
    }
    groups.iter().try_for_each(|group| visit(path, group, &format!("{prefix}{}/", group.name()), seen, found))
}

/// Names of the axes by netCDF's convention: each refers to an array that is its scale.
fn dimension_scales(dataset: &Dataset, names: &HashMap<u64, String>) -> Option<Vec<String>> {
    let list = dataset.attribute("DIMENSION_LIST").ok()?;
    let references: Vec<&[u8]> = list.raw_data.chunks_exact(dataset.vlen_reference_size()).collect();
    let name = |reference: &&[u8]| {
        let bytes = dataset.resolve_vlen_reference_bytes(reference, size_of::<u64>()).ok()?;
        names.get(&u64::from_le_bytes(*bytes.first_chunk()?)).cloned()
    };
    let axes: Option<Vec<String>> = references.iter().map(name).collect();
    axes.filter(|axes| axes.len() == dataset.ndim())
}
