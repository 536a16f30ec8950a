// What a scene asks for. Twin of scalar/effects.rs; each effect is switched on when the kernel is compiled.

override CLIPPED: bool = false;
override PRE_INTEGRATED: bool = false;
override SURFACES: u32 = 0u;
override SHADED: bool = false;
// 2^SHININESS.
override SHININESS: u32 = 0u;
override SHADOWED: bool = false;
override OCCLUDED: bool = false;
override CUED: bool = false;
override COLORED: bool = false;

@group(2) @binding(0) var<uniform> effects: Effects;
// Integral::split: of a step's optical depth x (red, green, blue, 1) the sum, its rest and the next summand.
@group(2) @binding(1) var<storage, read> sums: array<vec4f>;
// LightVolume: transmittance of all points where there are shadows, then openness where there is occlusion.
@group(2) @binding(2) var<storage, read> light_volume: array<f32>;
// The second field: positions in the range of its map, single precision.
@group(2) @binding(3) var color_voxels: texture_3d<u32>;

// A step cut shorter than this share of itself is nothing; effects::SHORTEST.
const SHORTEST: f32 = 1e-4;
// effects::WEAK_GRADIENT and FEWEST_ROWS.
const WEAK_GRADIENT: f32 = 0.01;
const FEWEST_ROWS: f32 = 4.0;

struct Course {
    // Steps from the entry between which the ray is not clipped.
    kept: vec2f,
    // Unit vector halfway between light and eye.
    half: vec3f,
}

// A step with its effects: straight colour and optical depth; none if that is 0.
struct Look {
    color: vec3f,
    depth: f32,
    length: f32,
}

fn course_of(span: Span) -> Course {
    var kept = vec2f(0.0, span.length);
    if CLIPPED {
        for (var n = 0u; n < effects.planes; n++) {
            let plane = effects.half_spaces[n];
            let room = plane.w - dot(plane.xyz, span.entry);
            let speed = dot(plane.xyz, span.delta);
            if speed > 0.0 {
                kept.y = min(kept.y, room / speed);
            } else if speed < 0.0 {
                kept.x = max(kept.x, room / speed);
            } else if room < 0.0 {
                kept.y = kept.x;
            }
        }
        kept.y = max(kept.x, kept.y);
    }
    var half = vec3f(0.0);
    if SHADED {
        let sum = effects.light - normalize(span.delta * effects.spacing);
        let size = length(sum);
        half = select(vec3f(0.0), sum / size, size > 0.0);
    }
    return Course(kept, half);
}

fn look(span: Span, course: Course, s: Sample) -> Look {
    var first = f32(s.step);
    var last = min(first + 1.0, span.length);
    if CLIPPED {
        first = max(first, course.kept.x);
        last = min(last, course.kept.y);
    }
    let size = last - first;
    if size <= SHORTEST {
        return Look(vec3f(0.0), 0.0, 0.0);
    }
    let middle = 0.5 * (first + last);
    var u = s.value;
    var there = s.there;
    if CLIPPED {
        there = value_at(span.entry + middle * span.delta, &u);
    }
    var color = vec3f(0.0);
    var depth = 0.0;
    if there && u >= view.visible.x && u <= view.visible.y {
        let row = row_at(u, view.bins, view.below);
        let unit = unit_row(row);
        if unit.w > 0.0 {
            color = unit.xyz / unit.w;
            depth = depth_row(row).x * size;
        }
    }
    var low = 0.0;
    var high = 0.0;
    var whole = false;
    if PRE_INTEGRATED || SURFACES > 0u {
        let a = value_at(span.entry + first * span.delta, &low);
        let b = value_at(span.entry + last * span.delta, &high);
        whole = a && b;
    }
    if PRE_INTEGRATED {
        if whole && abs(high - low) * f32(view.bins) >= FEWEST_ROWS {
            let a = sum_at(low);
            let b = sum_at(high);
            // Behind an opaque part of the range a sum has no digits left for a faint one, but its rest has.
            let sum = (b.sum - a.sum) + (b.rest - a.rest) + (b.part - a.part);
            color = vec3f(0.0);
            if sum.w != 0.0 {
                color = clamp(sum.xyz / sum.w, vec3f(0.0), vec3f(1.0));
            }
            depth = max(sum.w / ((high - low) * f32(view.bins)) * size, 0.0);
        }
    }
    if depth > 0.0 {
        if COLORED {
            own_color(span.entry + middle * span.delta, &color);
        }
        color = seen(color, span, course, middle);
    }
    if SURFACES > 0u {
        if whole {
            return meet_surfaces(span, course, vec2f(first, size), vec2f(low, high), Look(color, depth, size));
        }
    }
    return Look(color, depth, size);
}

