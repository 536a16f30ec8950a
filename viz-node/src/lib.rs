//! The viz-node: takes VDIs in, renders them from any camera, and reports their PSNR against reference samples.
//!
//! Subscribe -> store -> kernel -> view -> web. It never sees a voxel.

pub mod kernel;
