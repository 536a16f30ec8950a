// Ray casting: emission-absorption pictures of the field. Counterpart of reference/raycast.rs.

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
