// Ray casting: emission-absorption pictures of the field. Counterpart of reference/raycast.rs.

@group(1) @binding(0) var<uniform> picture: PictureUniforms;
// Columns, and rows in the upper half word.
@group(1) @binding(1) var<storage, read> pixels: array<u32>;
// Three numbers per pixel.
@group(1) @binding(2) var<storage, read_write> colors: array<f32>;

// Colors a band of rows of the whole picture.
@compute @workgroup_size(8, 8)
fn raycast_rows(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.width || id.y >= picture.count {
        return;
    }
    store(id.y * view.width + id.x, color_at(id.x, picture.first + id.y));
}

// Colors listed pixels.
@compute @workgroup_size(64)
fn raycast_pixels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let n = (group.y * groups.x + group.x) * 64u + lane;
    if n >= picture.count {
        return;
    }
    let pixel = pixels[n];
    store(n, color_at(pixel & 0xffffu, pixel >> 16u));
}

fn store(n: u32, color: vec3f) {
    colors[3u * n] = color.x;
    colors[3u * n + 1u] = color.y;
    colors[3u * n + 2u] = color.z;
}

fn color_at(i: u32, j: u32) -> vec3f {
    let span = ray_span(i, j);
    var color = vec3f(0.0);
    var transmittance = 1.0;
    if EFFECTS {
        let clipped = clip_ray(span);
        var state = MarchState(u32(max(clipped.kept.x, 0.0)), 0u);
        var s = next_sample(span, &state);
        while s.step < span.steps && f32(s.step) < clipped.kept.y {
            let met = shade_sample(span, clipped, s);
            let opacity = opacity_from_optical_depth(met.depth);
            color += transmittance * opacity * met.color;
            transmittance *= 1.0 - opacity;
            if transmittance < picture.floor {
                break;
            }
            s = next_sample(span, &state);
        }
        return min(color + transmittance * picture.background, vec3f(1.0));
    }
    var state = MarchState(0u, 0u);
    var s = next_sample(span, &state);
    while s.step < span.steps {
        var piece = step_row(s.row);
        if s.length < 1.0 {
            piece = short_step(s);
        }
        color += transmittance * piece.xyz;
        transmittance *= 1.0 - piece.w;
        if transmittance < picture.floor {
            break;
        }
        s = next_sample(span, &state);
    }
    // Sums for white may round to slightly more than 1.
    return min(color + transmittance * picture.background, vec3f(1.0));
}

// The last step: its optical depth is proportional to its length.
fn short_step(s: MarchSample) -> vec4f {
    let unit = unit_row(s.row);
    if unit.w <= 0.0 {
        return vec4f(0.0);
    }
    let opacity = opacity_from_optical_depth(depth_row(s.row).x * s.length);
    return vec4f(unit.xyz * (opacity / unit.w), opacity);
}
