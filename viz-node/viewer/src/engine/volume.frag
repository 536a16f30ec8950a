#version 300 es

precision highp float;
precision highp int;

struct VolumeUniforms {
    uvec3 last;
    uint pad0_;
    uvec3 bricks;
    uint pad1_;
    vec3 low;
    float scale;
    vec3 high;
    float offset;
};
struct ViewUniforms {
    vec3 base;
    uint width;
    vec3 base_right;
    uint height;
    vec3 base_up;
    float slope;
    vec3 forward;
    float unit_steps;
    vec3 right;
    uint bins;
    vec3 up;
    uint below;
    vec2 visible;
    float near;
    uint pad0_;
};
struct EffectUniforms {
    vec3 light;
    float shadows;
    vec3 spacing;
    float occlusion;
    vec3 gradient;
    float ambient;
    vec3 light_scale;
    float diffuse;
    vec3 light_offset;
    uint pad0_;
    uvec3 light_dims;
    float specular;
    vec3 cue;
    float cue_from;
    float cue_per_step;
    float cue_strength;
    uint planes;
    uint color_points;
    vec4 before;
    vec4 beyond;
    vec4 levels[4];
    vec4 surfaces[4];
    vec4 half_spaces[14];
    vec4 color_map[16];
};
struct PictureUniforms {
    vec3 background;
    float floor_;
    uint first;
    uint count;
    uvec2 pad0_;
};
struct ClusteringUniforms {
    float gamma;
    float cutoff;
    uint first_row;
    uint rows;
    uint first_ray;
    uint end_ray;
    uint first_segment;
    uint writing;
};
struct GpuSegment {
    uint start;
    uint end;
    float red;
    float green;
    float blue;
    float optical_depth;
};
struct ScanUniforms {
    uint count;
    uint blocks;
    uvec2 pad0_;
};
struct TableRow {
    uint index;
    float weight;
};
struct Cell {
    uvec3 base;
    vec3 weight;
};
struct RaySpan {
    vec3 entry;
    vec3 delta;
    float length_;
    uint steps;
    float beyond;
};
struct MarchState {
    uint next;
    uint visible;
};
struct MarchSample {
    uint step_;
    float length_;
    TableRow row;
    float value;
    bool there;
};
struct RayClip {
    vec2 kept;
    vec3 half_;
};
struct ShadedStep {
    vec3 color;
    float depth;
    float length_;
};
struct IntegralSum {
    vec4 sum;
    vec4 rest;
    vec4 part;
};
const uint BRICK = 4u;
const float MIN_REMAINDER = 0.0001;
const float PARALLEL_EPSILON = 1e-12;
const float FAR = 1e30;
const float SHORTEST = 0.0001;
const float WEAK_GRADIENT = 0.01;
const float FEWEST_ROWS = 4.0;

uint KIND = 0u;

bool EFFECTS = false;

layout(std140) uniform VolumeUniforms_block_0Fragment { VolumeUniforms _group_0_binding_0_fs; };

layout(std140) uniform ViewUniforms_block_1Fragment { ViewUniforms _group_0_binding_1_fs; };

uniform highp usampler3D _group_0_binding_2_fs;

uniform highp usampler2D _group_0_binding_3_fs;

uniform highp usampler2D _group_0_binding_4_fs;

uniform highp usampler2D _group_0_binding_5_fs;

bool CLIPPED = false;

bool PRE_INTEGRATED = false;

uint SURFACES = 0u;

bool SHADED = false;

uint SHININESS = 0u;

bool SHADOWED = false;

bool OCCLUDED = false;

bool CUED = false;

bool COLORED = false;

layout(std140) uniform EffectUniforms_block_2Fragment { EffectUniforms _group_2_binding_0_fs; };

uniform highp usampler2D _group_2_binding_1_fs;

uniform highp usampler2D _group_2_binding_2_fs;

uniform highp usampler3D _group_2_binding_3_fs;

layout(std140) uniform PictureUniforms_block_3Fragment { PictureUniforms _group_1_binding_0_fs; };

layout(location = 0) out vec4 _fs2p_location0;

float opacity_from_optical_depth(float t) {
    if ((t < 0.25)) {
        return (t * (1.0 - ((t / 2.0) * (1.0 - ((t / 3.0) * (1.0 - ((t / 4.0) * (1.0 - ((t / 5.0) * (1.0 - (t / 6.0)))))))))));
    }
    return (1.0 - exp(-(t)));
}

vec2 clip(vec3 origin, vec3 direction, vec3 low, vec3 high) {
    float t_in = 0.0;
    float t_out = FAR;
    int axis = 0;
    bool local_1 = false;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            int _e48 = axis;
            axis = (_e48 + 1);
        }
        loop_init = false;
        int _e10 = axis;
        if ((_e10 < 3)) {
        } else {
            break;
        }
        {
            int _e13 = axis;
            float o = origin[_e13];
            int _e15 = axis;
            float d = direction[_e15];
            if ((abs(d) < PARALLEL_EPSILON)) {
                int _e20 = axis;
                if (!((o < low[_e20]))) {
                    int _e26 = axis;
                    local_1 = (o > high[_e26]);
                } else {
                    local_1 = true;
                }
                bool _e30 = local_1;
                if (_e30) {
                    return vec2(0.0);
                }
                continue;
            }
            int _e33 = axis;
            float a_1 = ((low[_e33] - o) / d);
            int _e37 = axis;
            float b_1 = ((high[_e37] - o) / d);
            float _e41 = t_in;
            t_in = max(_e41, min(a_1, b_1));
            float _e44 = t_out;
            t_out = min(_e44, max(a_1, b_1));
        }
    }
    float _e50 = t_in;
    float _e51 = t_out;
    return vec2(_e50, _e51);
}

uint steps(float length_) {
    return uint(max(ceil((length_ - MIN_REMAINDER)), 0.0));
}

TableRow row_at(float u, uint bins, uint below) {
    float x = max(((clamp(u, -1.0, 1.0) * float(bins)) + float(below)), 0.0);
    uint index_7 = min(uint(x), ((bins + below) - 1u));
    return TableRow(index_7, (x - float(index_7)));
}

