// Evaluates one leaf a case.

struct Case {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    d: vec4f,
    // Which leaf.
    leaf: vec4f,
}

struct Outcome {
    a: vec4f,
    b: vec4f,
}

@group(0) @binding(0) var<storage, read_write> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> outcomes: array<Outcome>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&cases) {
        return;
    }
    let p = cases[id.x];
    var a = vec3f(0.0);
    var b = vec3f(0.0);
    switch u32(p.leaf.x) {
        case 0u: {
            a.x = opacity_from_optical_depth(p.a.x);
        }
        case 1u: {
            a.x = f32(steps(p.a.x));
        }
        case 2u: {
            let row = row_at(p.a.x, u32(p.a.y), u32(p.a.z));
            a = vec3f(f32(row.index), row.weight, 0.0);
        }
        case 3u: {
            a = vec3f(clip(p.a.xyz, p.b.xyz, p.c.xyz, p.d.xyz), 0.0);
        }
        case 4u: {
            let cell = cell_at(p.a.xyz, vec3u(p.b.xyz));
            a = vec3f(cell.base);
            b = cell.weight;
        }
        case 5u: {
            a = vec3f(brick_at(p.a.xyz, vec3u(p.b.xyz)));
        }
        default: {
            a.x = f32(jump(p.a.xyz, p.b.xyz, vec3u(p.c.xyz), u32(p.c.w), vec3u(p.d.xyz)));
        }
    }
    outcomes[id.x] = Outcome(vec4f(a, 0.0), vec4f(b, 0.0));
}
