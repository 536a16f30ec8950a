// From colors in single precision to bytes: one picture, or the blend of displaced ones (proto/vdi-render, reconstruction.rs).

struct Blending {
    // 0: the first picture as it is.
    blended: u32,
    sharpness: f32,
    // Weight of the picture that `accumulate` adds.
    weight: f32,
    pad0: u32,
}

@group(0) @binding(0) var<uniform> blending: Blending;
@group(0) @binding(1) var<storage, read> first: array<f32>;
@group(0) @binding(2) var<storage, read> second: array<f32>;
@group(0) @binding(3) var<storage, read> third: array<f32>;
@group(0) @binding(4) var<storage, read> fourth: array<f32>;
@group(0) @binding(5) var<storage, read> difference: array<f32>;

@group(0) @binding(6) var<storage, read> side: array<f32>;
@group(0) @binding(7) var<storage, read_write> sum: array<f32>;

@group(0) @binding(8) var<storage, read_write> pixels: array<u32>;

// Adds a picture to the difference.
@compute @workgroup_size(64)
fn accumulate(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let n = id.y * groups.x * 64u + id.x;
    if n < arrayLength(&sum) {
        sum[n] += blending.weight * side[n];
    }
}

fn channel(n: u32) -> f32 {
    let a = first[n];
    if blending.blended == 0u {
        return a;
    }
    let b = second[n];
    let c = third[n];
    let d = fourth[n];
    let linear = 0.25 * ((a + c) + (b + d));
    let sharp = linear + blending.sharpness * difference[n];
    return clamp(sharp, min(min(a, b), min(c, d)), max(max(a, b), max(c, d)));
}

fn byte(n: u32) -> u32 {
    return u32(clamp(channel(n), 0.0, 1.0) * 255.0 + 0.5);
}

// Rounds all channels to bytes: red first, opaque.
@compute @workgroup_size(64)
fn present(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let n = id.y * groups.x * 64u + id.x;
    if n < arrayLength(&pixels) {
        pixels[n] = byte(3u * n) | (byte(3u * n + 1u) << 8u) | (byte(3u * n + 2u) << 16u) | 0xff000000u;
    }
}
