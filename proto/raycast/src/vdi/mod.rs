//! From samples to a VDI: segmentation of rays into supersegments, and assembly of rows.

pub mod assemble;
pub mod segmentation;
