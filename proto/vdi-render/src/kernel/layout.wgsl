// Uniforms and storage elements, laid out as the structs of layout.rs, member by member.

// The VDI. Depths count from a plane through the middle of the stored depths, so that they stay as small as the volume
// however far the generation camera is.
struct StoredVdi {
    // Columns and rows of the occupied rectangle.
    size: vec2u,
    // Offsets of the masks of tiles of 8 x 8 and of 32 x 32 pixels.
    first_masks: vec2u,
    // Absolute depth of the plane that depths count from.
    depth: f32,
    // Depth at which bin 0 begins.
    far: f32,
    // Depth bins per inverse depth, divided by the absolute depth at which bin 0 begins.
    depth_bins: f32,
    // Rounding error of positions on the scale of depth bins, in bins.
    margin: f32,
}

// A function that is linear along every ray and in the picture's columns and rows: at distance t on the ray through (x, y) it
// is (1, x, y) . start + t (1, x, y) . change.
struct LinearForm {
    start: vec3f,
    pad0: f32,
    change: vec3f,
    pad1: f32,
}

// Rays of a picture. Columns and rows x and y are counted in half pixels from the center; distances t are depths of the
// picture's camera, from a plane through the middle of the box.
struct ViewUniforms {
    // Homogeneous image positions: column and row times depth, and depth.
    column: LinearForm,
    row: LinearForm,
    depth: LinearForm,
    // Clip planes: the VDI is visible only where all of them are at least 0.
    planes: array<LinearForm, 12>,
    background: vec3f,
    // A ray ends below this transmittance.
    floor: f32,
    width: u32,
    height: u32,
    // Distance t of the eye.
    eye: f32,
    // Tangent of half a pixel's angle.
    slope: f32,
    // Step lengths per distance on the central ray.
    steps: f32,
    // Weight of the difference in cubic pictures.
    sharpness: f32,
    // Displacements of the inner and the outer ring, in pixels of the VDI.
    inner: vec2f,
    outer: vec2f,
    // By how far displaced lines may reach into the occupied rectangle from outside, pixels; 0: nearest rays.
    margin: f32,
    pad0: u32,
}

// The pixels that a dispatch colors.
struct PictureUniforms {
    // First row of a band of rows; 0 for a list of pixels.
    first: u32,
    // Number of rows, or of pixels.
    count: u32,
    pad0: vec2u,
}

// Conversion of depth to steps on one pixel's ray, `scale * depth - offset`, up to `last`; and the index of the first
// supersegment of its list, which ends where the next one begins.
struct DepthSteps {
    scale: f32,
    offset: f32,
    last: f32,
    first: u32,
}
