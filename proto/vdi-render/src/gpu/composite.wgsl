// Compositing what a stretch of a ray meets in one pixel's list. As cpu/gather.rs, for one ray.

// What a ray has gathered so far, front to back.
struct Light {
    color: vec3f,
    transmittance: f32,
    // The place in the list where the previous pixel's search ended: neighbours' lists are alike.
    hint: u32,
}

// Adds what lies between two places on the line in `pixel`, near to far or far to near as the ray runs; true if nothing
// behind can be seen.
fn gather(line: Line, pixel: u32, start: f32, stop: f32, light: ptr<function, Light>) -> bool {
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

// Composites `length` steps of a supersegment; true if nothing behind can be seen.
fn add(n: u32, length: f32, light: ptr<function, Light>) -> bool {
    if length <= 0.0 {
        return false;
    }
    let content = contents[n];
    let weight = (*light).transmittance * opacity(content.w * length);
    (*light).color += weight * content.xyz;
    (*light).transmittance -= weight;
    return (*light).transmittance < view.floor;
}

// The first supersegment of a list that ends beyond `near`, looked for from place `hint` on.
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

// One past the last supersegment of a list that starts at `far` or before, likewise.
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
