// Uniforms and storage elements, laid out as the structs of layout.rs, member by member.

// The field.
struct VolumeUniforms {
    // Last sample point per axis.
    last: vec3u,
    pad0: u32,
    // Bricks per axis.
    bricks: vec3u,
    pad1: u32,
    // Corners of the box in units of sample points; position in the range = scale * stored + offset.
    low: vec3f,
    scale: f32,
    high: vec3f,
    offset: f32,
}

// Rays of a picture or VDI. Directions are displacements, in units of sample points, along one sampling step. Rays start on
// the plane through the box's nearest corner, so that coordinates stay as small as the box however far the eye is.
struct ViewUniforms {
    base: vec3f,
    width: u32,
    // Change of the start with a pixel's column and row, counted in half pixels from the center.
    base_right: vec3f,
    height: u32,
    base_up: vec3f,
    // Tangent of half a pixel's angle.
    slope: f32,
    forward: vec3f,
    // Number of steps in the length that opacities refer to.
    unit_steps: f32,
    right: vec3f,
    // Bins of the transfer function's table.
    bins: u32,
    up: vec3f,
    // Rows of the table before that of position 0.
    below: u32,
    // Positions of the range between which the function is not transparent.
    visible: vec2f,
    // Steps from the eye to the plane on which rays start.
    near: f32,
    pad0: u32,
}

// Effects of the scene; counterpart of volume/effects.rs. Lengths in steps, positions in sample points.
struct EffectUniforms {
    // Unit vector towards the light.
    light: vec3f,
    shadows: f32,
    // World length between sample points, in voxel lengths.
    spacing: vec3f,
    occlusion: f32,
    // Factors from differences over two voxels to the gradient in shares of the range per voxel length.
    gradient: vec3f,
    ambient: f32,
    // Scale, then offset, from sample points to points of the light volume.
    light_scale: vec3f,
    diffuse: f32,
    light_offset: vec3f,
    pad0: u32,
    light_dims: vec3u,
    specular: f32,
    cue: vec3f,
    // Steps from where the depth cue begins to the plane on which rays start.
    cue_from: f32,
    cue_per_step: f32,
    cue_strength: f32,
    planes: u32,
    // Number of control points of the color field's map.
    color_points: u32,
    // Integrand of the pre-integration below and above the range.
    before: vec4f,
    beyond: vec4f,
    // Level in x.
    levels: array<vec4f, 4>,
    // Color, and optical depth in w.
    surfaces: array<vec4f, 4>,
    // Normal, and offset in w.
    half_spaces: array<vec4f, 14>,
    // Color, and position in w.
    color_map: array<vec4f, 16>,
}

// The pixels that a dispatch colors.
struct PictureUniforms {
    background: vec3f,
    // A ray ends below this transmittance.
    floor: f32,
    // First row of a band of rows; 0 for a list of pixels.
    first: u32,
    // Number of rows, or of pixels.
    count: u32,
    pad0: vec2u,
}

// The rays that a dispatch clusters, and the parameters.
struct ClusteringUniforms {
    gamma: f32,
    // A ray ends at this optical depth.
    cutoff: f32,
    // First row of the band.
    first_row: u32,
    // Rows of the band.
    rows: u32,
    // Rays of the band whose lists are written; the dispatch starts at the first row among them.
    first_ray: u32,
    end_ray: u32,
    // Offset of the first of them in the band's lists.
    first_segment: u32,
    // 0: count; 1: write.
    writing: u32,
}

// A supersegment as kernels write it; the last one of a ray may carry UNSURE in its end.
struct GpuSegment {
    start: u32,
    end: u32,
    red: f32,
    green: f32,
    blue: f32,
    optical_depth: f32,
}

// One level of a prefix sum.
struct ScanUniforms {
    count: u32,
    blocks: u32,
    pad0: vec2u,
}
