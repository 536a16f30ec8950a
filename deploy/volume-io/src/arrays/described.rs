//! An array as a file describes it, by names of axes, coordinates and attributes, as a field: by the conventions of climate and forecast
//! files (CF), <https://cfconventions.org/cf-conventions/cf-conventions.html>, sections 2.5.1 (missing data) and 8.1 (packed data),
//! and by netCDF's attribute `_Unsigned`.

use super::axes::{self, AxisOrder, AxisRole};
use super::coordinates::{Attributes, Placement, stated_time};
use super::file::{ArrayFile, ArrayStore, FieldArray};
use crate::ReadError;
use crate::missing::Meaning;
use std::path::Path;

/// What is said of an array.
pub(super) struct DescribedArray<'a> {
    pub(super) name: String,
    pub(super) key: usize,
    pub(super) shape: Vec<usize>,
    /// Bytes of a value.
    pub(super) width: u8,
    /// Names of the axes.
    pub(super) axes: Option<Vec<String>>,
    pub(super) attributes: &'a dyn Attributes,
}

impl DescribedArray<'_> {
    /// The fields that it holds, one, or the components of a vector: `coordinate` gives the points of a named axis.
    fn fields(self, order: AxisOrder, coordinate: impl Fn(&str) -> Option<Vec<f64>>) -> Vec<FieldArray> {
        let Some((roles, components)) = axes::roles(&self.shape, self.axes.as_deref(), order) else {
            return Vec::new();
        };
        let spacing = self.attributes.numbers("spacing");
        let space = [AxisRole::X, AxisRole::Y, AxisRole::Z];
        let placement = space.map(|axis| {
            let at = roles.iter().position(|&role| role == axis).unwrap_or(0);
            let points = self.axes.as_ref().and_then(|names| coordinate(&names[at]));
            match points.filter(|points| points.len() == self.shape[at]) {
                Some(points) => Placement::of(&points),
                // In the order of storage, as the axes are.
                None if spacing.len() == 3 => {
                    Placement::even_from(0.0, spacing[roles[..at].iter().filter(|role| space.contains(role)).count()])
                }
                None => Placement::UNIT,
            }
        });
        let mut missing: Vec<f64> =
            ["_FillValue", "missing_value"].iter().flat_map(|name| self.attributes.numbers(name)).collect();
        missing.dedup();
        let is_unsigned = self.attributes.text("_Unsigned").is_some_and(|text| text.eq_ignore_ascii_case("true"));
        let unsigned = is_unsigned.then(|| f64::from(8 * self.width).exp2());
        let meaning = Meaning { missing, packing: self.attributes.packing(), unsigned };
        let (name, key, shape) = (self.name, self.key, self.shape);
        let field = FieldArray { name, key, shape, roles, placement, meaning };
        match components {
            Some(at) => field.components(at),
            None => vec![field],
        }
    }
}

/// The fields of a file's arrays, and the times of its steps.
#[derive(Default)]
pub(super) struct GatheredFields {
    fields: Vec<FieldArray>,
    /// The points of the first array's axis of time.
    times: Option<Vec<f64>>,
    /// The time that an array states.
    stated: Option<f64>,
}

impl GatheredFields {
    /// Takes in an array, if it is a field; `coordinate` gives the points of a named axis.
    pub(super) fn add(
        &mut self,
        array: DescribedArray<'_>,
        order: AxisOrder,
        coordinate: impl Fn(&str) -> Option<Vec<f64>>,
    ) {
        let time = array.axes.iter().flatten().find(|name| axes::is_time(name)).cloned();
        let attributes = array.attributes;
        let fields = array.fields(order, &coordinate);
        if !fields.is_empty() {
            self.fields.extend(fields);
            self.times = self.times.take().or_else(|| coordinate(&time?));
            self.stated = self.stated.or_else(|| stated_time(attributes));
        }
    }

    /// The file of these fields, whose own `attributes` may state its time.
    pub(super) fn into_file(
        self,
        path: &Path,
        attributes: Option<&dyn Attributes>,
        store: impl ArrayStore + 'static,
    ) -> Result<ArrayFile, ReadError> {
        let stated = || self.stated.or_else(|| stated_time(attributes?)).map(|time| vec![time]);
        let times = self.times.or_else(stated);
        ArrayFile::new(path, times, self.fields, store)
    }
}
