// Evaluates one leaf a case.

struct Case {
    a: vec4f,
    b: vec4f,
    // Which leaf.
    leaf: vec4f,
}

@group(0) @binding(0) var<storage, read_write> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> outcomes: array<vec4f>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&cases) {
        return;
    }
    let p = cases[id.x];
    var out = vec4f(0.0);
    switch u32(p.leaf.x) {
        case 0u: {
            out.x = opacity(p.a.x);
        }
        case 1u: {
            out = vec4f(cut(p.a.xy, p.a.z, p.a.w), 0.0, 0.0);
        }
        case 2u: {
            let word = bits(bin(p.a.x), bin(p.a.y));
            out = vec4f(vec2f(word & vec2u(0xffffu)), vec2f(word >> vec2u(16u)));
        }
        case 3u: {
            out.x = way(p.a.x, p.a.y, p.a.z);
        }
        case 4u: {
            let axis = axis_at(p.a.x, p.a.y, p.a.z, u32(p.a.w), p.b.x, i32(p.b.y), i32(p.b.z));
            out = vec4f(f32(axis.cell), axis.boundary, axis.next, f32(axis.last));
        }
        case 5u: {
            out.x = share(p.a.x, p.a.y, p.a.z, p.a.w);
        }
        default: {
            out.x = per_change(p.a.x);
        }
    }
    outcomes[id.x] = out;
}
