// What the host tells the kernels; twins of the structs in layout.rs, member by member.

// A VDI as uploaded. Depths count from a plane through the middle of what is stored, so that their numbers are as small
// as the volume however far the generation camera is.
struct Stored {
    // Columns and rows of the occupied rectangle.
    size: vec2u,
    // Where the masks of tiles of 8 x 8 and 32 x 32 pixels begin.
    first_masks: vec2u,
    // Depth of the plane that depths count from.
    depth: f32,
    // Where slab 0 begins.
    far: f32,
    // Slabs per inverse depth, divided by the absolute depth where slab 0 begins.
    slabs: f32,
    // Slabs by which places may be off.
    margin: f32,
}

// A number that is linear along every ray and in the picture's columns and rows: at distance t on the ray through (x, y) it
// is (1, x, y) . start + t (1, x, y) . change.
struct Form {
    start: vec3f,
    pad0: f32,
    change: vec3f,
    pad1: f32,
}

// Rays of a picture. Columns and rows x and y are counted in half pixels from the centre; distances t are depths of the
// picture's camera, from a plane through the middle of the box.
struct View {
    // Homogeneous image positions: column and row times depth, depth.
    column: Form,
    row: Form,
    depth: Form,
    // Where all of them are at least 0 the VDI may show something.
    planes: array<Form, 12>,
    background: vec3f,
    // A ray ends below this transmittance.
    floor: f32,
    width: u32,
    height: u32,
    // Distance of the eye.
    eye: f32,
    // Tangent of half a pixel's angle.
    slope: f32,
    // Step lengths per distance on the ray through the centre.
    steps: f32,
    pad0: u32,
    pad1: vec2u,
}

// Which pixels of a picture a dispatch colours.
struct Picture {
    // First row of a band of rows, or first place in the list of pixels.
    first: u32,
    // Rows, or pixels.
    count: u32,
    pad0: vec2u,
}

// How depth becomes steps on one pixel's ray, `scale * depth - offset`, up to `last`; and where its list begins. It ends
// where the next span's begins.
struct Span {
    scale: f32,
    offset: f32,
    last: f32,
    first: u32,
}