Cell cell_at(vec3 index, uvec3 last) {
    vec3 x_1 = max(index, vec3(0.0));
    uvec3 base = min(uvec3(x_1), (max(last, uvec3(1u)) - uvec3(1u)));
    return Cell(base, min((x_1 - vec3(base)), vec3(1.0)));
}

uvec3 brick_at(vec3 index_1, uvec3 bricks) {
    return min((uvec3(max(index_1, vec3(0.0))) / uvec3(4u)), (bricks - uvec3(1u)));
}

uint jump(vec3 index_2, vec3 delta, uvec3 brick, uint distance_, uvec3 bricks_1) {
    float t_1 = 1000000000.0;
    int axis_1 = 0;
    bool local_2 = false;
    bool local_3 = false;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            int _e62 = axis_1;
            axis_1 = (_e62 + 1);
        }
        loop_init_1 = false;
        int _e9 = axis_1;
        if ((_e9 < 3)) {
        } else {
            break;
        }
        {
            int _e12 = axis_1;
            float d_1 = delta[_e12];
            if ((d_1 > PARALLEL_EPSILON)) {
                int _e18 = axis_1;
                int _e21 = axis_1;
                local_2 = ((brick[_e18] + distance_) < bricks_1[_e21]);
            } else {
                local_2 = false;
            }
            bool _e25 = local_2;
            if (_e25) {
                float _e26 = t_1;
                int _e27 = axis_1;
                int _e33 = axis_1;
                t_1 = min(_e26, ((float(((brick[_e27] + distance_) * BRICK)) - index_2[_e33]) / d_1));
            }
            if ((d_1 < -1e-12)) {
                int _e42 = axis_1;
                local_3 = (brick[_e42] >= distance_);
            } else {
                local_3 = false;
            }
            bool _e46 = local_3;
            if (_e46) {
                float _e47 = t_1;
                int _e48 = axis_1;
                int _e56 = axis_1;
                t_1 = min(_e47, ((float((((brick[_e48] + 1u) - distance_) * BRICK)) - index_2[_e56]) / d_1));
            }
        }
    }
    float _e64 = t_1;
    return uint(max(ceil(_e64), 1.0));
}

RaySpan ray_span(uint i, uint j) {
    uint _e9 = _group_0_binding_1_fs.width;
    float x_2 = (float(((2u * i) + 1u)) - float(_e9));
    uint _e14 = _group_0_binding_1_fs.height;
    float y = (float(_e14) - float(((2u * j) + 1u)));
    vec3 _e24 = _group_0_binding_1_fs.base;
    vec3 _e27 = _group_0_binding_1_fs.base_right;
    vec3 _e32 = _group_0_binding_1_fs.base_up;
    vec3 origin_1 = ((_e24 + (x_2 * _e27)) + (y * _e32));
    float _e37 = _group_0_binding_1_fs.slope;
    float _e40 = _group_0_binding_1_fs.slope;
    float square = ((_e37 * _e40) * ((x_2 * x_2) + (y * y)));
    float depth_1 = sqrt((1.0 + square));
    vec3 _e51 = _group_0_binding_1_fs.forward;
    vec3 _e54 = _group_0_binding_1_fs.right;
    vec3 _e59 = _group_0_binding_1_fs.up;
    vec3 delta_1 = (((_e51 + (x_2 * _e54)) + (y * _e59)) / vec3(depth_1));
    vec3 _e66 = _group_0_binding_0_fs.low;
    vec3 _e69 = _group_0_binding_0_fs.high;
    vec2 _e70 = clip(origin_1, delta_1, _e66, _e69);
    float length_1 = (_e70.y - _e70.x);
    if ((length_1 <= 0.0)) {
        return RaySpan(vec3(0.0), delta_1, 0.0, 0u, 0.0);
    }
    vec3 _e87 = _group_0_binding_0_fs.low;
    vec3 _e90 = _group_0_binding_0_fs.high;
    vec3 entry = clamp((origin_1 + (_e70.x * delta_1)), _e87, _e90);
    uint _e92 = steps(length_1);
    float _e95 = _group_0_binding_1_fs.near;
    return RaySpan(entry, delta_1, length_1, _e92, ((_e95 * (square / (depth_1 + 1.0))) + _e70.x));
}

bool is_unsure(RaySpan span) {
    bool local_4 = false;
    bool local_5 = false;
    vec3 middle = (span.entry + ((0.5 * span.length_) * span.delta));
    vec3 _e10 = _group_0_binding_0_fs.low;
    vec3 _e14 = _group_0_binding_0_fs.high;
    vec3 inside = min((middle - _e10), (_e14 - middle));
    if (!(((span.length_ - float((span.steps - 1u))) < 0.05))) {
        local_4 = (span.steps > 131072u);
    } else {
        local_4 = true;
    }
    bool _e32 = local_4;
    if (!(_e32)) {
        local_5 = (min(min(inside.x, inside.y), inside.z) < 0.01);
    } else {
        local_5 = true;
    }
    bool _e44 = local_5;
    return _e44;
}

uvec4 distances_texel(uint n) {
    uvec4 _e8 = texelFetch(_group_0_binding_3_fs, ivec2(uvec2((n & 2047u), (n >> 11u))), 0);
    return _e8;
}

uint distances_at(uint n_1) {
    uvec4 _e3 = distances_texel((n_1 >> 2u));
    return _e3[(n_1 & 3u)];
}

uint distance_at(uvec3 brick_1) {
    uint _e5 = _group_0_binding_0_fs.bricks.y;
    uint _e12 = _group_0_binding_0_fs.bricks.x;
    uint n_17 = ((((brick_1.z * _e5) + brick_1.y) * _e12) + brick_1.x);
    uint _e18 = distances_at((n_17 / 4u));
    return ((_e18 >> (8u * (n_17 % 4u))) & 255u);
}

