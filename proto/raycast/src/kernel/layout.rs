//! Uniforms and storage elements, laid out as the structs of layout.wgsl, member by member (gpu/tests/layout.rs compares them).

use bytemuck::{Pod, Zeroable};

/// The field.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct VolumeUniforms {
    pub last: [u32; 3],
    pub pad0: u32,
    pub bricks: [u32; 3],
    pub pad1: u32,
    pub low: [f32; 3],
    pub scale: f32,
    pub high: [f32; 3],
    pub offset: f32,
}

/// Rays of a picture or VDI.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ViewUniforms {
    pub base: [f32; 3],
    pub width: u32,
    pub base_right: [f32; 3],
    pub height: u32,
    pub base_up: [f32; 3],
    pub slope: f32,
    pub forward: [f32; 3],
    pub unit_steps: f32,
    pub right: [f32; 3],
    pub bins: u32,
    pub up: [f32; 3],
    pub below: u32,
    pub visible: [f32; 2],
    pub near: f32,
    pub pad0: u32,
}

/// Effects of the scene.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct EffectUniforms {
    pub light: [f32; 3],
    pub shadows: f32,
    pub spacing: [f32; 3],
    pub occlusion: f32,
    pub gradient: [f32; 3],
    pub ambient: f32,
    pub light_scale: [f32; 3],
    pub diffuse: f32,
    pub light_offset: [f32; 3],
    pub pad0: u32,
    pub light_dims: [u32; 3],
    pub specular: f32,
    pub cue: [f32; 3],
    pub cue_from: f32,
    pub cue_per_step: f32,
    pub cue_strength: f32,
    pub planes: u32,
    pub color_points: u32,
    pub before: [f32; 4],
    pub beyond: [f32; 4],
    pub levels: [[f32; 4]; 4],
    pub surfaces: [[f32; 4]; 4],
    pub half_spaces: [[f32; 4]; 14],
    pub color_map: [[f32; 4]; 16],
}

/// The pixels that a dispatch colors.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct PictureUniforms {
    pub background: [f32; 3],
    pub floor: f32,
    pub first: u32,
    pub count: u32,
    pub pad0: [u32; 2],
}

/// The rays that a dispatch clusters, and the parameters.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ClusteringUniforms {
    pub gamma: f32,
    pub cutoff: f32,
    pub first_row: u32,
    pub rows: u32,
    pub first_ray: u32,
    pub end_ray: u32,
    pub first_segment: u32,
    pub writing: u32,
}

/// A supersegment as kernels write it; the last one of a ray may carry [`UNSURE`] in its end.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct GpuSegment {
    pub start: u32,
    pub end: u32,
    pub red: f32,
    pub green: f32,
    pub blue: f32,
    pub optical_depth: f32,
}

/// One level of a prefix sum.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ScanUniforms {
    pub count: u32,
    pub blocks: u32,
    pub pad0: [u32; 2],
}

/// Marks the last supersegment of a ray for which double precision may count another number of steps.
pub(crate) const UNSURE: u32 = 1 << 31;
