//! VTKHDF image data, of one step or several. The format: <https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html>.

use super::datasets::{Datasets, attribute_numbers, failed, numbers, shape, width};
use crate::ReadError;
use crate::arrays::axes::AxisRole;
use crate::arrays::coordinates::Placement;
use crate::arrays::file::{ArrayFile, FieldArray};
use crate::missing::Meaning;
use hdf5_reader::group::Group;
use std::path::Path;

/// Opens the group `VTKHDF` of a file.
pub(super) fn open(path: &Path, group: &Group) -> Result<ArrayFile, ReadError> {
    let failed = |error| failed(path, "VTKHDF", error);
    let kind = group.attribute("Type").and_then(|kind| kind.read_string()).map_err(failed)?;
    if kind.trim_end_matches('\0') != "ImageData" {
        let remedy = "ImageData is understood: resample it, such as by vtkResampleToImage";
        return Err(ReadError::unsupported(path, format!("a VTKHDF {kind}"), remedy));
    }
    let three = |name: &str| -> Result<[f64; 3], ReadError> {
        let numbers = group.attribute(name).map(|attribute| attribute_numbers(&attribute)).map_err(failed)?;
        let wrong = |v: Vec<f64>| ReadError::damaged(path, format!("VTKHDF: {name} has {} numbers, not 3", v.len()));
        numbers.try_into().map_err(wrong)
    };
    let (spacing, origin) = (three("Spacing")?, three("Origin")?);
    let extent = group.attribute("WholeExtent").map(|extent| attribute_numbers(&extent)).map_err(failed)?;
    let Ok(extent) = <[f64; 6]>::try_from(extent) else {
        return Err(ReadError::damaged(path, "VTKHDF: WholeExtent has not 6 numbers"));
    };
    let direction = group.attribute("Direction").map(|attribute| attribute_numbers(&attribute)).unwrap_or_default();
    if !direction.is_empty() && direction != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
        return Err(ReadError::unsupported(path, format!("Direction {direction:?}"), "write it without rotation"));
    }
    let (mut fields, mut datasets) = (Vec::new(), Vec::new());
    for (data, of_cells) in [("PointData", false), ("CellData", true)] {
        let Ok(of_data) = group.group(data) else { continue };
        // Of a cell the value lies in its middle.
        let middle = if of_cells { 0.5 } else { 0.0 };
        let place = |a: usize| Placement::even_from(origin[a] + (extent[2 * a] + middle) * spacing[a], spacing[a]);
        let placement = [0, 1, 2].map(place);
        let points = [4, 2, 0].map(|a| (extent[a + 1] - extent[a]) + if of_cells { 0.0 } else { 1.0 });
        for dataset in of_data.datasets().map_err(failed)? {
            let Some(shape) = shape(&dataset).filter(|_| width(dataset.dtype()).is_some()) else { continue };
            let is_on_points = |of: &[usize]| of.len() == 3 && of.iter().zip(points).all(|(&n, of)| n as f64 == of);
            let space = [AxisRole::Z, AxisRole::Y, AxisRole::X];
            // Steps lie one behind the other; the components of a vector beside each other.
            let (steps, rest) = match shape.split_first() {
                Some((_, rest)) if !is_on_points(&shape) && rest.len() >= 3 && is_on_points(&rest[..3]) => (1, rest),
                _ => (0, &shape[..]),
            };
            let is_vector = rest.len() == 4 && rest[3] == 3 && is_on_points(&rest[..3]);
            if !is_vector && !is_on_points(rest) {
                continue;
            }
            let components = [AxisRole::Index(0)];
            let roles = [&[AxisRole::Time][..steps], &space, &components[..usize::from(is_vector)]].concat();
            let (name, key, meaning) = (dataset.name().to_owned(), datasets.len(), Meaning::default());
            let field = FieldArray { name, key, shape: shape.clone(), roles, placement, meaning };
            match is_vector {
                true => fields.extend(field.components(shape.len() - 1)),
                false => fields.push(field),
            }
            datasets.push(dataset);
        }
    }
    let times = group.group("Steps").and_then(|steps| steps.dataset("Values")).ok().and_then(|values| numbers(&values));
    ArrayFile::new(path, times, fields, Datasets { path: path.into(), datasets })
}
