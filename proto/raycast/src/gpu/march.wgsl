// The one loop that samples the field along a ray; raycast and generate differ only in what they do with a sample.
// Twin of scalar/march.rs.

// How voxels are stored: 0 whole numbers, 1 half precision, 2 single precision. All come as bits, so that "not a number"
// is told by whole-number comparisons, which no driver may optimise away as it may x != x.
override KIND: u32 = 0u;
// Whether the scene asks for any effect.
override EFFECTS: bool = false;

@group(0) @binding(0) var<uniform> volume: Volume;
@group(0) @binding(1) var<uniform> view: View;
@group(0) @binding(2) var voxels: texture_3d<u32>;
// Four distances a word.
@group(0) @binding(3) var<storage, read> distances: array<u32>;
// TransferTable::step, and TransferTable::unit as two rows an entry.
@group(0) @binding(4) var<storage, read> step_rows: array<vec4f>;
@group(0) @binding(5) var<storage, read> unit_rows: array<vec4f>;

// A ray inside the box: distances count steps.
struct Span {
    entry: vec3f,
    delta: vec3f,
    length: f32,
    steps: u32,
    // Steps from the eye to the entry, less those to the plane that rays start on along the camera's axis.
    beyond: f32,
}

fn span_of(i: u32, j: u32) -> Span {
    let x = f32(2u * i + 1u) - f32(view.width);
    let y = f32(view.height) - f32(2u * j + 1u);
    let origin = view.base + x * view.base_right + y * view.base_up;
    let square = view.slope * view.slope * (x * x + y * y);
    let depth = sqrt(1.0 + square);
    let delta = (view.forward + x * view.right + y * view.up) / depth;
    let t = clip(origin, delta, volume.low, volume.high);
    let length = t.y - t.x;
    if length <= 0.0 {
        return Span(vec3f(0.0), delta, 0.0, 0u, 0.0);
    }
    let entry = clamp(origin + t.x * delta, volume.low, volume.high);
    return Span(entry, delta, length, steps(length), view.near * (square / (depth + 1.0)) + t.x);
}

// True if double precision may count fewer steps on this ray, or none: its last step is hardly there, its steps are more
// than single precision can tell apart, or it grazes a side of the box.
fn is_unsure(span: Span) -> bool {
    let middle = span.entry + 0.5 * span.length * span.delta;
    let inside = min(middle - volume.low, volume.high - middle);
    return span.length - f32(span.steps - 1u) < 0.05 || span.steps > (1u << 17u)
        || min(min(inside.x, inside.y), inside.z) < 0.01;
}

// How far a march has come.
struct Walk {
    // The next step to look at.
    next: u32,
    // Before this step samples lie in a visible brick.
    visible: u32,
}

struct Sample {
    // Steps from the ray's entry into the box; the number of steps if there are no more samples.
    step: u32,
    // 1, or the rest at the ray's end.
    length: f32,
    row: Row,
    // The position in the range; without it, if a voxel there is not a number.
    value: f32,
    there: bool,
}

// The next sample that may show something.
fn next_sample(span: Span, walk: ptr<function, Walk>) -> Sample {
    while (*walk).next < span.steps {
        let step = (*walk).next;
        let length = min(span.length - f32(step), 1.0);
        let index = span.entry + (f32(step) + 0.5 * length) * span.delta;
        if step >= (*walk).visible {
            let brick = brick_at(index, volume.bricks);
            let distance = distance_at(brick);
            let beyond = step + jump(index, span.delta, brick, max(distance, 1u), volume.bricks);
            if distance > 0u {
                (*walk).next = beyond;
                continue;
            }
            (*walk).visible = beyond;
        }
        (*walk).next = step + 1u;
        var u = 0.0;
        let there = value_at(index, &u);
        if EFFECTS || (there && u >= view.visible.x && u <= view.visible.y) {
            return Sample(step, length, row_at(u, view.bins, view.below), u, there);
        }
    }
    return Sample(span.steps, 0.0, Row(0u, 0.0), 0.0, false);
}

fn distance_at(brick: vec3u) -> u32 {
    let n = (brick.z * volume.bricks.y + brick.y) * volume.bricks.x + brick.x;
    return extractBits(distances[n / 4u], 8u * (n % 4u), 8u);
}

// The position in the range at `index`; false if a voxel that it depends on is not a number.
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
fn step_row(row: Row) -> vec4f {
    let a = step_rows[row.index];
    return a + row.weight * (step_rows[row.index + 1u] - a);
}

// The same of one unit length.
fn unit_row(row: Row) -> vec4f {
    let a = unit_rows[2u * row.index];
    return a + row.weight * (unit_rows[2u * row.index + 2u] - a);
}

// Optical depth of one step, and the ratio of its opacity to that of a unit length.
fn depth_row(row: Row) -> vec2f {
    let a = unit_rows[2u * row.index + 1u].xy;
    return a + row.weight * (unit_rows[2u * row.index + 3u].xy - a);
}
