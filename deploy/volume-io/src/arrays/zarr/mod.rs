//! Zarr stores in folders, versions 2 and 3 of the format.
//!
//! <https://zarr-specs.readthedocs.io/en/latest/>. The crate `zarrs` would read the same, but without its C libraries neither Blosc
//! nor Zstandard, in which Zarr packs by default, and with some fifty crates more.

mod chunks;
mod codecs;
mod metadata;

use super::coordinates::{Attributes, coordinates};
use super::described::{DescribedArray, GatheredFields};
use super::file::{ArrayFile, ArrayOptions, ArrayStore, MOST_POINTS};
use crate::ReadError;
use crate::vti::UNNAMED_FIELD;
use lamina_model::Voxels;
use metadata::{StoreNode, ZarrArray};
use serde_json::{Map, Value};
use std::collections::HashMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Folders within folders that are looked into, and arrays in all.
const DEEPEST: usize = 16;
const MOST_ARRAYS: usize = 10_000;

/// Opens a store: an array, or a group of arrays.
pub(super) fn open(path: &Path, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let system = |e| ReadError::while_reading(path, e);
    if !fs::metadata(path).map_err(system)?.is_dir() {
        return Err(ReadError::unsupported(path, "a Zarr store that is no folder", "unpack it into a folder"));
    }
    let mut found = Found::default();
    found.visit(path, "")?;
    if let (true, Some(error)) = (found.arrays.is_empty(), found.left_out) {
        return Err(error);
    }
    let found = found.arrays;
    let of_group = match StoreNode::read(path)? {
        Some(StoreNode::Group(attributes)) => attributes,
        Some(StoreNode::Array(_)) => Map::new(),
        None => {
            return Err(ReadError::damaged(path, "there is no Zarr metadata (zarr.json, .zgroup or .zarray) in it"));
        }
    };
    let places: HashMap<&str, usize> = found.iter().enumerate().map(|(n, (name, _))| (name.as_str(), n)).collect();
    let store = ZarrStore(found.iter().map(|(_, array)| array.clone()).collect());
    // The coordinates of an axis lie beside the array.
    let points = |of: &str, axis: &str| {
        let group = of.rfind('/').map_or("", |slash| &of[..=slash]);
        let key = *places.get(format!("{group}{axis}").as_str())?;
        let [length @ ..=MOST_POINTS] = store.0[key].shape[..] else { return None };
        let voxels = store.read(key, std::slice::from_ref(&(0..length))).ok()?;
        Some(coordinates(&voxels, &store.0[key].attributes))
    };
    let mut fields = GatheredFields::default();
    for (key, (name, array)) in found.iter().enumerate() {
        let stored = DescribedArray {
            name: name.clone(),
            key,
            shape: array.shape.clone(),
            width: array.scalar.size_bytes() as u8,
            axes: array.axes.clone(),
            attributes: &array.attributes,
        };
        fields.add(stored, options.axes, |axis| points(name, axis));
    }
    fields.into_file(path, Some(&of_group), store)
}

/// What lies in a store.
#[derive(Default)]
struct Found {
    /// Arrays by their paths; that of a store which is one array is `scalar`.
    arrays: Vec<(String, ZarrArray)>,
    /// Why the last one of those that cannot be read cannot: a group may hold words and dates, too.
    left_out: Option<ReadError>,
}

impl Found {
    /// All arrays in a folder.
    fn visit(&mut self, folder: &Path, prefix: &str) -> Result<(), ReadError> {
        let system = |e| ReadError::while_reading(folder, e);
        match StoreNode::read(folder) {
            Ok(Some(StoreNode::Array(array))) => {
                let name = prefix.trim_end_matches('/');
                self.arrays.push((if name.is_empty() { UNNAMED_FIELD } else { name }.to_owned(), *array));
                if self.arrays.len() > MOST_ARRAYS {
                    let what = format!("a store of more than {MOST_ARRAYS} arrays");
                    return Err(ReadError::unsupported(folder, what, "open the group that is to be seen"));
                }
            }
            Ok(Some(StoreNode::Group(_))) if prefix.matches('/').count() < DEEPEST => {
                let mut folders: Vec<PathBuf> =
                    fs::read_dir(folder).map_err(system)?.flatten().map(|e| e.path()).filter(|p| p.is_dir()).collect();
                folders.sort();
                for inner in folders {
                    let Some(name) = inner.file_name().and_then(|name| name.to_str()) else { continue };
                    self.visit(&inner, &format!("{prefix}{name}/"))?;
                }
            }
            Ok(_) => (),
            Err(error @ ReadError::Unsupported { .. }) => self.left_out = Some(error),
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

impl Attributes for Map<String, Value> {
    fn text(&self, name: &str) -> Option<String> {
        self.get(name)?.as_str().map(str::to_owned)
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        match self.get(name) {
            Some(Value::Array(values)) => values.iter().filter_map(metadata::number).collect(),
            Some(Value::String(word)) if name == "_FillValue" => metadata::packed_double(word).into_iter().collect(),
            Some(value) => metadata::number(value).into_iter().collect(),
            None => Vec::new(),
        }
    }
}

#[derive(Debug)]
struct ZarrStore(Vec<ZarrArray>);

impl ArrayStore for ZarrStore {
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        chunks::read(&self.0[key], region)
    }
}
