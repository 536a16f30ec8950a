//! Volumes prepared for ray casting: stored voxels, interpolation, empty space, transfer function tables, light, effects.

pub(crate) mod color_channel;
pub(crate) mod downsample;
pub(crate) mod effects;
pub(crate) mod field;
pub(crate) mod interpolate;
pub(crate) mod light_volume;
pub(crate) mod occupancy;
pub(crate) mod part;
pub(crate) mod part_reduction;
pub(crate) mod part_sums;
mod resample;
pub(crate) mod stored;
pub(crate) mod transfer_lut;
