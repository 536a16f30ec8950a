//! A volume as rays are cast through it: its voxels, where it can be seen, and what its transfer function and effects make of it.

pub mod color_channel;
pub mod downsample;
pub mod effects;
pub mod field;
pub mod light_volume;
pub mod occupancy;
pub mod transfer_lut;
