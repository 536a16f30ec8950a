// VDI rendering from any camera, one invocation per pixel; counterpart of simd/mod.rs.

fn color_at(i: u32, j: u32) -> vec3f {
    let line = line_at(f32(2u * i + 1u) - f32(view.width), f32(2u * j + 1u) - f32(view.height));
    if line.steps <= 0.0 {
        return view.background;
    }
    let light = trace(line);
    // Sums for white may round to slightly more than 1.
    return min(light.color + light.transmittance * view.background, vec3f(1.0));
}
