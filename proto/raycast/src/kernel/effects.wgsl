// Effects of a scene; counterpart of reference/effects.rs. Each effect is switched on when the kernel is compiled.

override CLIPPED: bool = false;
override PRE_INTEGRATED: bool = false;
override SURFACES: u32 = 0u;
override SHADED: bool = false;
// Shininess is 2^SHININESS.
override SHININESS: u32 = 0u;
override SHADOWED: bool = false;
override OCCLUDED: bool = false;
override CUED: bool = false;
override COLORED: bool = false;

@group(2) @binding(0) var<uniform> effects: EffectUniforms;
// PreintegrationTable::split: of a step's optical depth x (red, green, blue, 1) the prefix sum, its rounding error, and the
// difference to the next row.
@group(2) @binding(1) var<storage, read> sums: array<vec4f>;
// LightVolume: transmittance of all points if there are shadows, then openness if there is occlusion.
@group(2) @binding(2) var<storage, read> light_volume: array<f32>;
// The color field: positions in the range of its map, single precision.
@group(2) @binding(3) var color_voxels: texture_3d<u32>;

// Clipped steps shorter than this share of a step are skipped; effects::SHORTEST.
const SHORTEST: f32 = 1e-4;
// effects::WEAK_GRADIENT and FEWEST_ROWS.
const WEAK_GRADIENT: f32 = 0.01;
const FEWEST_ROWS: f32 = 4.0;

struct RayClip {
    // Ends of the part of the ray that is not clipped, in steps from the entry.
    kept: vec2f,
    // Half vector between light and eye, of length 1.
    half: vec3f,
}

// A step with effects applied: straight color and optical depth, which is 0 for a transparent step.
struct ShadedStep {
    color: vec3f,
    depth: f32,
    length: f32,
}

fn clip_ray(span: RaySpan) -> RayClip {
    // Clip the ray by the half spaces.
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
    // Compute the half vector.
    var half = vec3f(0.0);
    if SHADED {
        let sum = effects.light - normalize(span.delta * effects.spacing);
        let size = length(sum);
        half = select(vec3f(0.0), sum / size, size > 0.0);
    }
    return RayClip(kept, half);
}

fn shade_sample(span: RaySpan, clipped: RayClip, s: MarchSample) -> ShadedStep {
    // Clip the step.
    var first = f32(s.step);
    var last = min(first + 1.0, span.length);
    if CLIPPED {
        first = max(first, clipped.kept.x);
        last = min(last, clipped.kept.y);
    }
    let size = last - first;
    if size <= SHORTEST {
        return ShadedStep(vec3f(0.0), 0.0, 0.0);
    }
    // Classify the middle of the step.
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
    // Replace the classification by the integral between the ends of the step.
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
            // Behind an opaque part of the range the prefix sums lose the digits of a faint part, but their rounding errors keep them.
            let sum = (b.sum - a.sum) + (b.rest - a.rest) + (b.part - a.part);
            color = vec3f(0.0);
            if sum.w != 0.0 {
                color = clamp(sum.xyz / sum.w, vec3f(0.0), vec3f(1.0));
            }
            depth = max(sum.w / ((high - low) * f32(view.bins)) * size, 0.0);
        }
    }
    // Light the medium, then composite it with the surfaces crossed.
    if depth > 0.0 {
        if COLORED {
            own_color(span.entry + middle * span.delta, &color);
        }
        color = shade(color, span, clipped, middle);
    }
    if SURFACES > 0u {
        if whole {
            return meet_surfaces(span, clipped, vec2f(first, size), vec2f(low, high), ShadedStep(color, depth, size));
        }
    }
    return ShadedStep(color, depth, size);
}

// Replaces `color` by the color field's at `index`, before lighting, unless a point of the cell is not finite.
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

// A prefix sum in parts, the first of which may be large where the others are small.
struct IntegralSum {
    sum: vec4f,
    rest: vec4f,
    part: vec4f,
}

// The prefix sum up to position `u` of the range, extrapolated outside of it.
fn sum_at(u: f32) -> IntegralSum {
    let row = row_at(max(u, 0.0), view.bins, 0u);
    let n = 3u * row.index;
    let beyond = (u - clamp(u, 0.0, 1.0)) * f32(view.bins);
    let part = row.weight * sums[n + 2u] + beyond * select(effects.before, effects.beyond, u > 0.5);
    return IntegralSum(sums[n], sums[n + 1u], part);
}

// Composites the medium of a step with the surfaces crossed in it, in the order along the ray.
fn meet_surfaces(span: RaySpan, clipped: RayClip, at: vec2f, ends: vec2f, medium: ShadedStep) -> ShadedStep {
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
        sum += through * hides * shade(surface.xyz, span, clipped, at.x + share * at.y);
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
    return ShadedStep(min(sum / all, vec3f(1.0)), medium.depth + met, medium.length);
}

// Position of the crossing of `level` within a step, as a share of it: two steps of the secant method.
fn crossing(span: RaySpan, at: vec2f, ends: vec2f, level: f32) -> f32 {
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

// A straight color at `t` steps from the entry with shadow, occlusion, shading and depth cue applied.
fn shade(straight: vec3f, span: RaySpan, clipped: RayClip, t: f32) -> vec3f {
    var color = straight;
    let index = span.entry + t * span.delta;
    // Look the light volume up.
    var shadow = 1.0;
    var open = 1.0;
    if SHADOWED {
        shadow = 1.0 - effects.shadows * (1.0 - light_at(index, 0u));
    }
    if OCCLUDED {
        let all = effects.light_dims.x * effects.light_dims.y * effects.light_dims.z;
        open = 1.0 - effects.occlusion * (1.0 - light_at(index, select(0u, all, SHADOWED)));
    }
    // Shade by the gradient (Blinn-Phong).
    var scale = open * shadow;
    var highlight = 0.0;
    if SHADED {
        var gradient = vec3f(0.0);
        if gradient_at(index, &gradient) {
            let size = length(gradient);
            let share = size / (size + WEAK_GRADIENT);
            let normal = gradient / size;
            var gloss = abs(dot(normal, clipped.half));
            for (var k = 0u; k < SHININESS; k++) {
                gloss *= gloss;
            }
            let lit = effects.ambient * open + effects.diffuse * abs(dot(normal, effects.light)) * shadow;
            scale = (1.0 - share) * scale + share * lit;
            highlight = share * effects.specular * gloss * shadow;
        }
    }
    // Apply light, then the depth cue.
    if SHADOWED || OCCLUDED || SHADED {
        color = clamp(color * scale + highlight, vec3f(0.0), vec3f(1.0));
    }
    if CUED {
        let fade = clamp((effects.cue_from + span.beyond + t) * effects.cue_per_step, 0.0, effects.cue_strength);
        color += fade * (effects.cue - color);
    }
    return color;
}

// Gradient by central differences over one voxel to either side, in shares of the range per voxel length; false if it is 0
// or a voxel is not finite.
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

// Trilinear interpolation of the light volume's values from `start` on, at `index`.
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
