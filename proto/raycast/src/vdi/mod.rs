//! From samples to a VDI: segmentation of rays into supersegments, and assembly of rows.

pub(crate) mod assemble;
pub(crate) mod compositing;
pub(crate) mod segmentation;