bool is_empty(uint bits) {
    uint _e2 = KIND;
    if ((_e2 == 1u)) {
        return ((bits & 31744u) == 31744u);
    }
    uint _e10 = KIND;
    if ((_e10 == 2u)) {
        return ((bits & 2139095040u) == 2139095040u);
    }
    return false;
}

float lerp(float a, float b, float w) {
    return (a + (w * (b - a)));
}

float scalar(uint bits_1) {
    uint _e2 = KIND;
    if ((_e2 == 1u)) {
        return unpackHalf2x16(bits_1).x;
    }
    uint _e8 = KIND;
    if ((_e8 == 2u)) {
        return clamp(uintBitsToFloat(bits_1), -1e37, 1e37);
    }
    return float(bits_1);
}

bool value_at(vec3 index_3, inout float u_1) {
    bool local_6 = false;
    bool local_7 = false;
    bool local_8 = false;
    bool local_9 = false;
    bool local_10 = false;
    bool local_11 = false;
    bool local_12 = false;
    uvec3 _e4 = _group_0_binding_0_fs.last;
    Cell _e5 = cell_at(index_3, _e4);
    uvec3 a_2 = _e5.base;
    uvec3 _e12 = _group_0_binding_0_fs.last;
    uvec3 b_2 = min((a_2 + uvec3(1u)), _e12);
    uvec4 _e20 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(a_2.x, a_2.y, a_2.z)), 0);
    uint v000_ = _e20.x;
    uvec4 _e28 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(b_2.x, a_2.y, a_2.z)), 0);
    uint v100_ = _e28.x;
    uvec4 _e36 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(a_2.x, b_2.y, a_2.z)), 0);
    uint v010_ = _e36.x;
    uvec4 _e44 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(b_2.x, b_2.y, a_2.z)), 0);
    uint v110_ = _e44.x;
    uvec4 _e52 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(a_2.x, a_2.y, b_2.z)), 0);
    uint v001_ = _e52.x;
    uvec4 _e60 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(b_2.x, a_2.y, b_2.z)), 0);
    uint v101_ = _e60.x;
    uvec4 _e68 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(a_2.x, b_2.y, b_2.z)), 0);
    uint v011_ = _e68.x;
    uvec4 _e76 = texelFetch(_group_0_binding_2_fs, ivec3(uvec3(b_2.x, b_2.y, b_2.z)), 0);
    uint v111_ = _e76.x;
    bool _e78 = is_empty(v000_);
    if (!(_e78)) {
        bool _e82 = is_empty(v100_);
        local_6 = _e82;
    } else {
        local_6 = true;
    }
    bool _e84 = local_6;
    if (!(_e84)) {
        bool _e88 = is_empty(v010_);
        local_7 = _e88;
    } else {
        local_7 = true;
    }
    bool _e90 = local_7;
    if (!(_e90)) {
        bool _e94 = is_empty(v110_);
        local_8 = _e94;
    } else {
        local_8 = true;
    }
    bool _e96 = local_8;
    if (!(_e96)) {
        bool _e100 = is_empty(v001_);
        local_9 = _e100;
    } else {
        local_9 = true;
    }
    bool _e102 = local_9;
    if (!(_e102)) {
        bool _e106 = is_empty(v101_);
        local_10 = _e106;
    } else {
        local_10 = true;
    }
    bool _e108 = local_10;
    if (!(_e108)) {
        bool _e112 = is_empty(v011_);
        local_11 = _e112;
    } else {
        local_11 = true;
    }
    bool _e114 = local_11;
    if (!(_e114)) {
        bool _e118 = is_empty(v111_);
        local_12 = _e118;
    } else {
        local_12 = true;
    }
    bool empty = local_12;
    if (empty) {
        return false;
    }
    vec3 w_3 = _e5.weight;
    float _e123 = scalar(v000_);
    float _e124 = scalar(v100_);
    float _e126 = lerp(_e123, _e124, w_3.x);
    float _e127 = scalar(v010_);
    float _e128 = scalar(v110_);
    float _e130 = lerp(_e127, _e128, w_3.x);
    float _e132 = lerp(_e126, _e130, w_3.y);
    float _e133 = scalar(v001_);
    float _e134 = scalar(v101_);
    float _e136 = lerp(_e133, _e134, w_3.x);
    float _e137 = scalar(v011_);
    float _e138 = scalar(v111_);
    float _e140 = lerp(_e137, _e138, w_3.x);
    float _e142 = lerp(_e136, _e140, w_3.y);
    float _e145 = _group_0_binding_0_fs.scale;
    float _e147 = lerp(_e132, _e142, w_3.z);
    float _e151 = _group_0_binding_0_fs.offset;
    u_1 = ((_e145 * _e147) + _e151);
    return true;
}

MarchSample next_sample(RaySpan span_1, inout MarchState state) {
    float u_2 = 0.0;
    bool local_13 = false;
    bool local_14 = false;
    bool local_15 = false;
    while(true) {
        uint _e3 = state.next;
        if ((_e3 < span_1.steps)) {
        } else {
            break;
        }
        {
            uint step_ = state.next;
            float length_2 = min((span_1.length_ - float(step_)), 1.0);
            vec3 index_8 = (span_1.entry + ((float(step_) + (0.5 * length_2)) * span_1.delta));
            uint _e22 = state.visible;
            if ((step_ >= _e22)) {
                uvec3 _e26 = _group_0_binding_0_fs.bricks;
                uvec3 _e27 = brick_at(index_8, _e26);
                uint _e28 = distance_at(_e27);
                uvec3 _e34 = _group_0_binding_0_fs.bricks;
                uint _e35 = jump(index_8, span_1.delta, _e27, max(_e28, 1u), _e34);
                uint beyond = (step_ + _e35);
                if ((_e28 > 0u)) {
                    state.next = beyond;
                    continue;
                }
                state.visible = beyond;
            }
            state.next = (step_ + 1u);
            u_2 = 0.0;
            bool _e46 = value_at(index_8, u_2);
            bool _e48 = EFFECTS;
            if (!(_e48)) {
                if (_e46) {
                    float _e54 = u_2;
                    float _e58 = _group_0_binding_1_fs.visible.x;
                    local_14 = (_e54 >= _e58);
                } else {
                    local_14 = false;
                }
                bool _e61 = local_14;
                if (_e61) {
                    float _e64 = u_2;
                    float _e68 = _group_0_binding_1_fs.visible.y;
                    local_15 = (_e64 <= _e68);
                } else {
                    local_15 = false;
                }
                bool _e71 = local_15;
                local_13 = _e71;
            } else {
                local_13 = true;
            }
            bool _e73 = local_13;
            if (_e73) {
                float _e74 = u_2;
                uint _e77 = _group_0_binding_1_fs.bins;
                uint _e80 = _group_0_binding_1_fs.below;
                TableRow _e81 = row_at(_e74, _e77, _e80);
                float _e82 = u_2;
                return MarchSample(step_, length_2, _e81, _e82, _e46);
            }
        }
    }
    return MarchSample(span_1.steps, 0.0, TableRow(0u, 0.0), 0.0, false);
}

