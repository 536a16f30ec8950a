// VDI rendering from any camera, one invocation per pixel; counterpart of simd/cubic.rs.

// Greatest difference of a channel, over the inner ring, that counts as none.
const EVEN: f32 = 1.0 / 1024.0;

fn color_at(i: u32, j: u32) -> vec3f {
    let line = line_at(f32(2u * i + 1u) - f32(view.width), f32(2u * j + 1u) - f32(view.height));
    if line.steps <= 0.0 {
        return view.background;
    }
    if view.margin == 0.0 {
        return color_along(line);
    }
    let inner = ring(line, view.inner);
    let spread = inner.most - inner.least;
    if view.sharpness == 0.0 || max(spread.x, max(spread.y, spread.z)) <= EVEN {
        return inner.mean;
    }
    let outer = ring(line, view.outer);
    return clamp(inner.mean + view.sharpness * (inner.mean - outer.mean), inner.least, inner.most);
}

fn color_along(line: ImageLine) -> vec3f {
    let light = trace(line);
    // Sums for white may round to slightly more than 1.
    return min(light.color + light.transmittance * view.background, vec3f(1.0));
}

// Colors along four displaced lines.
struct RingColors {
    mean: vec3f,
    least: vec3f,
    most: vec3f,
}

// The line displaced by four quarter turns.
fn ring(line: ImageLine, by: vec2f) -> RingColors {
    var turned = by;
    // Summed in two pairs, so that four equal colors give exactly their mean.
    var pairs = array<vec3f, 2>(vec3f(0.0), vec3f(0.0));
    var colors = RingColors(vec3f(0.0), vec3f(1.0), vec3f(0.0));
    for (var n = 0; n < 4; n++) {
        let color = color_along(displaced(line, turned));
        pairs[n & 1] += color;
        colors.least = min(colors.least, color);
        colors.most = max(colors.most, color);
        turned = vec2f(-turned.y, turned.x);
    }
    colors.mean = 0.25 * (pairs[0] + pairs[1]);
    return colors;
}
