//! Readers of recorded volumes and time series, and the writers with which the project records its own; the reader of recorded steps.
//!
//! Understood are ParaView collections (`.pvd`) of VTK image data (`.vti`), NRRD (`.nrrd`, `.nhdr`), raw arrays (`.raw`, `.raw.gz`),
//! HDF5 (VTKHDF, openPMD, netCDF-4 and plain), classic netCDF, Zarr stores, TIFF stacks and AMReX plotfiles. A file is untrusted input: whatever a header claims is held against the size of the file before
//! memory is set aside, and every way to be wrong ends in a [`ReadError`]. Nothing here knows of rendering or the wire.

mod arrays;
mod ascii;
mod base64_text;
mod blosc;
mod error;
mod lzf;
mod missing;
mod nrrd;
mod nrrd_axes;
mod nrrd_header;
mod options;
mod planes;
mod pvd;
mod raw;
mod recorded;
mod scalars;
mod series;
mod source;
mod unpack;
mod vti;
mod vti_blocks;
mod vti_header;
mod write;
mod write_vtkhdf;
mod xml;

pub use arrays::AxisOrder;
pub use error::ReadError;
pub use options::Options;
pub use raw::RawSpec;
pub use recorded::{read_recorded, read_with_bytes};
pub use series::Series;
pub use write::{write_pvd, write_vti};
pub use write_vtkhdf::write_vtkhdf;