uvec4 step_rows_texel(uint n_2) {
    uvec4 _e8 = texelFetch(_group_0_binding_4_fs, ivec2(uvec2((n_2 & 2047u), (n_2 >> 11u))), 0);
    return _e8;
}

vec4 step_rows_at(uint n_3) {
    uvec4 _e1 = step_rows_texel(n_3);
    return uintBitsToFloat(_e1);
}

vec4 step_row(TableRow row) {
    vec4 _e2 = step_rows_at(row.index);
    vec4 _e7 = step_rows_at((row.index + 1u));
    return (_e2 + (row.weight * (_e7 - _e2)));
}

uvec4 unit_rows_texel(uint n_4) {
    uvec4 _e8 = texelFetch(_group_0_binding_5_fs, ivec2(uvec2((n_4 & 2047u), (n_4 >> 11u))), 0);
    return _e8;
}

vec4 unit_rows_at(uint n_5) {
    uvec4 _e1 = unit_rows_texel(n_5);
    return uintBitsToFloat(_e1);
}

vec4 unit_row(TableRow row_1) {
    vec4 _e4 = unit_rows_at((2u * row_1.index));
    vec4 _e11 = unit_rows_at(((2u * row_1.index) + 2u));
    return (_e4 + (row_1.weight * (_e11 - _e4)));
}

vec2 depth_row(TableRow row_2) {
    vec4 _e6 = unit_rows_at(((2u * row_2.index) + 1u));
    vec2 a_3 = _e6.xy;
    vec4 _e14 = unit_rows_at(((2u * row_2.index) + 3u));
    return (a_3 + (row_2.weight * (_e14.xy - a_3)));
}

RayClip clip_ray(RaySpan span_2) {
    vec2 kept = vec2(0.0);
    uint n_6 = 0u;
    vec3 half_ = vec3(0.0);
    kept = vec2(0.0, span_2.length_);
    bool _e6 = CLIPPED;
    if (_e6) {
        bool loop_init_2 = true;
        while(true) {
            if (!loop_init_2) {
                uint _e47 = n_6;
                n_6 = (_e47 + 1u);
            }
            loop_init_2 = false;
            uint _e9 = n_6;
            uint _e12 = _group_2_binding_0_fs.planes;
            if ((_e9 < _e12)) {
            } else {
                break;
            }
            {
                uint _e16 = n_6;
                vec4 plane = _group_2_binding_0_fs.half_spaces[_e16];
                float room = (plane.w - dot(plane.xyz, span_2.entry));
                float speed = dot(plane.xyz, span_2.delta);
                if ((speed > 0.0)) {
                    float _e31 = kept.y;
                    kept.y = min(_e31, (room / speed));
                } else {
                    if ((speed < 0.0)) {
                        float _e38 = kept.x;
                        kept.x = max(_e38, (room / speed));
                    } else {
                        if ((room < 0.0)) {
                            float _e45 = kept.x;
                            kept.y = _e45;
                        }
                    }
                }
            }
        }
        float _e51 = kept.x;
        float _e53 = kept.y;
        kept.y = max(_e51, _e53);
    }
    bool _e59 = SHADED;
    if (_e59) {
        vec3 _e62 = _group_2_binding_0_fs.light;
        vec3 _e66 = _group_2_binding_0_fs.spacing;
        vec3 sum_1 = (_e62 - normalize((span_2.delta * _e66)));
        float size = length(sum_1);
        half_ = ((size > 0.0) ? (sum_1 / vec3(size)) : vec3(0.0));
    }
    vec2 _e78 = kept;
    vec3 _e79 = half_;
    return RayClip(_e78, _e79);
}

uvec4 sums_texel(uint n_7) {
    uvec4 _e8 = texelFetch(_group_2_binding_1_fs, ivec2(uvec2((n_7 & 2047u), (n_7 >> 11u))), 0);
    return _e8;
}

vec4 sums_at(uint n_8) {
    uvec4 _e1 = sums_texel(n_8);
    return uintBitsToFloat(_e1);
}

IntegralSum sum_at(float u_3) {
    uint _e5 = _group_0_binding_1_fs.bins;
    TableRow _e7 = row_at(max(u_3, 0.0), _e5, 0u);
    uint n_18 = (3u * _e7.index);
    uint _e17 = _group_0_binding_1_fs.bins;
    float beyond_1 = ((u_3 - clamp(u_3, 0.0, 1.0)) * float(_e17));
    vec4 _e23 = sums_at((n_18 + 2u));
    vec4 _e27 = _group_2_binding_0_fs.before;
    vec4 _e30 = _group_2_binding_0_fs.beyond;
    vec4 part = ((_e7.weight * _e23) + (beyond_1 * ((u_3 > 0.5) ? _e30 : _e27)));
    vec4 _e36 = sums_at(n_18);
    vec4 _e39 = sums_at((n_18 + 1u));
    return IntegralSum(_e36, _e39, part);
}

