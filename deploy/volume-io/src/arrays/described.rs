//! An array as a file describes it, by names of axes, coordinates and attributes, as a field: by the conventions of climate and forecast
//! files (CF), <https://cfconventions.org/cf-conventions/cf-conventions.html>, sections 2.5.1 (missing data) and 8.1 (packed data).

use super::axes::{self, AxisOrder, AxisRole};
use super::coordinates::{Attributes, Placement};
use super::file::FieldArray;
use crate::missing::Packing;

/// What is said of an array.
pub(super) struct DescribedArray<'a> {
    pub(super) name: String,
    pub(super) key: usize,
    pub(super) shape: Vec<usize>,
    /// Names of the axes.
    pub(super) axes: Option<Vec<String>>,
    pub(super) attributes: &'a dyn Attributes,
}

impl DescribedArray<'_> {
    /// The field that it is, if it is one: `coordinate` gives the points of a named axis.
    pub(super) fn field(self, order: AxisOrder, coordinate: impl Fn(&str) -> Option<Vec<f64>>) -> Option<FieldArray> {
        let roles = axes::roles(&self.shape, self.axes.as_deref(), order)?;
        let spacing = self.attributes.numbers("spacing");
        let placement = [AxisRole::X, AxisRole::Y, AxisRole::Z].map(|axis| {
            let at = roles.iter().position(|&role| role == axis).unwrap_or(0);
            let points = self.axes.as_ref().and_then(|names| coordinate(&names[at]));
            match points.filter(|points| points.len() == self.shape[at]) {
                Some(points) => Placement::of(&points),
                // In the order of storage, as the axes are.
                None if spacing.len() == 3 && roles.len() >= 3 => {
                    let of_space = (at + 3).saturating_sub(roles.len());
                    Placement::even_from(0.0, spacing.get(of_space).copied().unwrap_or(1.0))
                }
                None => Placement::UNIT,
            }
        });
        let packing = Packing::new(self.attributes.number("scale_factor"), self.attributes.number("add_offset"));
        let mut missing: Vec<f64> =
            ["_FillValue", "missing_value"].iter().flat_map(|name| self.attributes.numbers(name)).collect();
        missing.dedup();
        Some(FieldArray { name: self.name, key: self.key, shape: self.shape, roles, placement, missing, packing })
    }
}
