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

/// How a kind of file or store is opened.
pub(crate) type Open = fn(&Path, ArrayOptions) -> Result<ArrayFile, ReadError>;

/// How what has one of these endings, or is a folder of this kind, is opened; none for what is neither.
pub(crate) fn kind(path: &Path, ending: &str) -> Option<Open> {
    Some(match ending {
        "h5" | "hdf5" | "hdf" | "vtkhdf" => hdf5::open,
        "nc" | "nc4" | "cdf" => netcdf::open,
        "zarr" => zarr::open,
        "tif" | "tiff" => tiff::open,
        _ if is_plotfile(path) => plotfile::open,
        _ => return None,
    })
}