void own_color(vec3 index_4, inout vec3 color) {
    float u_4 = 0.0;
    uint n_9 = 0u;
    vec4 before = vec4(0.0);
    vec3 mapped = vec3(0.0);
    uint n_10 = 1u;
    uvec3 _e4 = _group_0_binding_0_fs.last;
    Cell _e5 = cell_at(index_4, _e4);
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            uint _e58 = n_9;
            n_9 = (_e58 + 1u);
        }
        loop_init_3 = false;
        uint _e10 = n_9;
        if ((_e10 < 8u)) {
        } else {
            break;
        }
        {
            uint _e13 = n_9;
            uint _e16 = n_9;
            uint _e21 = n_9;
            uvec3 corner = uvec3((_e13 & 1u), ((_e16 >> 1u) & 1u), (_e21 >> 2u));
            uvec3 _e30 = _group_0_binding_0_fs.last;
            uvec4 _e33 = texelFetch(_group_2_binding_3_fs, ivec3(min((_e5.base + corner), _e30)), 0);
            uint bits_2 = _e33.x;
            if (((bits_2 & 2139095040u) == 2139095040u)) {
                return;
            }
            vec3 w_4 = mix((vec3(1.0) - _e5.weight), _e5.weight, equal(corner, uvec3(1u)));
            float _e48 = u_4;
            u_4 = (_e48 + (((w_4.x * w_4.y) * w_4.z) * uintBitsToFloat(bits_2)));
        }
    }
    vec4 _e63 = _group_2_binding_0_fs.color_map[0];
    before = _e63;
    vec4 _e65 = before;
    mapped = _e65.xyz;
    bool loop_init_4 = true;
    while(true) {
        if (!loop_init_4) {
            uint _e99 = n_10;
            n_10 = (_e99 + 1u);
        }
        loop_init_4 = false;
        uint _e70 = n_10;
        uint _e73 = _group_2_binding_0_fs.color_points;
        if ((_e70 < _e73)) {
        } else {
            break;
        }
        {
            uint _e77 = n_10;
            vec4 next = _group_2_binding_0_fs.color_map[_e77];
            vec3 _e80 = mapped;
            float _e81 = u_4;
            float _e83 = before.w;
            float _e87 = before.w;
            vec3 _e94 = mapped;
            mapped = (_e80 + (clamp(((_e81 - _e83) / (next.w - _e87)), 0.0, 1.0) * (next.xyz - _e94)));
            before = next;
        }
    }
    vec3 _e101 = mapped;
    color = _e101;
    return;
}

uvec4 light_volume_texel(uint n_11) {
    uvec4 _e8 = texelFetch(_group_2_binding_2_fs, ivec2(uvec2((n_11 & 2047u), (n_11 >> 11u))), 0);
    return _e8;
}

float light_volume_at(uint n_12) {
    uvec4 _e3 = light_volume_texel((n_12 >> 2u));
    return uintBitsToFloat(_e3[(n_12 & 3u)]);
}

float light_along_x(uint n_13, float w_1) {
    float _e2 = light_volume_at(n_13);
    float _e5 = light_volume_at((n_13 + 1u));
    return mix(_e2, _e5, w_1);
}

float light_at(vec3 index_5, uint start) {
    vec3 _e4 = _group_2_binding_0_fs.light_scale;
    vec3 _e8 = _group_2_binding_0_fs.light_offset;
    uvec3 _e14 = _group_2_binding_0_fs.light_dims;
    vec3 x_3 = clamp(((index_5 * _e4) + _e8), vec3(0.0), vec3((_e14 - uvec3(1u))));
    uvec3 _e23 = _group_2_binding_0_fs.light_dims;
    uvec3 base_1 = min(uvec3(x_3), (_e23 - uvec3(2u)));
    vec3 w_5 = (x_3 - vec3(base_1));
    uint row_3 = _group_2_binding_0_fs.light_dims.x;
    uint _e37 = _group_2_binding_0_fs.light_dims.y;
    uint slice = (row_3 * _e37);
    uint n_19 = (((start + (base_1.z * slice)) + (base_1.y * row_3)) + base_1.x);
    float _e48 = light_along_x(n_19, w_5.x);
    float _e51 = light_along_x((n_19 + row_3), w_5.x);
    float near = mix(_e48, _e51, w_5.y);
    float _e56 = light_along_x((n_19 + slice), w_5.x);
    float _e60 = light_along_x(((n_19 + slice) + row_3), w_5.x);
    float far = mix(_e56, _e60, w_5.y);
    return mix(near, far, w_5.z);
}

bool gradient_at(vec3 index_6, inout vec3 gradient) {
    int axis_2 = 0;
    vec3 side = vec3(0.0);
    float low_1 = 0.0;
    float high_1 = 0.0;
    bool local_16 = false;
    bool loop_init_5 = true;
    while(true) {
        if (!loop_init_5) {
            int _e35 = axis_2;
            axis_2 = (_e35 + 1);
        }
        loop_init_5 = false;
        int _e4 = axis_2;
        if ((_e4 < 3)) {
        } else {
            break;
        }
        {
            side = vec3(0.0);
            int _e10 = axis_2;
            side[_e10] = 1.0;
            low_1 = 0.0;
            high_1 = 0.0;
            vec3 _e17 = side;
            bool _e19 = value_at((index_6 - _e17), low_1);
            vec3 _e20 = side;
            bool _e22 = value_at((index_6 + _e20), high_1);
            if (_e19) {
                local_16 = _e22;
            } else {
                local_16 = false;
            }
            bool _e26 = local_16;
            if (!(_e26)) {
                return false;
            }
            int _e29 = axis_2;
            float _e31 = high_1;
            float _e32 = low_1;
            gradient[_e29] = (_e31 - _e32);
        }
    }
    vec3 _e37 = gradient;
    vec3 _e40 = _group_2_binding_0_fs.gradient;
    gradient = (_e37 * _e40);
    vec3 _e42 = gradient;
    vec3 _e43 = gradient;
    return (dot(_e42, _e43) > 0.0);
}

