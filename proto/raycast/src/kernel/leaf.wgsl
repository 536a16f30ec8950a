// Leaf functions of ray casting, without bindings. tests/leaf.rs compares each with Rust on boundary inputs.

// Cells per side of a brick; occupancy::BRICK.
const BRICK: u32 = 4u;
// A remainder of a ray below this share of a step is rounding, not a step. The host counts steps in double precision, with
// 1e-9; lists that reach one step further than it counts are cut there.
const MIN_REMAINDER: f32 = 1e-4;
// Below this speed along an axis, in sample points per step, a ray counts as parallel: over the most steps that a ray may
// have, single precision does not resolve the displacement.
const PARALLEL_EPSILON: f32 = 1e-12;
// Longer than any ray, and far from overflow.
const FAR: f32 = 1e30;

// Opacity of an optical depth: 1 - exp(-t). For small t by the Taylor series, whose next term is below 5e-8 of the value.
fn opacity_from_optical_depth(t: f32) -> f32 {
    if t < 0.25 {
        return t * (1.0 - t / 2.0 * (1.0 - t / 3.0 * (1.0 - t / 4.0 * (1.0 - t / 5.0 * (1.0 - t / 6.0)))));
    }
    return 1.0 - exp(-t);
}

// Entry and exit of a ray into the box, the entry not before its origin; the exit is not above the entry if it misses.
fn clip(origin: vec3f, direction: vec3f, low: vec3f, high: vec3f) -> vec2f {
    var t_in = 0.0;
    var t_out = FAR;
    for (var axis = 0; axis < 3; axis++) {
        let o = origin[axis];
        let d = direction[axis];
        if abs(d) < PARALLEL_EPSILON {
            if o < low[axis] || o > high[axis] {
                return vec2f(0.0);
            }
            continue;
        }
        let a = (low[axis] - o) / d;
        let b = (high[axis] - o) / d;
        t_in = max(t_in, min(a, b));
        t_out = min(t_out, max(a, b));
    }
    return vec2f(t_in, t_out);
}

// Number of steps that cover `length` (in steps): full ones, and a shorter last one for a remainder.
fn steps(length: f32) -> u32 {
    return u32(max(ceil(length - MIN_REMAINDER), 0.0));
}

struct TableRow {
    index: u32,
    weight: f32,
}

// Table row at or below position `u`, and the weight of the next one; `below` rows precede that of position 0.
fn row_at(u: f32, bins: u32, below: u32) -> TableRow {
    let x = max(clamp(u, -1.0, 1.0) * f32(bins) + f32(below), 0.0);
    let index = min(u32(x), bins + below - 1u);
    return TableRow(index, x - f32(index));
}

struct Cell {
    base: vec3u,
    weight: vec3f,
}

// The cell that contains `index`, and the weights of its far corners.
fn cell_at(index: vec3f, last: vec3u) -> Cell {
    let x = max(index, vec3f(0.0));
    let base = min(vec3u(x), max(last, vec3u(1u)) - 1u);
    return Cell(base, min(x - vec3f(base), vec3f(1.0)));
}

// The brick that contains `index`.
fn brick_at(index: vec3f, bricks: vec3u) -> vec3u {
    return min(vec3u(max(index, vec3f(0.0))) / BRICK, bricks - 1u);
}

// Number of steps, one or more, from `index` to the first sample outside of the cube of all bricks nearer than `distance` (1
// or more). Bricks at the edge of the map extend to infinity.
fn jump(index: vec3f, delta: vec3f, brick: vec3u, distance: u32, bricks: vec3u) -> u32 {
    var t = 1e9;
    for (var axis = 0; axis < 3; axis++) {
        let d = delta[axis];
        if d > PARALLEL_EPSILON && brick[axis] + distance < bricks[axis] {
            t = min(t, (f32((brick[axis] + distance) * BRICK) - index[axis]) / d);
        }
        if d < -PARALLEL_EPSILON && brick[axis] >= distance {
            t = min(t, (f32((brick[axis] + 1u - distance) * BRICK) - index[axis]) / d);
        }
    }
    return u32(max(ceil(t), 1.0));
}
