//! What a file leaves open.

use crate::arrays::AxisOrder;
use crate::raw::RawSpec;

/// What a user may say about a file that the file does not, or not unambiguously.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// The shape of raw files; none for files that describe themselves.
    pub raw: RawSpec,
    /// The array to read where a file has several, or an expression over them ([`lamina_field_expression::FieldExpression`]). Raw and NRRD files have a
    /// single, nameless one, which expressions call `scalar`: it takes any other name.
    pub field: Option<String>,
    /// The value that stands where a voxel is missing; NaN is missing in any case.
    pub missing: Option<f64>,
    /// Order of the axes of arrays that do not name them.
    pub axes: AxisOrder,
    /// Of an adaptive mesh: the level whose cells are read; the finest, if none is stated.
    pub level: Option<usize>,
}