vec3 shade(vec3 straight, RaySpan span_3, RayClip clipped, float t_2) {
    vec3 color_1 = vec3(0.0);
    float shadow = 1.0;
    float open = 1.0;
    float scale = 0.0;
    float highlight = 0.0;
    vec3 gradient_1 = vec3(0.0);
    float gloss = 0.0;
    uint k = 0u;
    bool local_17 = false;
    bool local_18 = false;
    color_1 = straight;
    vec3 index_9 = (span_3.entry + (t_2 * span_3.delta));
    bool _e14 = SHADOWED;
    if (_e14) {
        float _e17 = _group_2_binding_0_fs.shadows;
        float _e19 = light_at(index_9, 0u);
        shadow = (1.0 - (_e17 * (1.0 - _e19)));
    }
    bool _e26 = OCCLUDED;
    if (_e26) {
        uint _e30 = _group_2_binding_0_fs.light_dims.x;
        uint _e34 = _group_2_binding_0_fs.light_dims.y;
        uint _e39 = _group_2_binding_0_fs.light_dims.z;
        uint all_ = ((_e30 * _e34) * _e39);
        float _e43 = _group_2_binding_0_fs.occlusion;
        bool _e46 = SHADOWED;
        float _e48 = light_at(index_9, (_e46 ? all_ : 0u));
        open = (1.0 - (_e43 * (1.0 - _e48)));
    }
    float _e54 = open;
    float _e55 = shadow;
    scale = (_e54 * _e55);
    bool _e61 = SHADED;
    if (_e61) {
        bool _e65 = gradient_at(index_9, gradient_1);
        if (_e65) {
            vec3 _e66 = gradient_1;
            float size_1 = length(_e66);
            float share = (size_1 / (size_1 + WEAK_GRADIENT));
            vec3 _e71 = gradient_1;
            vec3 normal = (_e71 / vec3(size_1));
            gloss = abs(dot(normal, clipped.half_));
            bool loop_init_6 = true;
            while(true) {
                if (!loop_init_6) {
                    uint _e88 = k;
                    k = (_e88 + 1u);
                }
                loop_init_6 = false;
                uint _e80 = k;
                uint _e82 = SHININESS;
                if ((_e80 < _e82)) {
                } else {
                    break;
                }
                {
                    float _e84 = gloss;
                    float _e85 = gloss;
                    gloss = (_e84 * _e85);
                }
            }
            float _e92 = _group_2_binding_0_fs.ambient;
            float _e93 = open;
            float _e97 = _group_2_binding_0_fs.diffuse;
            vec3 _e100 = _group_2_binding_0_fs.light;
            float _e104 = shadow;
            float lit = ((_e92 * _e93) + ((_e97 * abs(dot(normal, _e100))) * _e104));
            float _e109 = scale;
            scale = (((1.0 - share) * _e109) + (share * lit));
            float _e115 = _group_2_binding_0_fs.specular;
            float _e117 = gloss;
            float _e119 = shadow;
            highlight = (((share * _e115) * _e117) * _e119);
        }
    }
    bool _e122 = SHADOWED;
    if (!(_e122)) {
        bool _e127 = OCCLUDED;
        local_17 = _e127;
    } else {
        local_17 = true;
    }
    bool _e129 = local_17;
    if (!(_e129)) {
        bool _e134 = SHADED;
        local_18 = _e134;
    } else {
        local_18 = true;
    }
    bool _e136 = local_18;
    if (_e136) {
        vec3 _e137 = color_1;
        float _e138 = scale;
        float _e140 = highlight;
        color_1 = clamp(((_e137 * _e138) + vec3(_e140)), vec3(0.0), vec3(1.0));
    }
    bool _e149 = CUED;
    if (_e149) {
        float _e152 = _group_2_binding_0_fs.cue_from;
        float _e158 = _group_2_binding_0_fs.cue_per_step;
        float _e162 = _group_2_binding_0_fs.cue_strength;
        float fade = clamp((((_e152 + span_3.beyond) + t_2) * _e158), 0.0, _e162);
        vec3 _e165 = color_1;
        vec3 _e168 = _group_2_binding_0_fs.cue;
        vec3 _e169 = color_1;
        color_1 = (_e165 + (fade * (_e168 - _e169)));
    }
    vec3 _e173 = color_1;
    return _e173;
}

float crossing(RaySpan span_4, vec2 at_1, vec2 ends, float level) {
    float w_2 = 0.0;
    float first_1 = ((level - ends.x) / (ends.y - ends.x));
    bool _e20 = value_at((span_4.entry + ((at_1.x + (first_1 * at_1.y)) * span_4.delta)), w_2);
    if (!(_e20)) {
        return first_1;
    }
    float _e22 = w_2;
    bool behind = ((_e22 < level) == (ends.x < level));
    float _e30 = w_2;
    vec2 near_1 = (behind ? vec2(first_1, _e30) : vec2(0.0, ends.x));
    float _e33 = w_2;
    vec2 far_1 = (behind ? vec2(1.0, ends.y) : vec2(first_1, _e33));
    if ((near_1.y == far_1.y)) {
        return first_1;
    }
    return clamp((near_1.x + (((level - near_1.y) / (far_1.y - near_1.y)) * (far_1.x - near_1.x))), 0.0, 1.0);
}

