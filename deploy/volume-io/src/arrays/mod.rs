//! Files and stores of named arrays: HDF5, netCDF, Zarr, TIFF and plotfiles, each of which lists its fields and reads parts of them.

mod axes;
mod coordinates;
mod described;
mod file;
mod hdf5;
mod netcdf;
mod plotfile;
mod tiff;
mod zarr;

use crate::ReadError;
pub use axes::AxisOrder;
pub(crate) use file::{ArrayFile, ArrayOptions};
pub(crate) use plotfile::is_plotfile;
use std::path::Path;

/// Opens what has one of these endings, or is a folder of this kind; none for what is neither.
pub(crate) fn open(path: &Path, ending: &str, options: ArrayOptions) -> Option<Result<ArrayFile, ReadError>> {
    Some(match ending {
        "h5" | "hdf5" | "hdf" | "vtkhdf" => hdf5::open(path, options),
        "nc" | "nc4" | "cdf" => netcdf::open(path, options),
        "zarr" => zarr::open(path, options),
        "tif" | "tiff" => tiff::open(path, options),
        _ if is_plotfile(path) => plotfile::open(path, options),
        _ => return None,
    })
}