// The medium's colour at `index`, before light; it stays where a point around is not a number.
fn own_color(index: vec3f, color: ptr<function, vec3f>) {
    let cell = cell_at(index, volume.last);
    var u = 0.0;
    for (var n = 0u; n < 8u; n++) {
        let corner = vec3u(n & 1u, (n >> 1u) & 1u, n >> 2u);
        let bits = textureLoad(color_voxels, min(cell.base + corner, volume.last), 0).x;
        if (bits & 0x7f800000u) == 0x7f800000u {
            return;
        }
        let w = select(1.0 - cell.weight, cell.weight, corner == vec3u(1u));
        u += w.x * w.y * w.z * bitcast<f32>(bits);
    }
    var before = effects.color_map[0];
    var mapped = before.xyz;
    for (var n = 1u; n < effects.color_points; n++) {
        let next = effects.color_map[n];
        mapped += clamp((u - before.w) / (next.w - before.w), 0.0, 1.0) * (next.xyz - mapped);
        before = next;
    }
    *color = mapped;
}

// A sum in parts, of which the first may be great where the others are not.
struct Sum {
    sum: vec4f,
    rest: vec4f,
    part: vec4f,
}

// The sum up to position `u` of the range, which goes on as it ends outside of it.
fn sum_at(u: f32) -> Sum {
    let row = row_at(max(u, 0.0), view.bins, 0u);
    let n = 3u * row.index;
    let beyond = (u - clamp(u, 0.0, 1.0)) * f32(view.bins);
    let part = row.weight * sums[n + 2u] + beyond * select(effects.before, effects.beyond, u > 0.5);
    return Sum(sums[n], sums[n + 1u], part);
}

fn meet_surfaces(span: Span, course: Course, at: vec2f, ends: vec2f, medium: Look) -> Look {
    var sum = vec3f(0.0);
    var through = 1.0;
    var place = 0.0;
    var met = 0.0;
    for (var k = 0u; k < SURFACES; k++) {
        let n = select(k, SURFACES - 1u - k, ends.y < ends.x);
        let level = effects.levels[n].x;
        if !((ends.x < level && level <= ends.y) || (ends.y < level && level <= ends.x)) {
            continue;
        }
        let share = crossing(span, at, ends, level);
        let before = opacity_from_optical_depth(medium.depth * max(share - place, 0.0));
        sum += through * before * medium.color;
        through -= through * before;
        let surface = effects.surfaces[n];
        let hides = opacity_from_optical_depth(surface.w);
        sum += through * hides * seen(surface.xyz, span, course, at.x + share * at.y);
        through -= through * hides;
        place = max(place, share);
        met += surface.w;
    }
    if met == 0.0 {
        return medium;
    }
    let rest = opacity_from_optical_depth(medium.depth * (1.0 - place));
    sum += through * rest * medium.color;
    through -= through * rest;
    let all = opacity_from_optical_depth(medium.depth + met);
    return Look(min(sum / all, vec3f(1.0)), medium.depth + met, medium.length);
}

