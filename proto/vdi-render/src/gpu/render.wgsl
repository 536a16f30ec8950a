// VDI rendering from any camera, one invocation per pixel; counterpart of simd/mod.rs.

@group(1) @binding(0) var<uniform> picture: PictureUniforms;
// Columns, and rows in the upper half word.
@group(1) @binding(1) var<storage, read> pixels: array<u32>;
// Three numbers per pixel.
@group(1) @binding(2) var<storage, read_write> colors: array<f32>;

// Colors a band of rows of the whole picture.
@compute @workgroup_size(8, 8)
fn render_rows(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.width || id.y >= picture.count {
        return;
    }
    store(id.y * view.width + id.x, color_at(id.x, picture.first + id.y));
}

// Colors listed pixels.
@compute @workgroup_size(64)
fn render_pixels(
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
    let line = line_at(f32(2u * i + 1u) - f32(view.width), f32(2u * j + 1u) - f32(view.height));
    if line.steps <= 0.0 {
        return view.background;
    }
    let light = trace(line);
    // Sums for white may round to slightly more than 1.
    return min(light.color + light.transmittance * view.background, vec3f(1.0));
}
