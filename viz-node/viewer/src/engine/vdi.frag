#version 300 es

precision highp float;
precision highp int;

struct StoredVdi {
    uvec2 size;
    uvec2 first_masks;
    float depth;
    float far;
    float depth_bins;
    float margin;
};
struct LinearForm {
    vec3 start;
    float pad0_;
    vec3 change;
    float pad1_;
};
struct ViewUniforms {
    LinearForm column;
    LinearForm row;
    LinearForm depth;
    LinearForm planes[12];
    vec3 background;
    float floor_;
    uint width;
    uint height;
    float eye;
    float slope;
    float steps;
    float sharpness;
    vec2 inner;
    vec2 outer;
    float margin;
    uint pad0_;
};
struct PictureUniforms {
    uint first;
    uint count;
    uvec2 pad0_;
};
struct DepthSteps {
    float scale;
    float offset;
    float last;
    uint first;
};
struct AxisWalk {
    int cell;
    int step_;
    int last;
    float boundary;
    float boundary_step;
    float start;
    float per_change;
    float next;
};
struct ImageLine {
    vec2 start;
    vec2 change;
    vec2 per_change;
    float depth;
    float depth_change;
    float z0_;
    float z1_;
    float bin;
    float bin_change;
    float margin;
    float steps;
    vec2 visible;
};
struct LineAccumulator {
    vec3 color;
    float transmittance;
    uint hint;
};
struct LevelWalk {
    AxisWalk x;
    AxisWalk y;
    float start;
    float stop;
    float end;
};
struct RingColors {
    vec3 mean;
    vec3 least;
    vec3 most;
};
const float FAR = 1e30;
const float PARALLEL_EPSILON = 1e-12;
const float OPAQUE = 80.0;
const float FLAT = 1e-6;
const uint PIXELS = 0u;
const uint MIDDLE = 3u;
const uint COARSE = 5u;
const float EVEN = 0.0009765625;

layout(std140) uniform StoredVdi_block_0Fragment { StoredVdi _group_0_binding_0_fs; };

layout(std140) uniform ViewUniforms_block_1Fragment { ViewUniforms _group_0_binding_1_fs; };

uniform highp usampler2D _group_0_binding_2_fs;

uniform highp usampler2D _group_0_binding_3_fs;

uniform highp usampler2D _group_0_binding_4_fs;

uniform highp usampler2D _group_0_binding_5_fs;

uniform highp usampler2D _group_0_binding_6_fs;

layout(location = 0) out vec4 _fs2p_location0;

float opacity(float optical_depth) {
    float t = min(optical_depth, OPAQUE);
    if ((t < 0.25)) {
        return (t * (1.0 - ((t / 2.0) * (1.0 - ((t / 3.0) * (1.0 - ((t / 4.0) * (1.0 - ((t / 5.0) * (1.0 - (t / 6.0)))))))))));
    }
    return (1.0 - exp(-(t)));
}

vec2 cut(vec2 span, float a, float b) {
    if ((abs(b) < PARALLEL_EPSILON)) {
        if ((a < 0.0)) {
            return vec2(1e30, -1e30);
        }
        return span;
    }
    float t_1 = (-(a) / b);
    if ((b > 0.0)) {
        return vec2(max(span.x, t_1), span.y);
    }
    return vec2(span.x, min(span.y, t_1));
}

uint bin(float place) {
    return uint(clamp(place, 0.0, 63.0));
}

uvec2 bits(uint a_1, uint b_1) {
    uvec2 from_a = ((a_1 < 32u) ? uvec2((4294967295u << (a_1 & 31u)), 4294967295u) : uvec2(0u, (4294967295u << (a_1 & 31u))));
    uvec2 to_b = ((b_1 < 32u) ? uvec2((4294967295u >> (31u - (b_1 & 31u))), 0u) : uvec2(4294967295u, (4294967295u >> (31u - (b_1 & 31u)))));
    return (from_a & to_b);
}

