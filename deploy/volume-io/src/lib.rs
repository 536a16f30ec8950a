//! Readers of recorded volumes and time series, and the writers with which the project records its own; the reader of recorded steps.
//!
//! Understood are ParaView collections (`.pvd`) of VTK image data (`.vti`), NRRD (`.nrrd`, `.nhdr`) and raw arrays
//! (`.raw`, `.raw.gz`). A file is untrusted input: whatever a header claims is held against the size of the file before
//! memory is set aside, and every way to be wrong ends in a [`ReadError`]. Nothing here knows of rendering or the wire.

mod ascii;
mod base64_text;
mod error;
mod missing;
mod nrrd;
mod nrrd_axes;
mod nrrd_header;
mod planes;
mod pvd;
mod raw;
mod recorded;
mod scalars;
mod series;
mod vti;
mod vti_blocks;
mod vti_header;
mod write;
mod xml;

pub use error::ReadError;
pub use raw::RawSpec;
pub use recorded::{read_recorded, read_with_bytes};
pub use series::{Options, Series};
pub use write::{write_pvd, write_vti};
