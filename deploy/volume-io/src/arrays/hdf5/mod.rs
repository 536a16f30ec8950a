//! HDF5: VTKHDF, openPMD, netCDF-4 and files of plain arrays. The format is read by `hdf5-reader`.

mod datasets;
mod filters;
mod openpmd;
mod plain;
mod vtkhdf;

use super::file::{ArrayFile, ArrayOptions};
use crate::ReadError;
use datasets::failed;
use hdf5_reader::storage::FileStorage;
use hdf5_reader::{Hdf5File, OpenOptions};
use std::path::Path;
use std::sync::Arc;

/// Opens a file.
pub(super) fn open(path: &Path, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let failed = |error| failed(path, "", error);
    // Its own errors of opening tell less than the system's.
    let file = std::fs::File::open(path).map_err(|e| ReadError::while_reading(path, e))?;
    let storage = FileStorage::from_file(file).map_err(failed)?;
    let reading = OpenOptions::default().with_filter_registry(filters::registry());
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), reading).map_err(failed)?;
    let root = file.root_group().map_err(failed)?;
    if let Ok(group) = root.group("VTKHDF") {
        return vtkhdf::open(path, &group);
    }
    if let Ok(version) = root.attribute("openPMD") {
        return openpmd::open(path, &root, version.read_string().unwrap_or_default(), options);
    }
    plain::open(path, &root, options)
}