ShadedStep meet_surfaces(RaySpan span_5, RayClip clipped_1, vec2 at_2, vec2 ends_1, ShadedStep medium) {
    vec3 sum = vec3(0.0);
    float through = 1.0;
    float place = 0.0;
    float met = 0.0;
    uint k_1 = 0u;
    bool local_19 = false;
    bool local_20 = false;
    bool local_21 = false;
    bool loop_init_7 = true;
    while(true) {
        if (!loop_init_7) {
            uint _e103 = k_1;
            k_1 = (_e103 + 1u);
        }
        loop_init_7 = false;
        uint _e16 = k_1;
        uint _e18 = SURFACES;
        if ((_e16 < _e18)) {
        } else {
            break;
        }
        {
            uint _e20 = k_1;
            uint _e22 = SURFACES;
            uint _e25 = k_1;
            uint n_20 = ((ends_1.y < ends_1.x) ? ((_e22 - 1u) - _e25) : _e20);
            float level_1 = _group_2_binding_0_fs.levels[n_20].x;
            if ((ends_1.x < level_1)) {
                local_19 = (level_1 <= ends_1.y);
            } else {
                local_19 = false;
            }
            bool _e43 = local_19;
            if (!(_e43)) {
                if ((ends_1.y < level_1)) {
                    local_21 = (level_1 <= ends_1.x);
                } else {
                    local_21 = false;
                }
                bool _e54 = local_21;
                local_20 = _e54;
            } else {
                local_20 = true;
            }
            bool _e56 = local_20;
            if (!(_e56)) {
                continue;
            }
            float _e58 = crossing(span_5, at_2, ends_1, level_1);
            float _e60 = place;
            float _e65 = opacity_from_optical_depth((medium.depth * max((_e58 - _e60), 0.0)));
            vec3 _e66 = sum;
            float _e67 = through;
            sum = (_e66 + ((_e67 * _e65) * medium.color));
            float _e72 = through;
            float _e73 = through;
            through = (_e72 - (_e73 * _e65));
            vec4 surface = _group_2_binding_0_fs.surfaces[n_20];
            float _e81 = opacity_from_optical_depth(surface.w);
            vec3 _e82 = sum;
            float _e83 = through;
            vec3 _e90 = shade(surface.xyz, span_5, clipped_1, (at_2.x + (_e58 * at_2.y)));
            sum = (_e82 + ((_e83 * _e81) * _e90));
            float _e93 = through;
            float _e94 = through;
            through = (_e93 - (_e94 * _e81));
            float _e97 = place;
            place = max(_e97, _e58);
            float _e99 = met;
            met = (_e99 + surface.w);
        }
    }
    float _e105 = met;
    if ((_e105 == 0.0)) {
        return medium;
    }
    float _e109 = place;
    float _e113 = opacity_from_optical_depth((medium.depth * (1.0 - _e109)));
    vec3 _e114 = sum;
    float _e115 = through;
    sum = (_e114 + ((_e115 * _e113) * medium.color));
    float _e120 = through;
    float _e121 = through;
    through = (_e120 - (_e121 * _e113));
    float _e125 = met;
    float _e127 = opacity_from_optical_depth((medium.depth + _e125));
    vec3 _e128 = sum;
    float _e135 = met;
    return ShadedStep(min((_e128 / vec3(_e127)), vec3(1.0)), (medium.depth + _e135), medium.length_);
}

ShadedStep shade_sample(RaySpan span_6, RayClip clipped_2, MarchSample s) {
    float first = 0.0;
    float last_1 = 0.0;
    float u_5 = 0.0;
    bool there = false;
    vec3 color_2 = vec3(0.0);
    float depth = 0.0;
    bool local_22 = false;
    bool local_23 = false;
    float low_2 = 0.0;
    float high_2 = 0.0;
    bool whole = false;
    bool local_24 = false;
    bool local_25 = false;
    bool local_26 = false;
    first = float(s.step_);
    float _e6 = first;
    last_1 = min((_e6 + 1.0), span_6.length_);
    bool _e13 = CLIPPED;
    if (_e13) {
        float _e14 = first;
        first = max(_e14, clipped_2.kept.x);
        float _e18 = last_1;
        last_1 = min(_e18, clipped_2.kept.y);
    }
    float _e22 = last_1;
    float _e23 = first;
    float size_2 = (_e22 - _e23);
    if ((size_2 <= SHORTEST)) {
        return ShadedStep(vec3(0.0), 0.0, 0.0);
    }
    float _e32 = first;
    float _e33 = last_1;
    float middle_1 = (0.5 * (_e32 + _e33));
    u_5 = s.value;
    there = s.there;
    bool _e42 = CLIPPED;
    if (_e42) {
        bool _e47 = value_at((span_6.entry + (middle_1 * span_6.delta)), u_5);
        there = _e47;
    }
    bool _e53 = there;
    if (_e53) {
        float _e56 = u_5;
        float _e60 = _group_0_binding_1_fs.visible.x;
        local_22 = (_e56 >= _e60);
    } else {
        local_22 = false;
    }
    bool _e63 = local_22;
    if (_e63) {
        float _e66 = u_5;
        float _e70 = _group_0_binding_1_fs.visible.y;
        local_23 = (_e66 <= _e70);
    } else {
        local_23 = false;
    }
    bool _e73 = local_23;
    if (_e73) {
        float _e74 = u_5;
        uint _e77 = _group_0_binding_1_fs.bins;
        uint _e80 = _group_0_binding_1_fs.below;
        TableRow _e81 = row_at(_e74, _e77, _e80);
        vec4 _e82 = unit_row(_e81);
        if ((_e82.w > 0.0)) {
            color_2 = (_e82.xyz / vec3(_e82.w));
            vec2 _e90 = depth_row(_e81);
            depth = (_e90.x * size_2);
        }
    }
    bool _e100 = PRE_INTEGRATED;
    if (!(_e100)) {
        uint _e105 = SURFACES;
        local_24 = (_e105 > 0u);
    } else {
        local_24 = true;
    }
    bool _e109 = local_24;
    if (_e109) {
        float _e111 = first;
        bool _e115 = value_at((span_6.entry + (_e111 * span_6.delta)), low_2);
        float _e117 = last_1;
        bool _e121 = value_at((span_6.entry + (_e117 * span_6.delta)), high_2);
        if (_e115) {
            local_25 = _e121;
        } else {
            local_25 = false;
        }
        bool _e125 = local_25;
        whole = _e125;
    }
    bool _e127 = PRE_INTEGRATED;
    if (_e127) {
        bool _e128 = whole;
        if (_e128) {
            float _e131 = high_2;
            float _e132 = low_2;
            uint _e137 = _group_0_binding_1_fs.bins;
            local_26 = ((abs((_e131 - _e132)) * float(_e137)) >= FEWEST_ROWS);
        } else {
            local_26 = false;
        }
        bool _e143 = local_26;
        if (_e143) {
            float _e144 = low_2;
            IntegralSum _e145 = sum_at(_e144);
            float _e146 = high_2;
            IntegralSum _e147 = sum_at(_e146);
            vec4 sum_2 = (((_e147.sum - _e145.sum) + (_e147.rest - _e145.rest)) + (_e147.part - _e145.part));
            color_2 = vec3(0.0);
            if ((sum_2.w != 0.0)) {
                color_2 = clamp((sum_2.xyz / vec3(sum_2.w)), vec3(0.0), vec3(1.0));
            }
            float _e174 = high_2;
            float _e175 = low_2;
            uint _e179 = _group_0_binding_1_fs.bins;
            depth = max(((sum_2.w / ((_e174 - _e175) * float(_e179))) * size_2), 0.0);
        }
    }
    float _e186 = depth;
    if ((_e186 > 0.0)) {
        bool _e190 = COLORED;
        if (_e190) {
            own_color((span_6.entry + (middle_1 * span_6.delta)), color_2);
        }
        vec3 _e195 = color_2;
        vec3 _e196 = shade(_e195, span_6, clipped_2, middle_1);
        color_2 = _e196;
    }
    uint _e198 = SURFACES;
    if ((_e198 > 0u)) {
        bool _e201 = whole;
        if (_e201) {
            float _e202 = first;
            float _e204 = low_2;
            float _e205 = high_2;
            vec3 _e207 = color_2;
            float _e208 = depth;
            ShadedStep _e210 = meet_surfaces(span_6, clipped_2, vec2(_e202, size_2), vec2(_e204, _e205), ShadedStep(_e207, _e208, size_2));
            return _e210;
        }
    }
    vec3 _e211 = color_2;
    float _e212 = depth;
    return ShadedStep(_e211, _e212, size_2);
}