// Where a step crosses `level`, as a share of it: the first secant, and one on its better side.
fn crossing(span: Span, at: vec2f, ends: vec2f, level: f32) -> f32 {
    let first = (level - ends.x) / (ends.y - ends.x);
    var w = 0.0;
    if !value_at(span.entry + (at.x + first * at.y) * span.delta, &w) {
        return first;
    }
    let behind = (w < level) == (ends.x < level);
    let near = select(vec2f(0.0, ends.x), vec2f(first, w), behind);
    let far = select(vec2f(first, w), vec2f(1.0, ends.y), behind);
    if near.y == far.y {
        return first;
    }
    return clamp(near.x + (level - near.y) / (far.y - near.y) * (far.x - near.x), 0.0, 1.0);
}

// A straight colour as light and distance let it be seen `t` steps from the entry.
fn seen(straight: vec3f, span: Span, course: Course, t: f32) -> vec3f {
    var color = straight;
    let index = span.entry + t * span.delta;
    var shadow = 1.0;
    var open = 1.0;
    if SHADOWED {
        shadow = 1.0 - effects.shadows * (1.0 - light_at(index, 0u));
    }
    if OCCLUDED {
        let all = effects.light_dims.x * effects.light_dims.y * effects.light_dims.z;
        open = 1.0 - effects.occlusion * (1.0 - light_at(index, select(0u, all, SHADOWED)));
    }
    var scale = open * shadow;
    var highlight = 0.0;
    if SHADED {
        var gradient = vec3f(0.0);
        if gradient_at(index, &gradient) {
            let size = length(gradient);
            let share = size / (size + WEAK_GRADIENT);
            let normal = gradient / size;
            var gloss = abs(dot(normal, course.half));
            for (var k = 0u; k < SHININESS; k++) {
                gloss *= gloss;
            }
            let lit = effects.ambient * open + effects.diffuse * abs(dot(normal, effects.light)) * shadow;
            scale = (1.0 - share) * scale + share * lit;
            highlight = share * effects.specular * gloss * shadow;
        }
    }
    if SHADOWED || OCCLUDED || SHADED {
        color = clamp(color * scale + highlight, vec3f(0.0), vec3f(1.0));
    }
    if CUED {
        let fade = clamp((effects.cue_from + span.beyond + t) * effects.cue_per_step, 0.0, effects.cue_strength);
        color += fade * (effects.cue - color);
    }
    return color;
}

// Central differences over a voxel to either side, shares of the range per voxel length; false where there is no slope.
fn gradient_at(index: vec3f, gradient: ptr<function, vec3f>) -> bool {
    for (var axis = 0; axis < 3; axis++) {
        var side = vec3f(0.0);
        side[axis] = 1.0;
        var low = 0.0;
        var high = 0.0;
        let a = value_at(index - side, &low);
        let b = value_at(index + side, &high);
        if !(a && b) {
            return false;
        }
        (*gradient)[axis] = high - low;
    }
    *gradient *= effects.gradient;
    return dot(*gradient, *gradient) > 0.0;
}

// The light volume's values from `start` on, at `index`.
fn light_at(index: vec3f, start: u32) -> f32 {
    let x = clamp(index * effects.light_scale + effects.light_offset, vec3f(0.0), vec3f(effects.light_dims - 1u));
    let base = min(vec3u(x), effects.light_dims - 2u);
    let w = x - vec3f(base);
    let row = effects.light_dims.x;
    let slice = row * effects.light_dims.y;
    let n = start + base.z * slice + base.y * row + base.x;
    let near = mix(light_along_x(n, w.x), light_along_x(n + row, w.x), w.y);
    let far = mix(light_along_x(n + slice, w.x), light_along_x(n + slice + row, w.x), w.y);
    return mix(near, far, w.z);
}

fn light_along_x(n: u32, w: f32) -> f32 {
    return mix(light_volume[n], light_volume[n + 1u], w);
}
