// One ray, clipped to where the VDI may be visible, as a straight line in the VDI's image; counterpart of simd/packet.rs.
//
// Between entry and exit, columns, rows and inverse depth are linear in mu in [0, 1].

@group(0) @binding(0) var<uniform> stored: StoredVdi;
@group(0) @binding(1) var<uniform> view: ViewUniforms;
// Index in `spans` per pixel of the occupied rectangle; entry 0 is for pixels without a list.
@group(0) @binding(2) var<storage, read> slots: array<u32>;
@group(0) @binding(3) var<storage, read> spans: array<DepthSteps>;
// Masks of pixels, then of tiles of both sizes; the lower word first.
@group(0) @binding(4) var<storage, read> masks: array<vec2u>;
// Start and end of supersegments, steps.
@group(0) @binding(5) var<storage, read> ends: array<vec2u>;
// Colors of supersegments, and optical depth per step.
@group(0) @binding(6) var<storage, read> contents: array<vec4f>;

struct ImageLine {
    // Column and row at mu = 0, their change to mu = 1, and its reciprocal.
    start: vec2f,
    change: vec2f,
    per_change: vec2f,
    // Depth at mu = 0, and its change to mu = 1.
    depth: f32,
    depth_change: f32,
    // Absolute depths at both ends.
    z0: f32,
    z1: f32,
    // Position on the scale of depth bins at mu = 0, its change, and its rounding error.
    bin: f32,
    bin_change: f32,
    margin: f32,
    // Length in step lengths; 0 or less if the ray misses the VDI.
    steps: f32,
    // The part, in mu, that lies in the occupied rectangle; empty if its end is before its start.
    visible: vec2f,
}

// The function at distance 0, and its change per distance.
fn form_at(form: LinearForm, place: vec3f) -> vec2f {
    return vec2f(dot(form.start, place), dot(form.change, place));
}

// The line of the ray through half pixel (`x`, `y`) from the center.
fn line_at(x: f32, y: f32) -> ImageLine {
    // Clip the ray by all planes.
    var line: ImageLine;
    let place = vec3f(1.0, x, y);
    var span = vec2f(view.eye, FAR);
    for (var n = 0; n < 12; n++) {
        let plane = form_at(view.planes[n], place);
        span = cut(span, plane.x, plane.y);
    }
    line.steps = 0.0;
    if !(span.x < span.y && span.y < FAR) {
        return line;
    }
    // Transform entry and exit to the VDI's image.
    let column = form_at(view.column, place);
    let row = form_at(view.row, place);
    let depth = form_at(view.depth, place);
    let a = vec3f(column.x + span.x * column.y, row.x + span.x * row.y, depth.x + span.x * depth.y);
    let b = vec3f(column.x + span.y * column.y, row.x + span.y * row.y, depth.x + span.y * depth.y);
    line.z0 = a.z + stored.depth;
    line.z1 = b.z + stored.depth;
    if !(line.z0 > 0.0 && line.z1 > 0.0) {
        return line;
    }
    // Clamp what rounding pushed over the edge of the rectangle.
    let low = vec2f(-view.margin);
    let rim = vec2f(stored.size) * (1.0 - 1.0 / 4194304.0) + view.margin;
    line.start = clamp(a.xy / line.z0, low, rim);
    line.change = clamp(b.xy / line.z1, low, rim) - line.start;
    line.visible = vec2f(0.0, 1.0);
    line.per_change = vec2f(per_change(line.change.x), per_change(line.change.y));
    line.depth = a.z;
    line.depth_change = b.z - a.z;
    line.bin = (stored.far - a.z) * stored.depth_bins / line.z0;
    line.bin_change = (stored.far - b.z) * stored.depth_bins / line.z1 - line.bin;
    // Near the generation camera bins are thinner than rounding errors.
    line.margin = stored.margin + 1e-6 * abs(line.bin_change);
    line.steps = (span.y - span.x) * view.steps * sqrt(1.0 + view.slope * view.slope * (x * x + y * y));
    return line;
}

// The line moved `by` in the VDI's image.
fn displaced(line: ImageLine, by: vec2f) -> ImageLine {
    var moved = line;
    moved.start = line.start + by;
    let a = (vec2f(0.0) - moved.start) * line.per_change;
    let b = (vec2f(stored.size) - moved.start) * line.per_change;
    let enter = min(a, b);
    let leave = max(a, b);
    moved.visible = vec2f(max(max(enter.x, enter.y), 0.0), min(min(leave.x, leave.y), 1.0));
    return moved;
}