float way(float mu, float z0_, float z1_) {
    return min(((mu * z0_) / ((z1_ * (1.0 - mu)) + (z0_ * mu))), 1.0);
}

float per_change(float change) {
    if ((abs(change) < 1e-30)) {
        return FAR;
    }
    return (1.0 / change);
}

float boundary_mu(AxisWalk axis, float boundary) {
    return ((boundary - axis.start) * axis.per_change);
}

AxisWalk advanced(AxisWalk before) {
    AxisWalk axis_1 = AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0);
    axis_1 = before;
    int _e3 = axis_1.cell;
    int _e5 = axis_1.step_;
    axis_1.cell = (_e3 + _e5);
    float _e8 = axis_1.boundary;
    float _e10 = axis_1.boundary_step;
    axis_1.boundary = (_e8 + _e10);
    AxisWalk _e13 = axis_1;
    float _e15 = axis_1.boundary;
    float _e16 = boundary_mu(_e13, _e15);
    axis_1.next = _e16;
    AxisWalk _e17 = axis_1;
    return _e17;
}

AxisWalk axis_at(float start, float change_1, float per_change_1, uint shift, float mu_1, int lo, int hi) {
    AxisWalk axis_2 = AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0);
    bool local_1 = false;
    bool local_2 = false;
    bool forward = (change_1 >= 0.0);
    int place_2 = (int((start + (change_1 * mu_1))) >> shift);
    int step_ = (forward ? 1 : -1);
    int first_3 = (forward ? lo : hi);
    int last = (forward ? hi : lo);
    int cell = min(max(place_2, lo), hi);
    float boundary_1 = float(((cell + int(forward)) << shift));
    float boundary_step = float((step_ * (1 << shift)));
    axis_2 = AxisWalk(cell, step_, last, boundary_1, boundary_step, start, per_change_1, 0.0);
    AxisWalk _e31 = axis_2;
    float _e32 = boundary_mu(_e31, boundary_1);
    axis_2.next = _e32;
    while(true) {
        float _e34 = axis_2.next;
        if ((_e34 <= mu_1)) {
            int _e39 = axis_2.cell;
            local_1 = (_e39 != last);
        } else {
            local_1 = false;
        }
        bool _e42 = local_1;
        if (_e42) {
        } else {
            break;
        }
        {
            AxisWalk _e43 = axis_2;
            AxisWalk _e44 = advanced(_e43);
            axis_2 = _e44;
        }
    }
    while(true) {
        int _e46 = axis_2.cell;
        if ((_e46 != first_3)) {
            AxisWalk _e50 = axis_2;
            float _e52 = axis_2.boundary;
            float _e54 = boundary_mu(_e50, (_e52 - boundary_step));
            local_2 = (_e54 > mu_1);
        } else {
            local_2 = false;
        }
        bool _e57 = local_2;
        if (_e57) {
        } else {
            break;
        }
        {
            int _e59 = axis_2.cell;
            axis_2.cell = (_e59 - step_);
            float _e62 = axis_2.boundary;
            axis_2.boundary = (_e62 - boundary_step);
            AxisWalk _e65 = axis_2;
            float _e67 = axis_2.boundary;
            float _e68 = boundary_mu(_e65, _e67);
            axis_2.next = _e68;
        }
    }
    AxisWalk _e69 = axis_2;
    return _e69;
}

float share(float start_1, float end, float near, float far) {
    bool local_3 = false;
    if (((far - near) <= (FLAT * abs(far)))) {
        if ((start_1 <= near)) {
            local_3 = (near < end);
        } else {
            local_3 = false;
        }
        bool _e14 = local_3;
        return (_e14 ? 1.0 : 0.0);
    }
    return (max((min(end, far) - max(start_1, near)), 0.0) / (far - near));
}

vec2 form_at(LinearForm form, vec3 place_1) {
    return vec2(dot(form.start, place_1), dot(form.change, place_1));
}

