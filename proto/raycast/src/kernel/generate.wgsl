// VDI generation: one march per ray, whose samples are clustered into supersegments by gamma. Counterpart of
// reference/generate.rs.
//
// Dispatched twice, to count and to write, with one pipeline: compiled twice, a driver might round the two differently.

@group(1) @binding(0) var<uniform> clustering: ClusteringUniforms;
// Supersegments per ray of the band; after the prefix sum, the offset of each list and the end of the last one.
@group(1) @binding(1) var<storage, read_write> lists: array<u32>;
@group(1) @binding(2) var<storage, read_write> segments: array<GpuSegment>;
// Number of lists whose length differs from the count: not 0 if the driver does not reproduce its sums.
@group(1) @binding(3) var<storage, read_write> mismatches: atomic<u32>;

// Marks the last supersegment of a ray for which double precision may count another number of steps.
const UNSURE: u32 = 0x80000000u;

// The supersegment that samples are being added to; none while its end is 0.
struct ClusterState {
    start: u32,
    end: u32,
    // In steps.
    length: f32,
    opacity: f32,
    // Premultiplied.
    color: vec3f,
    optical_depth: f32,
}

// Index of the next supersegment, and end of the list.
struct ListCursor {
    next: u32,
    end: u32,
}

@compute @workgroup_size(8, 8)
fn generate(@builtin(global_invocation_id) id: vec3u) {
    let r = view.width;
    let row = clustering.first_ray / r + id.y;
    let ray = row * r + id.x;
    if id.x >= r || row >= clustering.rows || ray < clustering.first_ray || ray >= clustering.end_ray {
        return;
    }
    var place = ListCursor(0u, 0u);
    if clustering.writing != 0u {
        place = ListCursor(lists[ray], lists[ray + 1u]);
        // The list is empty.
        if place.next == place.end {
            return;
        }
    }
    cluster_ray(ray_span(id.x, clustering.first_row + row), &place);
    if clustering.writing == 0u {
        lists[ray] = place.next;
    } else if place.next != place.end {
        atomicAdd(&mismatches, 1u);
    }
}

// Clusters the samples of one ray, and counts or writes its supersegments.
fn cluster_ray(span: RaySpan, place: ptr<function, ListCursor>) {
    var open = ClusterState(0u, 0u, 0.0, 0.0, vec3f(0.0), 0.0);
    var optical_depth = 0.0;
    var state = MarchState(0u, 0u);
    var clipped = RayClip(vec2f(0.0), vec3f(0.0));
    if EFFECTS {
        clipped = clip_ray(span);
        state.next = u32(max(clipped.kept.x, 0.0));
    }
    var s = next_sample(span, &state);
    while s.step < span.steps && (!EFFECTS || f32(s.step) < clipped.kept.y) {
        // Compute color and opacity at unit length, and optical depth.
        var unit = vec4f(0.0);
        var tau = 0.0;
        var ratio = 0.0;
        if EFFECTS {
            let met = shade_sample(span, clipped, s);
            tau = met.depth;
            s.length = met.length;
            if tau > 0.0 {
                let opacity = opacity_from_optical_depth(tau * (view.unit_steps / s.length));
                unit = vec4f(met.color * opacity, opacity);
                ratio = opacity_from_optical_depth(tau) / opacity;
            }
        } else {
            unit = unit_row(s.row);
            let depth = depth_row(s.row);
            tau = depth.x;
            ratio = depth.y;
            if s.length < 1.0 {
                tau *= s.length;
                ratio = opacity_from_optical_depth(tau) / unit.w;
            }
        }
        // Transparent steps make a gap, and a gap ends a supersegment.
        if unit.w > 0.0 {
            let joins = open.end == s.step && open.end > 0u && difference(open, unit) < clustering.gamma;
            if !joins {
                if open.end > 0u {
                    close(open, 0u, place);
                }
                open = ClusterState(s.step, 0u, 0.0, 0.0, vec3f(0.0), 0.0);
            }
            // Composite the sample into the open supersegment.
            let shown = (1.0 - open.opacity) * ratio;
            open.color += shown * unit.xyz;
            open.opacity += shown * unit.w;
            open.optical_depth += tau;
            open.length += s.length;
            open.end = s.step + 1u;
            optical_depth += tau;
            if optical_depth >= clustering.cutoff {
                break;
            }
        }
        s = next_sample(span, &state);
    }
    if open.end > 0u {
        close(open, select(0u, UNSURE, is_unsure(span)), place);
    }
}

// Largest channel difference between the premultiplied RGBA of the open supersegment and of a sample, both at the unit length,
// so that the meaning of gamma does not depend on the step length.
fn difference(open: ClusterState, unit: vec4f) -> f32 {
    let opacity = opacity_from_optical_depth(open.optical_depth * (view.unit_steps / open.length));
    let c = abs(open.color * (opacity / open.opacity) - unit.xyz);
    return max(max(c.x, c.y), max(c.z, abs(opacity - unit.w)));
}

fn close(open: ClusterState, mark: u32, place: ptr<function, ListCursor>) {
    let n = (*place).next;
    (*place).next = n + 1u;
    if clustering.writing == 0u || n >= (*place).end {
        return;
    }
    let c = clamp(open.color / open.opacity, vec3f(0.0), vec3f(1.0));
    segments[n - clustering.first_segment] = GpuSegment(open.start, open.end | mark, c.x, c.y, c.z, open.optical_depth);
}
