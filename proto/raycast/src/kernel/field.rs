//! A field as kernels read it: voxels as raw bits, the empty-space map, and tables of the transfer function.

use super::layout::VolumeUniforms;
use crate::Field;
use crate::volume::stored::StoredVoxels;
use crate::volume::transfer_lut::TransferLut;
use half::slice::HalfFloatSliceExt;
use lamina_compute::kernel::TexelFormat;

/// Storage of voxels; the shader's KIND.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum VoxelKind {
    Whole,
    Half,
    Single,
}

/// What the view uniforms state of the transfer function's tables for one step length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TableFacts {
    /// World units.
    pub step_length: f64,
    /// Bins of the range, and rows before it.
    pub bins: u32,
    pub below: u32,
    /// Positions between which the function is not transparent.
    pub visible: [f32; 2],
}

/// The tables of the transfer function for `step_length`.
pub(crate) fn tables(field: &Field, step_length: f64) -> (TableFacts, TransferLut) {
    let table = TransferLut::new(&field.scene().transfer, field.unit_length(), step_length);
    // Shaders may not support infinity.
    let visible = field.scene().transfer.visible_hull().map(|u| u.clamp(f32::MIN, f32::MAX));
    (TableFacts { step_length, bins: table.bins() as u32, below: table.below, visible }, table)
}

/// Sample points along x, y and z.
pub(crate) fn dims(field: &Field) -> [u32; 3] {
    field.grid().dims().map(|d| d as u32)
}

/// The voxels as they are stored.
pub(crate) fn voxels_of(field: &Field) -> (VoxelKind, TexelFormat, &[u8]) {
    match field.stored() {
        StoredVoxels::U8(v) => (VoxelKind::Whole, TexelFormat::R8Uint, v),
        StoredVoxels::U16(v) => (VoxelKind::Whole, TexelFormat::R16Uint, bytemuck::cast_slice(v)),
        StoredVoxels::F16(v) => (VoxelKind::Half, TexelFormat::R16Uint, bytemuck::cast_slice(v.reinterpret_cast())),
        StoredVoxels::F32(v) => (VoxelKind::Single, TexelFormat::R32Uint, bytemuck::cast_slice(v)),
    }
}

/// The empty-space map, four distances per word.
pub(crate) fn distances(field: &Field) -> Vec<u8> {
    let mut distances = field.empty_space().distances().to_vec();
    distances.resize(distances.len().next_multiple_of(4), 0);
    distances
}

/// Dimensions and values of the color field; one point if there is none.
pub(crate) fn colors(field: &Field) -> ([u32; 3], std::borrow::Cow<'_, [f32]>) {
    match field.effects().and_then(|e| e.colors.as_ref()) {
        None => ([1; 3], vec![0.0].into()),
        Some(colors) => (dims(field), (&colors.units[..]).into()),
    }
}

/// The field's geometry, and the range of its values.
pub(crate) fn volume(field: &Field) -> VolumeUniforms {
    let dims = field.grid().dims();
    // As Grid::bounds: an axis with one sample point is drawn one spacing thick.
    let low = dims.map(|d| if d == 1 { -0.5 } else { 0.0 });
    let high = dims.map(|d| if d == 1 { 0.5 } else { (d - 1) as f32 });
    let (scale, offset) = field.unit_from_stored();
    VolumeUniforms {
        last: dims.map(|d| (d - 1) as u32),
        pad0: 0,
        bricks: field.empty_space().dims().map(|d| d as u32),
        pad1: 0,
        low,
        scale: scale as f32,
        high,
        offset: offset as f32,
    }
}
