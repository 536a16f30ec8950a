//! The only crate that opens a GPU device.
