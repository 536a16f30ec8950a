//! openPMD in HDF5: meshes of the iterations of a file. The standard: <https://github.com/openPMD/openPMD-standard>, version 1.1.

use super::datasets::{Datasets, attribute_numbers, failed, shape, width};
use crate::ReadError;
use crate::arrays::axes::{AxisOrder, AxisRole};
use crate::arrays::coordinates::{Attributes, Placement};
use crate::arrays::file::{ArrayFile, ArrayOptions, ArrayStore, FieldArray};
use crate::missing::{Meaning, Packing};
use hdf5_reader::Dataset;
use hdf5_reader::group::Group;
use lamina_model::Voxels;
use std::ops::Range;
use std::path::Path;

/// Opens a file whose root says that it is one.
pub(super) fn open(path: &Path, root: &Group, version: String, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    if !version.starts_with("1.") {
        return Err(ReadError::unsupported(
            path,
            format!("openPMD {version}"),
            "write it by version 1 of the standard",
        ));
    }
    let failed = |error| failed(path, "openPMD", error);
    let text = |name: &str, usual: &str| {
        root.attribute(name).and_then(|a| a.read_string()).unwrap_or_else(|_| usual.to_owned())
    };
    let base = text("basePath", "/data/%T/");
    let folder = base.split("%T").next().unwrap_or_default().trim_matches('/').to_owned();
    let mut data = root.clone();
    for part in folder.split('/').filter(|part| !part.is_empty()) {
        data = data.group(part).map_err(failed)?;
    }
    let mut iterations: Vec<(u64, Group)> =
        data.groups().map_err(failed)?.into_iter().filter_map(|g| Some((g.name().parse().ok()?, g))).collect();
    iterations.sort_by_key(|(number, _)| *number);
    let (mut times, mut fields, mut steps) = (Vec::new(), Vec::new(), Vec::new());
    let meshes = text("meshesPath", "meshes/");
    for (_, iteration) in &iterations {
        let number = |name: &str| Attributes::number(iteration, name);
        let all = iteration.group(meshes.trim_matches('/')).map_err(failed)?;
        let found = components(path, &all, options.axes)?;
        if steps.is_empty() {
            fields = found.iter().map(|(field, _)| field.clone()).collect();
        }
        // By name: iterations may list them in different orders, or lack some.
        let of_step = |field: &FieldArray| {
            let (_, dataset) =
                found.iter().find(|(other, _)| other.name == field.name && other.shape == field.shape)?;
            Some(dataset.clone())
        };
        let datasets: Option<Vec<Dataset>> = fields.iter().map(of_step).collect();
        let other =
            || ReadError::damaged(path, "openPMD: an iteration of other meshes, units or spacing than the first");
        steps.push(datasets.ok_or_else(other)?);
        times.push(number("time").unwrap_or(times.len() as f64) * number("timeUnitSI").unwrap_or(1.0));
    }
    // Each iteration is an array of its own: they are read as the steps of one.
    for (key, field) in fields.iter_mut().enumerate() {
        field.key = key;
        field.shape.insert(0, steps.len());
        field.roles.insert(0, AxisRole::Time);
    }
    let steps = steps.into_iter().map(|datasets| Datasets { path: path.into(), datasets }).collect();
    ArrayFile::new(path, Some(times), fields, Iterations(steps))
}

/// Components of three axes of all meshes: `rho`, `E/x`.
fn components(path: &Path, meshes: &Group, order: AxisOrder) -> Result<Vec<(FieldArray, Dataset)>, ReadError> {
    let failed = |error| failed(path, meshes.name(), error);
    let (vectors, scalars) = meshes.members().map_err(failed)?;
    let mut found = Vec::new();
    let mut add = |mesh: &dyn Mesh, name: String, dataset: Dataset| {
        found.extend(field(mesh, name, &dataset, order).map(|field| (field, dataset)));
    };
    for scalar in scalars {
        add(&scalar, scalar.name().to_owned(), scalar.clone());
    }
    for vector in vectors {
        for component in vector.datasets().map_err(failed)? {
            add(&vector, format!("{}/{}", vector.name(), component.name()), component);
        }
    }
    Ok(found)
}

/// Attributes of a mesh: of a group, or of the array itself where it has one component.
trait Mesh: Attributes {
    fn words(&self, name: &str) -> Vec<String>;
}

impl Mesh for Dataset {
    fn words(&self, name: &str) -> Vec<String> {
        self.attribute(name).and_then(|a| a.read_strings()).unwrap_or_default()
    }
}

impl Mesh for Group {
    fn words(&self, name: &str) -> Vec<String> {
        self.attribute(name).and_then(|a| a.read_strings()).unwrap_or_default()
    }
}

fn field(mesh: &dyn Mesh, name: String, dataset: &Dataset, order: AxisOrder) -> Option<FieldArray> {
    let shape = shape(dataset).filter(|shape| shape.len() == 3 && width(dataset.dtype()).is_some())?;
    // Labels name the axes as they are stored, the slowest first.
    let mut roles = order.0.to_vec();
    if let Ok(labels) = mesh.words("axisLabels").concat().to_lowercase().parse::<AxisOrder>() {
        roles = labels.0.to_vec();
    }
    let numbers = |name: &str| Some(mesh.numbers(name)).filter(|numbers| numbers.len() == 3);
    let (spacing, offset) = (numbers("gridSpacing")?, numbers("gridGlobalOffset")?);
    let unit = mesh.number("gridUnitSI").unwrap_or(1.0);
    let within = dataset.attribute("position").map(|a| attribute_numbers(&a)).unwrap_or_default();
    let placement = [AxisRole::X, AxisRole::Y, AxisRole::Z].map(|axis| {
        let n = roles.iter().position(|&role| role == axis).unwrap_or(0);
        let position = within.get(n).copied().unwrap_or(0.0);
        Placement::even_from((offset[n] + position * spacing[n]) * unit, spacing[n] * unit)
    });
    // Data of Fortran's order is said to be stored the other way.
    if mesh.words("dataOrder").concat().starts_with('F') {
        roles.reverse();
    }
    let packing = Packing::new(Attributes::number(dataset, "unitSI"), None);
    Some(FieldArray { name, key: 0, shape, roles, placement, meaning: Meaning { packing, ..Meaning::default() } })
}

/// The arrays of each iteration.
#[derive(Debug)]
struct Iterations(Vec<Datasets>);

impl ArrayStore for Iterations {
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        self.0[region[0].start].read(key, &region[1..])
    }
}
