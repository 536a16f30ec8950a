//! What the host tells the kernels; twins of the structs in layout.wgsl, member by member (tests/layout.rs compares them); so
//! is `Span` of [`crate::simd`].

use bytemuck::{Pod, Zeroable};

/// Planes that a ray is clipped to: six of the box, four sides of the occupied rectangle, two of depth.
pub const PLANES: usize = 12;

/// A VDI as uploaded.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Stored {
    pub size: [u32; 2],
    pub first_masks: [u32; 2],
    pub depth: f32,
    pub far: f32,
    pub slabs: f32,
    pub margin: f32,
}

/// A number linear along every ray and in the picture's columns and rows.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Form {
    pub start: [f32; 3],
    pub pad0: f32,
    pub change: [f32; 3],
    pub pad1: f32,
}

/// Rays of a picture.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct View {
    pub column: Form,
    pub row: Form,
    pub depth: Form,
    pub planes: [Form; PLANES],
    pub background: [f32; 3],
    pub floor: f32,
    pub width: u32,
    pub height: u32,
    pub eye: f32,
    pub slope: f32,
    pub steps: f32,
    pub pad0: u32,
    pub pad1: [u32; 2],
}

/// Which pixels of a picture a dispatch colours.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Picture {
    pub first: u32,
    pub count: u32,
    pub pad0: [u32; 2],
}
