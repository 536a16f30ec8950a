// Ray marching: samples the field along a ray. Ray casting and VDI generation differ only in what they do with a sample.
// Counterpart of reference/march.rs.

// Storage of voxels: 0 integers, 1 half precision, 2 single precision. All are loaded as bits, so that NaN is detected by
// integer comparisons, which no driver may optimize away as it may x != x.
override KIND: u32 = 0u;
// Whether the scene asks for any effect.
override EFFECTS: bool = false;

@group(0) @binding(0) var<uniform> volume: VolumeUniforms;
@group(0) @binding(1) var<uniform> view: ViewUniforms;
@group(0) @binding(2) var voxels: texture_3d<u32>;
// Four distances per word.
@group(0) @binding(3) var<storage, read> distances: array<u32>;
// TransferLut::step, and TransferLut::unit as two rows per entry.
@group(0) @binding(4) var<storage, read> step_rows: array<vec4f>;
@group(0) @binding(5) var<storage, read> unit_rows: array<vec4f>;

// The part of a ray inside the box; lengths in steps.
struct RaySpan {
    entry: vec3f,
    delta: vec3f,
    length: f32,
    steps: u32,
    // Steps from the eye to the entry, minus those to the plane on which rays start.
    beyond: f32,
}

// The part of the ray through pixel (`i`, `j`) inside the box.
fn ray_span(i: u32, j: u32) -> RaySpan {
    let x = f32(2u * i + 1u) - f32(view.width);
    let y = f32(view.height) - f32(2u * j + 1u);
    let origin = view.base + x * view.base_right + y * view.base_up;
    let square = view.slope * view.slope * (x * x + y * y);
    let depth = sqrt(1.0 + square);
    let delta = (view.forward + x * view.right + y * view.up) / depth;
    let t = clip(origin, delta, volume.low, volume.high);
    let length = t.y - t.x;
    if length <= 0.0 {
        return RaySpan(vec3f(0.0), delta, 0.0, 0u, 0.0);
    }
    let entry = clamp(origin + t.x * delta, volume.low, volume.high);
    return RaySpan(entry, delta, length, steps(length), view.near * (square / (depth + 1.0)) + t.x);
}

// True if double precision may count another number of steps on this ray, or none: its last step is nearly empty, it has
// more steps than single precision resolves, or it grazes a side of the box.
fn is_unsure(span: RaySpan) -> bool {
    let middle = span.entry + 0.5 * span.length * span.delta;
    let inside = min(middle - volume.low, volume.high - middle);
    return span.length - f32(span.steps - 1u) < 0.05 || span.steps > (1u << 17u)
        || min(min(inside.x, inside.y), inside.z) < 0.01;
}

// Progress of a march.
struct MarchState {
    // Index of the next step to sample.
    next: u32,
    // Samples before this step lie in a visible brick.
    visible: u32,
}

struct MarchSample {
    // Index of the step from the ray's entry into the box; the number of steps if there are no more samples.
    step: u32,
    // Length in steps: 1, or less at the ray's end.
    length: f32,
    row: TableRow,
    // Position in the range, and whether it is defined: false if a voxel of the cell is not finite.
    value: f32,
    there: bool,
}

// The next sample that may be visible.
fn next_sample(span: RaySpan, state: ptr<function, MarchState>) -> MarchSample {
    while (*state).next < span.steps {
        let step = (*state).next;
        let length = min(span.length - f32(step), 1.0);
        let index = span.entry + (f32(step) + 0.5 * length) * span.delta;
        // Skip empty bricks.
        if step >= (*state).visible {
            let brick = brick_at(index, volume.bricks);
            let distance = distance_at(brick);
            let beyond = step + jump(index, span.delta, brick, max(distance, 1u), volume.bricks);
            if distance > 0u {
                (*state).next = beyond;
                continue;
            }
            (*state).visible = beyond;
        }
        // Sample the field, unless it is transparent here.
        (*state).next = step + 1u;
        var u = 0.0;
        let there = value_at(index, &u);
        if EFFECTS || (there && u >= view.visible.x && u <= view.visible.y) {
            return MarchSample(step, length, row_at(u, view.bins, view.below), u, there);
        }
    }
    return MarchSample(span.steps, 0.0, TableRow(0u, 0.0), 0.0, false);
}

fn distance_at(brick: vec3u) -> u32 {
    let n = (brick.z * volume.bricks.y + brick.y) * volume.bricks.x + brick.x;
    return (distances[n / 4u] >> (8u * (n % 4u))) & 0xffu;
}

// Interpolates the position in the range at `index`; false if a voxel of the cell is not finite.
fn value_at(index: vec3f, u: ptr<function, f32>) -> bool {
    let cell = cell_at(index, volume.last);
    let a = cell.base;
    let b = min(a + 1u, volume.last);
    let v000 = textureLoad(voxels, vec3u(a.x, a.y, a.z), 0).x;
    let v100 = textureLoad(voxels, vec3u(b.x, a.y, a.z), 0).x;
    let v010 = textureLoad(voxels, vec3u(a.x, b.y, a.z), 0).x;
    let v110 = textureLoad(voxels, vec3u(b.x, b.y, a.z), 0).x;
    let v001 = textureLoad(voxels, vec3u(a.x, a.y, b.z), 0).x;
    let v101 = textureLoad(voxels, vec3u(b.x, a.y, b.z), 0).x;
    let v011 = textureLoad(voxels, vec3u(a.x, b.y, b.z), 0).x;
    let v111 = textureLoad(voxels, vec3u(b.x, b.y, b.z), 0).x;
    let empty = is_empty(v000) || is_empty(v100) || is_empty(v010) || is_empty(v110)
        || is_empty(v001) || is_empty(v101) || is_empty(v011) || is_empty(v111);
    if empty {
        return false;
    }
    let w = cell.weight;
    let low = lerp(lerp(scalar(v000), scalar(v100), w.x), lerp(scalar(v010), scalar(v110), w.x), w.y);
    let high = lerp(lerp(scalar(v001), scalar(v101), w.x), lerp(scalar(v011), scalar(v111), w.x), w.y);
    *u = volume.scale * lerp(low, high, w.z) + volume.offset;
    return true;
}

fn lerp(a: f32, b: f32, w: f32) -> f32 {
    return a + w * (b - a);
}

fn is_empty(bits: u32) -> bool {
    if KIND == 1u {
        return (bits & 0x7c00u) == 0x7c00u;
    }
    if KIND == 2u {
        return (bits & 0x7f800000u) == 0x7f800000u;
    }
    return false;
}

fn scalar(bits: u32) -> f32 {
    if KIND == 1u {
        return unpack2x16float(bits).x;
    }
    if KIND == 2u {
        // Far beyond either end of the range; keeps differences finite.
        return clamp(bitcast<f32>(bits), -1e37, 1e37);
    }
    return f32(bits);
}

// Red, green, blue and opacity of one whole step, premultiplied.
fn step_row(row: TableRow) -> vec4f {
    let a = step_rows[row.index];
    return a + row.weight * (step_rows[row.index + 1u] - a);
}

// Red, green, blue and opacity of one unit length, premultiplied.
fn unit_row(row: TableRow) -> vec4f {
    let a = unit_rows[2u * row.index];
    return a + row.weight * (unit_rows[2u * row.index + 2u] - a);
}

// Optical depth of one step, and the ratio of its opacity to that of a unit length.
fn depth_row(row: TableRow) -> vec2f {
    let a = unit_rows[2u * row.index + 1u].xy;
    return a + row.weight * (unit_rows[2u * row.index + 3u].xy - a);
}