ImageLine line_at(float x, float y) {
    ImageLine line = ImageLine(vec2(0.0), vec2(0.0), vec2(0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, vec2(0.0));
    vec2 span_1 = vec2(0.0);
    int n = 0;
    bool local_4 = false;
    bool local_5 = false;
    vec3 place_3 = vec3(1.0, x, y);
    float _e7 = _group_0_binding_1_fs.eye;
    span_1 = vec2(_e7, FAR);
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            int _e27 = n;
            n = (_e27 + 1);
        }
        loop_init = false;
        int _e13 = n;
        if ((_e13 < 12)) {
        } else {
            break;
        }
        {
            int _e18 = n;
            LinearForm _e20 = _group_0_binding_1_fs.planes[_e18];
            vec2 _e21 = form_at(_e20, place_3);
            vec2 _e22 = span_1;
            vec2 _e25 = cut(_e22, _e21.x, _e21.y);
            span_1 = _e25;
        }
    }
    line.steps = 0.0;
    float _e32 = span_1.x;
    float _e34 = span_1.y;
    if ((_e32 < _e34)) {
        float _e39 = span_1.y;
        local_4 = (_e39 < FAR);
    } else {
        local_4 = false;
    }
    bool _e43 = local_4;
    if (!(_e43)) {
        ImageLine _e45 = line;
        return _e45;
    }
    LinearForm _e48 = _group_0_binding_1_fs.column;
    vec2 _e49 = form_at(_e48, place_3);
    LinearForm _e52 = _group_0_binding_1_fs.row;
    vec2 _e53 = form_at(_e52, place_3);
    LinearForm _e56 = _group_0_binding_1_fs.depth;
    vec2 _e57 = form_at(_e56, place_3);
    float _e60 = span_1.x;
    float _e66 = span_1.x;
    float _e72 = span_1.x;
    vec3 a_2 = vec3((_e49.x + (_e60 * _e49.y)), (_e53.x + (_e66 * _e53.y)), (_e57.x + (_e72 * _e57.y)));
    float _e79 = span_1.y;
    float _e85 = span_1.y;
    float _e91 = span_1.y;
    vec3 b_2 = vec3((_e49.x + (_e79 * _e49.y)), (_e53.x + (_e85 * _e53.y)), (_e57.x + (_e91 * _e57.y)));
    float _e100 = _group_0_binding_0_fs.depth;
    line.z0_ = (a_2.z + _e100);
    float _e106 = _group_0_binding_0_fs.depth;
    line.z1_ = (b_2.z + _e106);
    float _e109 = line.z0_;
    if ((_e109 > 0.0)) {
        float _e115 = line.z1_;
        local_5 = (_e115 > 0.0);
    } else {
        local_5 = false;
    }
    bool _e119 = local_5;
    if (!(_e119)) {
        ImageLine _e121 = line;
        return _e121;
    }
    float _e124 = _group_0_binding_1_fs.margin;
    vec2 low = vec2(-(_e124));
    uvec2 _e129 = _group_0_binding_0_fs.size;
    float _e135 = _group_0_binding_1_fs.margin;
    vec2 rim = ((vec2(_e129) * 0.99999976) + vec2(_e135));
    float _e141 = line.z0_;
    line.start = clamp((a_2.xy / vec2(_e141)), low, rim);
    float _e148 = line.z1_;
    vec2 _e153 = line.start;
    line.change = (clamp((b_2.xy / vec2(_e148)), low, rim) - _e153);
    line.visible = vec2(0.0, 1.0);
    float _e162 = line.change.x;
    float _e163 = per_change(_e162);
    float _e166 = line.change.y;
    float _e167 = per_change(_e166);
    line.per_change = vec2(_e163, _e167);
    line.depth = a_2.z;
    line.depth_change = (b_2.z - a_2.z);
    float _e178 = _group_0_binding_0_fs.far;
    float _e183 = _group_0_binding_0_fs.depth_bins;
    float _e186 = line.z0_;
    line.bin = (((_e178 - a_2.z) * _e183) / _e186);
    float _e191 = _group_0_binding_0_fs.far;
    float _e196 = _group_0_binding_0_fs.depth_bins;
    float _e199 = line.z1_;
    float _e202 = line.bin;
    line.bin_change = ((((_e191 - b_2.z) * _e196) / _e199) - _e202);
    float _e207 = _group_0_binding_0_fs.margin;
    float _e209 = line.bin_change;
    line.margin = (_e207 + (1e-6 * abs(_e209)));
    float _e216 = span_1.y;
    float _e218 = span_1.x;
    float _e222 = _group_0_binding_1_fs.steps;
    float _e226 = _group_0_binding_1_fs.slope;
    float _e229 = _group_0_binding_1_fs.slope;
    line.steps = (((_e216 - _e218) * _e222) * sqrt((1.0 + ((_e226 * _e229) * ((x * x) + (y * y))))));
    ImageLine _e239 = line;
    return _e239;
}

