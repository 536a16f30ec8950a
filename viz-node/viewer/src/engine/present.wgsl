// From colors in single precision to bytes.

@group(0) @binding(0) var<storage, read> colors: array<f32>;
@group(0) @binding(1) var<storage, read_write> pixels: array<u32>;

fn byte(n: u32) -> u32 {
    return u32(clamp(colors[n], 0.0, 1.0) * 255.0 + 0.5);
}

// Rounds all channels to bytes: red first, opaque.
@compute @workgroup_size(64)
fn present(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let n = id.y * groups.x * 64u + id.x;
    if n < arrayLength(&pixels) {
        pixels[n] = byte(3u * n) | (byte(3u * n + 1u) << 8u) | (byte(3u * n + 2u) << 16u) | 0xff000000u;
    }
}
