// Compositing of one pixel's list along one ray; counterpart of simd/composite.rs.

// Accumulated color and transmittance of a ray, front to back.
struct LineAccumulator {
    color: vec3f,
    transmittance: f32,
    // Index in the list where the previous pixel's search ended: neighboring lists are similar.
    hint: u32,
}

// Composites the supersegments of `pixel` between two positions on the line, in the order along the ray; true if the ray has
// become opaque.
fn composite_list(line: ImageLine, pixel: u32, start: f32, stop: f32, light: ptr<function, LineAccumulator>) -> bool {
    // Convert the positions to steps on the pixel's ray.
    let slot = slots[pixel];
    let span = spans[slot];
    let first = span.first;
    let count = spans[slot + 1u].first - first;
    let from_way = way(start, line.z0, line.z1);
    let to_way = way(stop, line.z0, line.z1);
    let a = span.scale * (line.depth + from_way * line.depth_change) - span.offset;
    let b = span.scale * (line.depth + to_way * line.depth_change) - span.offset;
    let near = min(a, b);
    let far = max(a, b);
    let length = (to_way - from_way) * line.steps;
    // Composite the supersegments between them, away from or towards the generation camera.
    if line.depth_change >= 0.0 {
        var k = first_met(first, count, near, (*light).hint);
        (*light).hint = k;
        while k < count {
            let s = vec2f(ends[first + k]);
            if s.x > far || add(first + k, length * share(s.x, min(s.y, span.last), near, far), light) {
                break;
            }
            k++;
        }
    } else {
        var k = past_met(first, count, far, (*light).hint);
        (*light).hint = k;
        while k > 0u {
            k--;
            let s = vec2f(ends[first + k]);
            if s.y < near || add(first + k, length * share(s.x, min(s.y, span.last), near, far), light) {
                break;
            }
        }
    }
    return (*light).transmittance < view.floor;
}

// Composites `length` steps of a supersegment; true if the ray has become opaque.
fn add(n: u32, length: f32, light: ptr<function, LineAccumulator>) -> bool {
    if length <= 0.0 {
        return false;
    }
    let content = contents[n];
    let weight = (*light).transmittance * opacity(content.w * length);
    (*light).color += weight * content.xyz;
    (*light).transmittance -= weight;
    return (*light).transmittance < view.floor;
}

// Index of the first supersegment of a list that ends beyond `near`, searched from `hint` on.
fn first_met(first: u32, count: u32, near: f32, hint: u32) -> u32 {
    var k = min(hint, count);
    while k > 0u && f32(ends[first + k - 1u].y) > near {
        k--;
    }
    while k < count && f32(ends[first + k].y) <= near {
        k++;
    }
    return k;
}

// Index after the last supersegment of a list that starts at `far` or before, searched from `hint` on.
fn past_met(first: u32, count: u32, far: f32, hint: u32) -> u32 {
    var k = min(hint, count);
    while k < count && f32(ends[first + k].x) <= far {
        k++;
    }
    while k > 0u && f32(ends[first + k - 1u].x) > far {
        k--;
    }
    return k;
}