ImageLine displaced(ImageLine line_1, vec2 by) {
    ImageLine moved = ImageLine(vec2(0.0), vec2(0.0), vec2(0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, vec2(0.0));
    moved = line_1;
    moved.start = (line_1.start + by);
    vec2 _e9 = moved.start;
    vec2 a_3 = ((vec2(0.0) - _e9) * line_1.per_change);
    uvec2 _e15 = _group_0_binding_0_fs.size;
    vec2 _e18 = moved.start;
    vec2 b_3 = ((vec2(_e15) - _e18) * line_1.per_change);
    vec2 enter = min(a_3, b_3);
    vec2 leave = max(a_3, b_3);
    moved.visible = vec2(max(max(enter.x, enter.y), 0.0), min(min(leave.x, leave.y), 1.0));
    ImageLine _e36 = moved;
    return _e36;
}

uvec4 slots_texel(uint n_1) {
    uvec4 _e8 = texelFetch(_group_0_binding_2_fs, ivec2(uvec2((n_1 & 2047u), (n_1 >> 11u))), 0);
    return _e8;
}

uint slots_at(uint n_2) {
    uvec4 _e3 = slots_texel((n_2 >> 2u));
    return _e3[(n_2 & 3u)];
}

DepthSteps depth_steps(uvec4 texel) {
    vec4 numbers = uintBitsToFloat(texel);
    return DepthSteps(numbers.x, numbers.y, numbers.z, texel.w);
}

uvec4 spans_texel(uint n_3) {
    uvec4 _e8 = texelFetch(_group_0_binding_3_fs, ivec2(uvec2((n_3 & 2047u), (n_3 >> 11u))), 0);
    return _e8;
}

DepthSteps spans_at(uint n_4) {
    uvec4 _e1 = spans_texel(n_4);
    DepthSteps _e2 = depth_steps(_e1);
    return _e2;
}

uvec2 pair(uvec4 texel_1, uint n_5) {
    if (((n_5 & 1u) == 0u)) {
        return texel_1.xy;
    }
    return texel_1.zw;
}

uvec4 ends_texel(uint n_6) {
    uvec4 _e8 = texelFetch(_group_0_binding_5_fs, ivec2(uvec2((n_6 & 2047u), (n_6 >> 11u))), 0);
    return _e8;
}

uvec2 ends_at(uint n_7) {
    uvec4 _e3 = ends_texel((n_7 >> 1u));
    uvec2 _e4 = pair(_e3, n_7);
    return _e4;
}

uint first_met(uint first, uint count, float near_1, uint hint) {
    uint k = 0u;
    bool local_6 = false;
    bool local_7 = false;
    k = min(hint, count);
    while(true) {
        uint _e6 = k;
        if ((_e6 > 0u)) {
            uint _e11 = k;
            uvec2 _e15 = ends_at(((first + _e11) - 1u));
            local_6 = (float(_e15.y) > near_1);
        } else {
            local_6 = false;
        }
        bool _e20 = local_6;
        if (_e20) {
        } else {
            break;
        }
        {
            uint _e22 = k;
            k = (_e22 - 1u);
        }
    }
    while(true) {
        uint _e24 = k;
        if ((_e24 < count)) {
            uint _e28 = k;
            uvec2 _e30 = ends_at((first + _e28));
            local_7 = (float(_e30.y) <= near_1);
        } else {
            local_7 = false;
        }
        bool _e35 = local_7;
        if (_e35) {
        } else {
            break;
        }
        {
            uint _e37 = k;
            k = (_e37 + 1u);
        }
    }
    uint _e39 = k;
    return _e39;
}

uvec4 contents_texel(uint n_8) {
    uvec4 _e8 = texelFetch(_group_0_binding_6_fs, ivec2(uvec2((n_8 & 2047u), (n_8 >> 11u))), 0);
    return _e8;
}

vec4 contents_at(uint n_9) {
    uvec4 _e1 = contents_texel(n_9);
    return uintBitsToFloat(_e1);
}

bool add(uint n_10, float length_, inout LineAccumulator light) {
    if ((length_ <= 0.0)) {
        return false;
    }
    vec4 _e6 = contents_at(n_10);
    float _e8 = light.transmittance;
    float _e11 = opacity((_e6.w * length_));
    float weight = (_e8 * _e11);
    vec3 _e14 = light.color;
    light.color = (_e14 + (weight * _e6.xyz));
    float _e19 = light.transmittance;
    light.transmittance = (_e19 - weight);
    float _e22 = light.transmittance;
    float _e25 = _group_0_binding_1_fs.floor_;
    return (_e22 < _e25);
}

uint past_met(uint first_1, uint count_1, float far_1, uint hint_1) {
    uint k_1 = 0u;
    bool local_8 = false;
    bool local_9 = false;
    k_1 = min(hint_1, count_1);
    while(true) {
        uint _e6 = k_1;
        if ((_e6 < count_1)) {
            uint _e10 = k_1;
            uvec2 _e12 = ends_at((first_1 + _e10));
            local_8 = (float(_e12.x) <= far_1);
        } else {
            local_8 = false;
        }
        bool _e17 = local_8;
        if (_e17) {
        } else {
            break;
        }
        {
            uint _e19 = k_1;
            k_1 = (_e19 + 1u);
        }
    }
    while(true) {
        uint _e21 = k_1;
        if ((_e21 > 0u)) {
            uint _e26 = k_1;
            uvec2 _e30 = ends_at(((first_1 + _e26) - 1u));
            local_9 = (float(_e30.x) > far_1);
        } else {
            local_9 = false;
        }
        bool _e35 = local_9;
        if (_e35) {
        } else {
            break;
        }
        {
            uint _e37 = k_1;
            k_1 = (_e37 - 1u);
        }
    }
    uint _e39 = k_1;
    return _e39;
}

bool composite_list(ImageLine line_2, uint pixel, float start_2, float stop, inout LineAccumulator light_1) {
    uint k_2 = 0u;
    bool local_10 = false;
    uint k_3 = 0u;
    bool local_11 = false;
    uint _e5 = slots_at(pixel);
    DepthSteps _e6 = spans_at(_e5);
    uint first_4 = _e6.first;
    DepthSteps _e10 = spans_at((_e5 + 1u));
    uint count_2 = (_e10.first - first_4);
    float _e15 = way(start_2, line_2.z0_, line_2.z1_);
    float _e18 = way(stop, line_2.z0_, line_2.z1_);
    float a_4 = ((_e6.scale * (line_2.depth + (_e15 * line_2.depth_change))) - _e6.offset);
    float b_4 = ((_e6.scale * (line_2.depth + (_e18 * line_2.depth_change))) - _e6.offset);
    float near_2 = min(a_4, b_4);
    float far_2 = max(a_4, b_4);
    float length_1 = ((_e18 - _e15) * line_2.steps);
    if ((line_2.depth_change >= 0.0)) {
        uint _e44 = light_1.hint;
        uint _e45 = first_met(first_4, count_2, near_2, _e44);
        k_2 = _e45;
        uint _e48 = k_2;
        light_1.hint = _e48;
        while(true) {
            uint _e49 = k_2;
            if ((_e49 < count_2)) {
            } else {
                break;
            }
            {
                uint _e51 = k_2;
                uvec2 _e53 = ends_at((first_4 + _e51));
                vec2 s = vec2(_e53);
                if (!((s.x > far_2))) {
                    uint _e60 = k_2;
                    float _e66 = share(s.x, min(s.y, _e6.last), near_2, far_2);
                    bool _e68 = add((first_4 + _e60), (length_1 * _e66), light_1);
                    local_10 = _e68;
                } else {
                    local_10 = true;
                }
                bool _e70 = local_10;
                if (_e70) {
                    break;
                }
                uint _e72 = k_2;
                k_2 = (_e72 + 1u);
            }
        }
    } else {
        uint _e75 = light_1.hint;
        uint _e76 = past_met(first_4, count_2, far_2, _e75);
        k_3 = _e76;
        uint _e79 = k_3;
        light_1.hint = _e79;
        while(true) {
            uint _e80 = k_3;
            if ((_e80 > 0u)) {
            } else {
                break;
            }
            {
                uint _e84 = k_3;
                k_3 = (_e84 - 1u);
                uint _e86 = k_3;
                uvec2 _e88 = ends_at((first_4 + _e86));
                vec2 s_1 = vec2(_e88);
                if (!((s_1.y < near_2))) {
                    uint _e95 = k_3;
                    float _e101 = share(s_1.x, min(s_1.y, _e6.last), near_2, far_2);
                    bool _e103 = add((first_4 + _e95), (length_1 * _e101), light_1);
                    local_11 = _e103;
                } else {
                    local_11 = true;
                }
                bool _e105 = local_11;
                if (_e105) {
                    break;
                }
            }
        }
    }
    float _e107 = light_1.transmittance;
    float _e110 = _group_0_binding_1_fs.floor_;
    return (_e107 < _e110);
}

LevelWalk level_at(ImageLine line_3, uint shift_1, float start_3, float end_1, ivec2 lo_1, ivec2 hi_1) {
    AxisWalk _e14 = axis_at(line_3.start.x, line_3.change.x, line_3.per_change.x, shift_1, start_3, lo_1.x, hi_1.x);
    AxisWalk _e23 = axis_at(line_3.start.y, line_3.change.y, line_3.per_change.y, shift_1, start_3, lo_1.y, hi_1.y);
    return LevelWalk(_e14, _e23, start_3, min(min(_e14.next, _e23.next), end_1), end_1);
}

bool next_tile(inout LevelWalk level) {
    bool local_12 = false;
    LevelWalk l = level;
    bool x_first = (l.x.next <= l.y.next);
    bool at_rim = (x_first ? (l.x.cell == l.x.last) : (l.y.cell == l.y.last));
    if (!((l.stop >= l.end))) {
        local_12 = at_rim;
    } else {
        local_12 = true;
    }
    bool _e25 = local_12;
    if (_e25) {
        return false;
    }
    level.start = l.stop;
    if (x_first) {
        AxisWalk _e31 = advanced(l.x);
        level.x = _e31;
    } else {
        AxisWalk _e34 = advanced(l.y);
        level.y = _e34;
    }
    float _e38 = level.x.next;
    float _e41 = level.y.next;
    level.stop = min(min(_e38, _e41), l.end);
    return true;
}

uvec4 masks_texel(uint n_11) {
    uvec4 _e8 = texelFetch(_group_0_binding_4_fs, ivec2(uvec2((n_11 & 2047u), (n_11 >> 11u))), 0);
    return _e8;
}

uvec2 masks_at(uint n_12) {
    uvec4 _e3 = masks_texel((n_12 >> 1u));
    uvec2 _e4 = pair(_e3, n_12);
    return _e4;
}

bool is_met(ImageLine line_4, LevelWalk level_1, uint shift_2, uint first_2) {
    if ((level_1.stop <= level_1.start)) {
        return false;
    }
    uint _e11 = _group_0_binding_0_fs.size.x;
    uint width = (((_e11 - 1u) >> shift_2) + 1u);
    uvec2 _e26 = masks_at(((first_2 + (uint(level_1.y.cell) * width)) + uint(level_1.x.cell)));
    float a_5 = (line_4.bin + (level_1.start * line_4.bin_change));
    float b_5 = (line_4.bin + (level_1.stop * line_4.bin_change));
    uint _e40 = bin((min(a_5, b_5) - line_4.margin));
    uint _e44 = bin((max(a_5, b_5) + line_4.margin));
    uvec2 _e45 = bits(_e40, _e44);
    return any(notEqual((_e26 & _e45), uvec2(0u)));
}

LevelWalk children(ImageLine line_5, LevelWalk level_2, uint shift_3, uint finer) {
    ivec2 tile = ivec2(level_2.x.cell, level_2.y.cell);
    uvec2 _e11 = _group_0_binding_0_fs.size;
    ivec2 last_1 = ivec2(((_e11 - uvec2(1u)) >> uvec2(finer)));
    ivec2 lo_2 = (tile << uvec2(shift_3));
    LevelWalk _e29 = level_at(line_5, finer, level_2.start, level_2.stop, lo_2, min((lo_2 + ivec2(((1 << shift_3) - 1))), last_1));
    return _e29;
}

bool trace_middle(ImageLine line_6, LevelWalk middle, inout LineAccumulator light_2) {
    LevelWalk pixels = LevelWalk(AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0);
    LevelWalk _e5 = children(line_6, middle, 3u, PIXELS);
    pixels = _e5;
    while(true) {
        LevelWalk _e7 = pixels;
        bool _e10 = is_met(line_6, _e7, PIXELS, 0u);
        if (_e10) {
            int _e13 = pixels.y.cell;
            uint _e18 = _group_0_binding_0_fs.size.x;
            int _e22 = pixels.x.cell;
            uint pixel_1 = ((uint(_e13) * _e18) + uint(_e22));
            float _e26 = pixels.start;
            float _e28 = pixels.stop;
            bool _e29 = composite_list(line_6, pixel_1, _e26, _e28, light_2);
            if (_e29) {
                return true;
            }
        }
        bool _e31 = next_tile(pixels);
        if (!(_e31)) {
            break;
        }
    }
    return false;
}

bool trace_coarse(ImageLine line_7, LevelWalk coarse, inout LineAccumulator light_3) {
    LevelWalk middle_1 = LevelWalk(AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0);
    bool local_13 = false;
    LevelWalk _e5 = children(line_7, coarse, 2u, MIDDLE);
    middle_1 = _e5;
    while(true) {
        LevelWalk _e7 = middle_1;
        uint _e12 = _group_0_binding_0_fs.first_masks.x;
        bool _e13 = is_met(line_7, _e7, MIDDLE, _e12);
        if (_e13) {
            LevelWalk _e16 = middle_1;
            bool _e17 = trace_middle(line_7, _e16, light_3);
            local_13 = _e17;
        } else {
            local_13 = false;
        }
        bool _e19 = local_13;
        if (_e19) {
            return true;
        }
        bool _e21 = next_tile(middle_1);
        if (!(_e21)) {
            break;
        }
    }
    return false;
}

LineAccumulator trace(ImageLine line_8) {
    LineAccumulator light_4 = LineAccumulator(vec3(0.0), 1.0, 0u);
    LevelWalk coarse_1 = LevelWalk(AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), AxisWalk(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0);
    bool local_14 = false;
    uvec2 _e9 = _group_0_binding_0_fs.size;
    ivec2 last_2 = ivec2(((_e9 - uvec2(1u)) >> uvec2(5u)));
    if ((line_8.visible.x >= line_8.visible.y)) {
        LineAccumulator _e22 = light_4;
        return _e22;
    }
    LevelWalk _e30 = level_at(line_8, COARSE, line_8.visible.x, line_8.visible.y, ivec2(0), last_2);
    coarse_1 = _e30;
    while(true) {
        LevelWalk _e32 = coarse_1;
        uint _e37 = _group_0_binding_0_fs.first_masks.y;
        bool _e38 = is_met(line_8, _e32, COARSE, _e37);
        if (_e38) {
            LevelWalk _e41 = coarse_1;
            bool _e42 = trace_coarse(line_8, _e41, light_4);
            local_14 = _e42;
        } else {
            local_14 = false;
        }
        bool _e44 = local_14;
        if (_e44) {
            break;
        }
        bool _e45 = next_tile(coarse_1);
        if (!(_e45)) {
            break;
        }
    }
    LineAccumulator _e47 = light_4;
    return _e47;
}

vec3 color_along(ImageLine line_9) {
    LineAccumulator _e1 = trace(line_9);
    vec3 _e6 = _group_0_binding_1_fs.background;
    return min((_e1.color + (_e1.transmittance * _e6)), vec3(1.0));
}

RingColors ring(ImageLine line_10, vec2 by_1) {
    vec2 turned = vec2(0.0);
    vec3 pairs[2] = vec3[2](vec3(0.0), vec3(0.0));
    RingColors colors = RingColors(vec3(0.0), vec3(1.0), vec3(0.0));
    int n_13 = 0;
    turned = by_1;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            int _e46 = n_13;
            n_13 = (_e46 + 1);
        }
        loop_init_1 = false;
        int _e19 = n_13;
        if ((_e19 < 4)) {
        } else {
            break;
        }
        {
            vec2 _e22 = turned;
            ImageLine _e23 = displaced(line_10, _e22);
            vec3 _e24 = color_along(_e23);
            int _e25 = n_13;
            vec3 _e29 = pairs[(_e25 & 1)];
            pairs[(_e25 & 1)] = (_e29 + _e24);
            vec3 _e33 = colors.least;
            colors.least = min(_e33, _e24);
            vec3 _e37 = colors.most;
            colors.most = max(_e37, _e24);
            float _e40 = turned.y;
            float _e43 = turned.x;
            turned = vec2(-(_e40), _e43);
        }
    }
    vec3 _e50 = pairs[0];
    vec3 _e52 = pairs[1];
    colors.mean = (0.25 * (_e50 + _e52));
    RingColors _e56 = colors;
    return _e56;
}