vec4 short_step(MarchSample s_1) {
    vec4 _e2 = unit_row(s_1.row);
    if ((_e2.w <= 0.0)) {
        return vec4(0.0);
    }
    vec2 _e9 = depth_row(s_1.row);
    float _e13 = opacity_from_optical_depth((_e9.x * s_1.length_));
    return vec4((_e2.xyz * (_e13 / _e2.w)), _e13);
}

vec3 color_at(uint i_1, uint j_1) {
    vec3 color_3 = vec3(0.0);
    float transmittance = 1.0;
    MarchState state_1 = MarchState(0u, 0u);
    MarchSample s_2 = MarchSample(0u, 0.0, TableRow(0u, 0.0), 0.0, false);
    bool local_27 = false;
    MarchState state_2 = MarchState(0u, 0u);
    MarchSample s_3 = MarchSample(0u, 0.0, TableRow(0u, 0.0), 0.0, false);
    vec4 piece = vec4(0.0);
    RaySpan _e2 = ray_span(i_1, j_1);
    bool _e9 = EFFECTS;
    if (_e9) {
        RayClip _e10 = clip_ray(_e2);
        state_1 = MarchState(uint(max(_e10.kept.x, 0.0)), 0u);
        MarchSample _e19 = next_sample(_e2, state_1);
        s_2 = _e19;
        while(true) {
            uint _e22 = s_2.step_;
            if ((_e22 < _e2.steps)) {
                uint _e28 = s_2.step_;
                local_27 = (float(_e28) < _e10.kept.y);
            } else {
                local_27 = false;
            }
            bool _e34 = local_27;
            if (_e34) {
            } else {
                break;
            }
            {
                MarchSample _e35 = s_2;
                ShadedStep _e36 = shade_sample(_e2, _e10, _e35);
                float _e38 = opacity_from_optical_depth(_e36.depth);
                vec3 _e39 = color_3;
                float _e40 = transmittance;
                color_3 = (_e39 + ((_e40 * _e38) * _e36.color));
                float _e45 = transmittance;
                transmittance = (_e45 * (1.0 - _e38));
                float _e49 = transmittance;
                float _e52 = _group_1_binding_0_fs.floor_;
                if ((_e49 < _e52)) {
                    break;
                }
                MarchSample _e54 = next_sample(_e2, state_1);
                s_2 = _e54;
            }
        }
        vec3 _e55 = color_3;
        float _e56 = transmittance;
        vec3 _e59 = _group_1_binding_0_fs.background;
        return min((_e55 + (_e56 * _e59)), vec3(1.0));
    }
    MarchSample _e69 = next_sample(_e2, state_2);
    s_3 = _e69;
    while(true) {
        uint _e72 = s_3.step_;
        if ((_e72 < _e2.steps)) {
        } else {
            break;
        }
        {
            TableRow _e76 = s_3.row;
            vec4 _e77 = step_row(_e76);
            piece = _e77;
            float _e80 = s_3.length_;
            if ((_e80 < 1.0)) {
                MarchSample _e83 = s_3;
                vec4 _e84 = short_step(_e83);
                piece = _e84;
            }
            vec3 _e85 = color_3;
            float _e86 = transmittance;
            vec4 _e87 = piece;
            color_3 = (_e85 + (_e86 * _e87.xyz));
            float _e91 = transmittance;
            float _e93 = piece.w;
            transmittance = (_e91 * (1.0 - _e93));
            float _e97 = transmittance;
            float _e100 = _group_1_binding_0_fs.floor_;
            if ((_e97 < _e100)) {
                break;
            }
            MarchSample _e102 = next_sample(_e2, state_2);
            s_3 = _e102;
        }
    }
    vec3 _e103 = color_3;
    float _e104 = transmittance;
    vec3 _e107 = _group_1_binding_0_fs.background;
    return min((_e103 + (_e104 * _e107)), vec3(1.0));
}

void main() {
    vec4 at = gl_FragCoord;
    uint _e5 = _group_0_binding_1_fs.height;
    vec3 _e11 = color_at(uint(at.x), ((_e5 - 1u) - uint(at.y)));
    _fs2p_location0 = vec4(_e11, 1.0);
    return;
}

