// Leaf functions of VDI rendering, without bindings. tests/leaf.rs compares each with Rust on boundary inputs.

// Farther than anything, and far from overflow.
const FAR: f32 = 1e30;
// A linear function that changes by less than this along a ray, in units of itself, counts as constant.
const PARALLEL_EPSILON: f32 = 1e-12;
// Optical depth beyond which the transmittance is 0 in single precision.
const OPAQUE: f32 = 80.0;
// A part of a ray whose ends differ by no more than this in steps, relative, counts as parallel to the depth planes.
const FLAT: f32 = 1e-6;

// Opacity of an optical depth: 1 - exp(-t). For small t by the Taylor series, whose next term is below 5e-8 of the value.
fn opacity(optical_depth: f32) -> f32 {
    let t = min(optical_depth, OPAQUE);
    if t < 0.25 {
        return t * (1.0 - t / 2.0 * (1.0 - t / 3.0 * (1.0 - t / 4.0 * (1.0 - t / 5.0 * (1.0 - t / 6.0)))));
    }
    return 1.0 - exp(-t);
}

// The part of `span` where a + b t >= 0; its end is before its start if it is empty.
fn cut(span: vec2f, a: f32, b: f32) -> vec2f {
    if abs(b) < PARALLEL_EPSILON {
        if a < 0.0 {
            return vec2f(FAR, -FAR);
        }
        return span;
    }
    let t = -a / b;
    if b > 0.0 {
        return vec2f(max(span.x, t), span.y);
    }
    return vec2f(span.x, min(span.y, t));
}

// The depth bin at a position on the scale of bins.
fn bin(place: f32) -> u32 {
    return u32(clamp(place, 0.0, 63.0));
}

// The bits of bins `a` to `b`; the lower word first.
fn bits(a: u32, b: u32) -> vec2u {
    const ALL = 0xffffffffu;
    let from_a = select(vec2u(0u, ALL << (a & 31u)), vec2u(ALL << (a & 31u), ALL), a < 32u);
    let to_b = select(vec2u(ALL, ALL >> (31u - (b & 31u))), vec2u(ALL >> (31u - (b & 31u)), 0u), b < 32u);
    return from_a & to_b;
}

// Share of the ray's length, between absolute depths z0 and z1, in front of position `mu` (perspective-correct).
fn way(mu: f32, z0: f32, z1: f32) -> f32 {
    return min(mu * z0 / (z1 * (1.0 - mu) + z0 * mu), 1.0);
}

// Reciprocal of the change of a column or row; finite for no change.
fn per_change(change: f32) -> f32 {
    if abs(change) < 1.0 / FAR {
        return FAR;
    }
    return 1.0 / change;
}

// One axis of a walk over the tiles of one level.
struct AxisWalk {
    cell: i32,
    step: i32,
    // Last tile of the walk.
    last: i32,
    // Next boundary, in pixels.
    boundary: f32,
    boundary_step: f32,
    start: f32,
    per_change: f32,
    // Position mu of the next boundary.
    next: f32,
}

fn boundary_mu(axis: AxisWalk, boundary: f32) -> f32 {
    return (boundary - axis.start) * axis.per_change;
}

// The axis at position `mu`, between tiles `lo` and `hi`. A boundary at `mu` itself counts as crossed.
fn axis_at(start: f32, change: f32, per_change: f32, shift: u32, mu: f32, lo: i32, hi: i32) -> AxisWalk {
    let forward = change >= 0.0;
    let place = i32(start + change * mu) >> shift;
    let step = select(-1, 1, forward);
    let first = select(hi, lo, forward);
    let last = select(lo, hi, forward);
    let cell = clamp(place, lo, hi);
    let boundary = f32((cell + i32(forward)) << shift);
    let boundary_step = f32(step * (1 << shift));
    var axis = AxisWalk(cell, step, last, boundary, boundary_step, start, per_change, 0.0);
    axis.next = boundary_mu(axis, boundary);
    // Correct for rounding, so that the boundaries' mu decide.
    while axis.next <= mu && axis.cell != last {
        axis = advanced(axis);
    }
    while axis.cell != first && boundary_mu(axis, axis.boundary - boundary_step) > mu {
        axis.cell -= step;
        axis.boundary -= boundary_step;
        axis.next = boundary_mu(axis, axis.boundary);
    }
    return axis;
}

fn advanced(before: AxisWalk) -> AxisWalk {
    var axis = before;
    axis.cell += axis.step;
    axis.boundary += axis.boundary_step;
    axis.next = boundary_mu(axis, axis.boundary);
    return axis;
}

// Share of a supersegment in the part of a ray from step `near` to step `far`; 0 or 1 along a depth plane.
fn share(start: f32, end: f32, near: f32, far: f32) -> f32 {
    if far - near <= FLAT * abs(far) {
        return select(0.0, 1.0, start <= near && near < end);
    }
    return max(min(end, far) - max(start, near), 0.0) / (far - near);
}
