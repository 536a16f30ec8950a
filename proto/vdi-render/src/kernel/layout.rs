//! Uniforms and storage elements, laid out as the structs of layout.wgsl, member by member (gpu/tests/layout.rs compares them);
//! `DepthSteps` of [`crate::simd`] is one of them too.

use bytemuck::{Pod, Zeroable};

/// Planes that clip a ray: six of the box, four sides of the occupied rectangle, two of depth.
pub(crate) const PLANES: usize = 12;

/// The VDI.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct StoredVdi {
    pub size: [u32; 2],
    pub first_masks: [u32; 2],
    pub depth: f32,
    pub far: f32,
    pub depth_bins: f32,
    pub margin: f32,
}

/// A function that is linear along every ray and in the picture's columns and rows.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct LinearForm {
    pub start: [f32; 3],
    pub pad0: f32,
    pub change: [f32; 3],
    pub pad1: f32,
}

/// Rays of a picture.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ViewUniforms {
    pub column: LinearForm,
    pub row: LinearForm,
    pub depth: LinearForm,
    pub planes: [LinearForm; PLANES],
    pub background: [f32; 3],
    pub floor: f32,
    pub width: u32,
    pub height: u32,
    pub eye: f32,
    pub slope: f32,
    pub steps: f32,
    pub sharpness: f32,
    pub inner: [f32; 2],
    pub outer: [f32; 2],
    pub margin: f32,
    pub pad0: u32,
}

/// The pixels that a dispatch colors.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PictureUniforms {
    pub first: u32,
    pub count: u32,
    pub pad0: [u32; 2],
}
