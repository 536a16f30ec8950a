// Entry points of kernels that color pixels (color_pass.rs dispatches them): the kernel brings `PictureUniforms` with `first` and
// `count`, `view.width`, and `color_at(column, row)`.

@group(1) @binding(0) var<uniform> picture: PictureUniforms;
// Columns, and rows in the upper half word.
@group(1) @binding(1) var<storage, read> pixels: array<u32>;
// Three numbers per pixel.
@group(1) @binding(2) var<storage, read_write> colors: array<f32>;

// Colors a band of rows of the whole picture.
@compute @workgroup_size(8, 8)
fn color_rows(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.width || id.y >= picture.count {
        return;
    }
    store(id.y * view.width + id.x, color_at(id.x, picture.first + id.y));
}

// Colors listed pixels.
@compute @workgroup_size(64)
fn color_pixels(
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