vec3 color_at(uint i, uint j) {
    bool local_15 = false;
    uint _e9 = _group_0_binding_1_fs.width;
    uint _e19 = _group_0_binding_1_fs.height;
    ImageLine _e22 = line_at((float(((2u * i) + 1u)) - float(_e9)), (float(((2u * j) + 1u)) - float(_e19)));
    if ((_e22.steps <= 0.0)) {
        vec3 _e28 = _group_0_binding_1_fs.background;
        return _e28;
    }
    float _e31 = _group_0_binding_1_fs.margin;
    if ((_e31 == 0.0)) {
        vec3 _e34 = color_along(_e22);
        return _e34;
    }
    vec2 _e37 = _group_0_binding_1_fs.inner;
    RingColors _e38 = ring(_e22, _e37);
    vec3 spread = (_e38.most - _e38.least);
    float _e44 = _group_0_binding_1_fs.sharpness;
    if (!((_e44 == 0.0))) {
        local_15 = (max(spread.x, max(spread.y, spread.z)) <= EVEN);
    } else {
        local_15 = true;
    }
    bool _e58 = local_15;
    if (_e58) {
        return _e38.mean;
    }
    vec2 _e62 = _group_0_binding_1_fs.outer;
    RingColors _e63 = ring(_e22, _e62);
    float _e67 = _group_0_binding_1_fs.sharpness;
    return clamp((_e38.mean + (_e67 * (_e38.mean - _e63.mean))), _e38.least, _e38.most);
}

void main() {
    vec4 at = gl_FragCoord;
    uint _e5 = _group_0_binding_1_fs.height;
    vec3 _e11 = color_at(uint(at.x), ((_e5 - 1u) - uint(at.y)));
    _fs2p_location0 = vec4(_e11, 1.0);
    return;
}

