// What the host tells the kernels; twins of the structs in layout.rs, member by member.

// A field as uploaded.
struct Volume {
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

// Rays of a picture or VDI. Directions are displacements, in units of sample points, along one sampling step. Rays start
// on the plane through the box's nearest corner, so that their numbers are as small as the box however far the eye is.
struct View {
    base: vec3f,
    width: u32,
    // By how much the start moves with a pixel's column and row, counted in half pixels from the centre.
    base_right: vec3f,
    height: u32,
    base_up: vec3f,
    // Tangent of half a pixel's angle.
    slope: f32,
    forward: vec3f,
    // Steps in the length that opacities refer to.
    unit_steps: f32,
    right: vec3f,
    // Intervals of the transfer function's table.
    bins: u32,
    up: vec3f,
    // Rows of the table before that of position 0.
    below: u32,
    // Outside these positions of the range all is transparent.
    visible: vec2f,
    // Steps from the eye to the plane that rays start on.
    near: f32,
    pad0: u32,
}

// Effects; twin of effects.rs. Lengths in steps, positions in sample points.
struct Effects {
    // Unit vector towards the light.
    light: vec3f,
    shadows: f32,
    // World length between sample points, in voxel lengths.
    spacing: vec3f,
    occlusion: f32,
    // From differences over two voxels to shares of the range per voxel length.
    gradient: vec3f,
    ambient: f32,
    // From sample points to points of the light volume, by scale and then offset.
    light_scale: vec3f,
    diffuse: f32,
    light_offset: vec3f,
    pad0: u32,
    light_dims: vec3u,
    specular: f32,
    cue: vec3f,
    // Steps from where colours begin to fade to the plane that rays start on.
    cue_from: f32,
    cue_per_step: f32,
    cue_strength: f32,
    planes: u32,
    // Corners of the second field's map.
    color_points: u32,
    // Summands of the integral at both ends of the range.
    before: vec4f,
    beyond: vec4f,
    // Level in x.
    levels: array<vec4f, 4>,
    // Colour, and optical depth in w.
    surfaces: array<vec4f, 4>,
    // Normal, and offset in w.
    half_spaces: array<vec4f, 14>,
    // Colour, and position in w.
    color_map: array<vec4f, 16>,
}

// Which pixels of a picture a dispatch colours.
struct Picture {
    background: vec3f,
    // A ray ends below this transmittance.
    floor: f32,
    // First row of a band of rows, or first place in the list of pixels.
    first: u32,
    // Rows, or pixels.
    count: u32,
    pad0: vec2u,
}

// Which rays a dispatch clusters, and how.
struct Clustering {
    gamma: f32,
    // A ray ends at this optical depth.
    cutoff: f32,
    // First row of the band.
    first_row: u32,
    // Rows of the band.
    rows: u32,
    // Rays of the band whose lists are written; the first row among them is where the dispatch starts.
    first_ray: u32,
    end_ray: u32,
    // Where the first of them starts in the band's lists.
    first_segment: u32,
    // 0: count; 1: write.
    writing: u32,
}

// As written; the last one of a ray carries UNSURE in its end.
struct Segment {
    start: u32,
    end: u32,
    red: f32,
    green: f32,
    blue: f32,
    optical_depth: f32,
}

// One level of a prefix sum.
struct Scan {
    count: u32,
    blocks: u32,
    pad0: vec2u,
}
