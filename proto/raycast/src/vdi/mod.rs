//! A VDI as rays make it: samples become supersegments, and rows of them one image.

pub mod assemble;
pub mod segmentation;
