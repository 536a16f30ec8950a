//! Volumes prepared for ray casting: stored voxels, interpolation, empty space, transfer function tables, light, effects.

pub mod color_channel;
pub mod downsample;
pub mod effects;
pub mod field;
pub mod interpolate;
pub mod light_volume;
pub mod occupancy;
pub mod stored;
pub mod transfer_lut;
