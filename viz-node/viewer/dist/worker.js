const B={azimuth:0,elevation:0,zoom:1,right:0,up:0,ahead:0,roll:0},x=1<<29,I=a=>[a.azimuth,a.elevation,a.zoom,a.right,a.up,a.ahead,a.roll];class w{constructor(e,n){this.wasm=e,this.module=n}static async load(e){return w.of(await WebAssembly.compileStreaming(fetch(e)))}static async of(e){const{exports:n}=await WebAssembly.instantiate(e,{});return new w(n,e)}open(e){return{handle:this.checked(this.wasm.lamina_open(this.fill(e),e.length,x)),description:this.json()}}bandSizes(e){return this.checked(this.wasm.lamina_band_sizes(this.fill(e),e.length,x)),this.json()}beginGeometry(e,n){this.checked(this.wasm.lamina_begin_geometry(this.fill(e),e.length,n,x))}geometry(){this.checked(this.wasm.lamina_geometry());const e=this.raw();return e.length===0?null:e.slice()}beginColors(e,n){this.checked(this.wasm.lamina_begin_colors(this.fill(e),e.length,n,x))}color(e){this.checked(this.wasm.lamina_color(this.fill(e),e.length))}endColors(){return this.checked(this.wasm.lamina_end_colors()),this.raw().slice()}join(e,n){const _=n.reduce((i,l)=>i+l.length,e.length),t=this.fill(e,...n);return{handle:this.checked(this.wasm.lamina_join(t,e.length,_,x)),description:this.json()}}withAppearance(e,n){const _=new TextEncoder().encode(n);return{handle:this.checked(this.wasm.lamina_with_appearance(e,this.fill(_),_.length)),description:this.json()}}close(e){this.wasm.lamina_close(e)}source(e){return this.checked(this.wasm.lamina_source(e==="vdi"?0:1)),this.json()}bindings(e){return this.checked(this.wasm.lamina_bindings(e)),this.resources()}view(e,n,_,t,[o,i]){return this.checked(this.wasm.lamina_view(e,...I(n),_,_,Number(t),o,i)),this.resources()}slice(e,n,_){this.checked(this.wasm.lamina_slice(e,n,_));const{json:t,content:o}=this.answer(),[i,l]=t;return{width:i,height:l,units:new Float32Array(o.slice(0,4*i*l).buffer)}}begin(e,n,_,t,o){this.checked(this.wasm.lamina_begin(e,...I(n),_,t,Number(o)))}advance(){if(this.checked(this.wasm.lamina_advance()),this.wasm.lamina_answer_length()===0)return null;const{content:e}=this.answer();return new Uint8ClampedArray(e)}fill(...e){const n=this.wasm.lamina_room(e.reduce((t,o)=>t+o.length,0));let _=n;for(const t of e)new Uint8Array(this.wasm.memory.buffer,_,t.length).set(t),_+=t.length;return n}raw(){return new Uint8Array(this.wasm.memory.buffer,this.wasm.lamina_answer(),this.wasm.lamina_answer_length())}checked(e){if(e<0)throw new Error(new TextDecoder().decode(this.raw()));return e}answer(){const e=this.raw(),n=new DataView(e.buffer,e.byteOffset).getUint32(0,!0);return{json:JSON.parse(new TextDecoder().decode(e.subarray(4,4+n))),content:e.subarray(Math.ceil((4+n)/16)*16)}}json(){return this.answer().json}resources(){const{json:e,content:n}=this.answer();return e.map(({offset:t,length:o,...i})=>({...i,bytes:n.slice(t,t+o)}))}}const M="bands",G=3,j=32768,L=a=>a instanceof Error?a.message:String(a);function V(a,e,n,_){const t=(i,l=[])=>_.postMessage(i,l);let o=0;try{for(const i of n){a.beginGeometry(e,i);for(let l=a.geometry();l;l=a.geometry()){if(o+=l.length,o>x)throw new Error("its bands hold more than its header states");t({bytes:l},[l.buffer])}t({bytes:null})}}catch(i){t({reason:L(i)})}}function C(a,e,n,_){const t=[],o=()=>a.beginColors(e,n[t.length]);return new Promise((i,l)=>{o(),_.onmessage=({data:s})=>{try{if("reason"in s)throw new Error(s.reason);if(s.bytes)return a.color(s.bytes);t.push(a.endColors()),t.length<n.length?o():i(t)}catch(r){l(r instanceof Error?r:new Error(L(r)))}}}).finally(()=>_.close())}function H(){let a=null;onmessage=async({data:e})=>{if(e.kind==="start"){a=w.of(e.module);return}const{kind:n,id:_,bytes:t,bands:o,port:i}=e,l=await a;if(n==="geometry")return V(l,t,o,i);const s=u=>({reason:L(u)}),r=await C(l,t,o,i).catch(s),c=r instanceof Array?r.map(u=>u.buffer):[];postMessage({id:_,decoded:r},{transfer:c})}}function X(a,e){const n=Array.from({length:e},()=>({bands:[],bytes:0})),_=a.map((t,o)=>o).sort((t,o)=>a[o]-a[t]);for(const t of _){const o=n.reduce((i,l)=>l.bytes<i.bytes?l:i);o.bands.push(t),o.bytes+=a[t]}return n.map(({bands:t})=>t).filter(t=>t.length>0)}class K{constructor(e){this.engine=e}helpers=null;last=Promise.resolve();waiting=new Map;nextId=1;async decode(e,n){if(n.reduce((t,o)=>t+o,0)<j)return null;const _=this.last.then(()=>this.inPairs(e,n));return this.last=_.catch(()=>{}),_}async inPairs(e,n){if(this.helpers??=this.started(),this.helpers.length===0)return null;const _=X(n,Math.floor((this.helpers.length+1)/2)),t=_.map((i,l)=>{const{port1:s,port2:r}=new MessageChannel;return this.ask(this.helpers[2*l],{kind:"geometry",id:0,bytes:e,bands:i,port:s}),l===0?this.ended(C(this.engine,e,i,r)):this.answer(c=>this.ask(this.helpers[2*l-1],{kind:"colors",id:c,bytes:e,bands:i,port:r}))}),o=[];return(await Promise.all(t)).forEach((i,l)=>i.forEach((s,r)=>o[_[l][r]]=s)),{bands:o,workers:2*_.length}}ask(e,n){e.postMessage(n,[n.port])}answer(e){const n=this.nextId++;return new Promise((_,t)=>{this.waiting.set(n,{resolve:_,reject:t}),e(n)})}ended(e){const n=this.nextId++,_=new Promise((t,o)=>this.waiting.set(n,{resolve:t,reject:o}));return Promise.race([e,_]).finally(()=>this.waiting.delete(n))}started(){const e=navigator.hardwareConcurrency<4?1:G;return Array.from({length:navigator.hardwareConcurrency<2?0:e},()=>{const n=new Worker(self.location.href,{type:"module",name:M});return n.onmessage=({data:{id:_,decoded:t}})=>{t instanceof Array?this.waiting.get(_)?.resolve(t):this.waiting.get(_)?.reject(new Error(t.reason)),this.waiting.delete(_)},n.onerror=()=>this.withoutHelpers(),n.postMessage({kind:"start",module:this.engine.module}),n})}withoutHelpers(){this.helpers?.forEach(e=>e.terminate()),this.helpers=[],this.waiting.forEach(({reject:e})=>e(new Error("a worker that decodes has ended"))),this.waiting.clear()}}const z=64;var $=`#version 300 es

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

`,Y=`#version 300 es

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

`;const R=2048,k=16,q=8,J=`#version 300 es
void main() {
    gl_Position = vec4(4.0 * float(gl_VertexID & 1) - 1.0, 4.0 * float(gl_VertexID >> 1) - 1.0, 0.0, 1.0);
}`,Q=/swiftshader|llvmpipe|softpipe|software|basic render/i,F=({group:a,binding:e})=>`${a} ${e}`,E=({group:a,binding:e})=>a*q+e;function Z({representation:a,constants:e}){let n=a==="vdi"?$:Y;for(const[_,t]of e)n=n.replace(new RegExp(`^(bool|uint|float) ${_} = .*;$`,"m"),(o,i)=>{const l=i==="bool"?String(t!==0):i==="uint"?`${t}u`:String(t);return`const ${i} ${_} = ${l};`});return n}class T{constructor(e,n,_,t){this.canvas=e,this.gl=n,this.engine=_,this.name=t,e.addEventListener("webglcontextlost",()=>this.lost??="the browser took its WebGL context away"),[this.picture,this.colors]=[n.createFramebuffer(),n.createRenderbuffer()],n.bindFramebuffer(n.FRAMEBUFFER,this.picture),n.bindRenderbuffer(n.RENDERBUFFER,this.colors),n.bindVertexArray(n.createVertexArray()),n.pixelStorei(n.UNPACK_ALIGNMENT,1)}api="WebGL2";lost=null;residents=new Map;compiling=new Set;kernels=new Map;picture;colors;static open(e,n){const _=new OffscreenCanvas(1,1),t=_.getContext("webgl2",{alpha:!1,antialias:!1,depth:!1,failIfMajorPerformanceCaveat:!n,powerPreference:"high-performance"});if(!t)return null;const o=t.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL??t.RENDERER,i=String(t.getParameter(o));return Q.test(i)&&!n?null:new T(_,t,e,i)}ready(e,n,_){if(this.residents.has(e))return!0;const t=JSON.stringify([n.representation,n.constants]),o=this.kernels.get(t);return o?this.load(e,o):this.compiling.has(t)||this.compile(t,n).then(_),o!==void 0}forget(e){const n=this.residents.get(e);this.residents.delete(e),n?.textures.forEach(({texture:_})=>this.gl.deleteTexture(_)),n?.uniforms.forEach(_=>this.gl.deleteBuffer(_))}async draw(e,n,_,t,o){const{gl:i,canvas:l}=this;this.size(_),this.bind(this.residents.get(e),this.engine.view(e,n,_,t,[0,_]));const s=t?z:_;for(let r=0;r<_;r+=s){const c=Math.min(s,_-r);if(i.enable(i.SCISSOR_TEST),i.scissor(0,_-r-c,_,c),i.drawArrays(i.TRIANGLES,0,3),await this.drawn(),!o())return null}return i.disable(i.SCISSOR_TEST),i.bindFramebuffer(i.DRAW_FRAMEBUFFER,null),i.blitFramebuffer(0,0,_,_,0,0,_,_,i.COLOR_BUFFER_BIT,i.NEAREST),i.bindFramebuffer(i.DRAW_FRAMEBUFFER,this.picture),l.transferToImageBitmap()}check(){const e=this.gl.getError();if(e!==this.gl.NO_ERROR&&(this.lost??=e===this.gl.OUT_OF_MEMORY?"out of memory":`WebGL error ${e}`),this.lost!==null)throw new Error(this.lost)}size(e){const{gl:n,canvas:_}=this;_.width!==e&&([_.width,_.height]=[e,e],n.renderbufferStorage(n.RENDERBUFFER,n.RGBA8,e,e),n.framebufferRenderbuffer(n.FRAMEBUFFER,n.COLOR_ATTACHMENT0,n.RENDERBUFFER,this.colors),n.viewport(0,0,e,e))}async drawn(){const{gl:e}=this,n=e.fenceSync(e.SYNC_GPU_COMMANDS_COMPLETE,0);for(this.check(),e.flush();n&&e.getSyncParameter(n,e.SYNC_STATUS)!==e.SIGNALED&&this.lost===null;)await new Promise(_=>setTimeout(_,1));e.deleteSync(n),this.check()}bind({program:e,samplers:n,textures:_,uniforms:t},o){const{gl:i}=this;i.useProgram(e);for(const l of n){const{target:s,texture:r}=_.get(F(l));i.activeTexture(i.TEXTURE0+l.unit),i.bindTexture(s,r)}for(const l of o)l.kind==="uniform"&&t.set(E(l),this.uniform(l,t.get(E(l))));t.forEach((l,s)=>i.bindBufferBase(i.UNIFORM_BUFFER,s,l))}load(e,n){const _={...n,textures:new Map,uniforms:new Map};this.residents.set(e,_);for(const t of this.engine.bindings(e))t.kind==="uniform"?_.uniforms.set(E(t),this.uniform(t)):_.textures.set(F(t),t.kind==="texture"?this.voxels(t):this.buffer(t));this.gl.activeTexture(this.gl.TEXTURE0)}uniform({bytes:e},n=this.gl.createBuffer()){const{gl:_}=this,t=new Uint8Array(Math.ceil(e.length/k)*k);return t.set(e),_.bindBuffer(_.UNIFORM_BUFFER,n),_.bufferData(_.UNIFORM_BUFFER,t,_.DYNAMIC_DRAW),n}texture(e){const{gl:n}=this,_=n.createTexture();return n.bindTexture(e,_),n.texParameteri(e,n.TEXTURE_MIN_FILTER,n.NEAREST),n.texParameteri(e,n.TEXTURE_MAG_FILTER,n.NEAREST),{target:e,texture:_}}fits(e,n){const _=this.gl.getParameter(n);if(e>_)throw new Error(this.lost??=`the step needs textures of ${e} texels a side, and WebGL2 has ${_} here`)}buffer({bytes:e}){const{gl:n}=this,_=this.texture(n.TEXTURE_2D),t=Math.max(Math.ceil(e.length/k/R),1);this.fits(t,n.MAX_TEXTURE_SIZE);const o=new Uint32Array(t*R*k/4);return new Uint8Array(o.buffer).set(e),n.texImage2D(n.TEXTURE_2D,0,n.RGBA32UI,R,t,0,n.RGBA_INTEGER,n.UNSIGNED_INT,o),_}voxels({format:e,dims:n,bytes:_}){const{gl:t}=this,o=this.texture(t.TEXTURE_3D),[i,l,s]=n;this.fits(Math.max(i,l,s),t.MAX_3D_TEXTURE_SIZE);const[r,c,u]=e==="r8uint"?[t.R8UI,t.UNSIGNED_BYTE,_]:e==="r16uint"?[t.R16UI,t.UNSIGNED_SHORT,new Uint16Array(_.buffer)]:[t.R32UI,t.UNSIGNED_INT,new Uint32Array(_.buffer)];return t.texImage3D(t.TEXTURE_3D,0,r,i,l,s,0,t.RED_INTEGER,c,u),o}async compile(e,n){this.compiling.add(e);const{gl:_}=this,t=_.createProgram();for(const[i,l]of[[_.VERTEX_SHADER,J],[_.FRAGMENT_SHADER,Z(n)]]){const s=_.createShader(i);_.shaderSource(s,l),_.compileShader(s),_.attachShader(t,s)}_.linkProgram(t);const o=_.getExtension("KHR_parallel_shader_compile");for(;o&&this.lost===null&&!_.getProgramParameter(t,o.COMPLETION_STATUS_KHR);)await new Promise(i=>setTimeout(i,20));if(this.lost===null)if(_.getProgramParameter(t,_.LINK_STATUS))this.kernels.set(e,{program:t,samplers:this.placed(t)});else{const i=_.getAttachedShaders(t).map(l=>_.getShaderInfoLog(l));this.lost=[...i,_.getProgramInfoLog(t)].filter(Boolean).join(" ")||"the kernel was not compiled"}}placed(e){const{gl:n}=this,_=[];n.useProgram(e);for(let t=0;t<n.getProgramParameter(e,n.ACTIVE_UNIFORMS);t++){const{name:o}=n.getActiveUniform(e,t),[,i,l]=/_group_(\d+)_binding_(\d+)_fs/.exec(o).map(Number),[s]=n.getActiveUniforms(e,[t],n.UNIFORM_BLOCK_INDEX);s>=0?n.uniformBlockBinding(e,s,E({group:i,binding:l})):(n.uniform1i(n.getUniformLocation(e,o),_.length),_.push({unit:_.length,group:i,binding:l}))}return _}}var ee=`// From colors in single precision to bytes.

@group(0) @binding(0) var<storage, read> colors: array<f32>;
@group(0) @binding(1) var<storage, read_write> pixels: array<u32>;

fn byte(n: u32) -> u32 {
    return u32(clamp(colors[n], 0.0, 1.0) * 255.0 + 0.5);
}

// Rounds all channels to bytes: red first, opaque.
@compute @workgroup_size(64)
fn present(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let n = id.y * groups.x * 64u + id.x;
    if n < arrayLength(&pixels) {
        pixels[n] = byte(3u * n) | (byte(3u * n + 1u) << 8u) | (byte(3u * n + 2u) << 16u) | 0xff000000u;
    }
}
`;const U=12,ne=3,m=(a,e)=>{const n=GPUShaderStage.COMPUTE;return e==="texture"?{binding:a,visibility:n,texture:{sampleType:"uint",viewDimension:"3d"}}:{binding:a,visibility:n,buffer:{type:e==="uniform"?"uniform":e==="storage"?"read-only-storage":"storage"}}};class D{constructor(e,n,_,t){this.device=e,this.engine=n,this.present=_,this.name=t,this.nothing=e.createBuffer({size:16,usage:GPUBufferUsage.STORAGE}),e.lost.then(o=>this.lost??=o.message||o.reason),e.onuncapturederror=({error:o})=>this.lost??=o.message}api="WebGPU";lost=null;residents=new Map;compiling=new Set;kernels=new Map;nothing;targets=[];static async open(e,n){const _=await navigator.gpu?.requestAdapter({powerPreference:"high-performance"}).catch(()=>null);if(!_||_.info.isFallbackAdapter&&!n)return null;const{maxStorageBufferBindingSize:t,maxBufferSize:o,maxTextureDimension3D:i}=_.limits,l={maxStorageBufferBindingSize:t,maxBufferSize:o,maxTextureDimension3D:i},s=await _.requestDevice({requiredLimits:l}).catch(()=>null);if(!s)return null;const c={module:s.createShaderModule({code:ee}),entryPoint:"present"},u=await s.createComputePipelineAsync({layout:"auto",compute:c}).catch(()=>null);if(!u)return null;const{vendor:f,architecture:p,description:g}=_.info;return new D(s,e,u,g||`${f} ${p}`.trim())}load(e,n,_){const t=this.residents.get(e);if(t)return t;const o=JSON.stringify([n.representation,n.constants]),i=this.kernels.get(o);if(!i)return this.compiling.has(o)||this.compile(o,e,n).then(_),null;const l=[],r={bound:this.engine.bindings(e).map(c=>this.upload(c,l)),...i,free:()=>l.forEach(c=>c.destroy())};return this.residents.set(e,r),r}forget(e){this.residents.get(e)?.free(),this.residents.delete(e)}ready(e,n,_){return this.load(e,n,_)!==null}async draw(e,n,_,t,o){try{return await this.picture(e,n,_,t,o)}catch(i){throw this.lost??=i instanceof Error?i.message:String(i),i}}async picture(e,n,_,t,o){const i=this.residents.get(e),l=this.sized(_),s=t?z:_;for(let r=0;r<_;r+=s)if(this.colors(e,i,n,l,t,[r,Math.min(s,_-r)]),!!t&&(await this.device.queue.onSubmittedWorkDone(),!o()))return null;return this.show(l)}uniform(e,n){const _=this.device.createBuffer({size:Math.ceil(e.byteLength/16)*16,usage:GPUBufferUsage.UNIFORM|GPUBufferUsage.COPY_DST});return this.device.queue.writeBuffer(_,0,e),n.push(_),_}upload({group:e,binding:n,kind:_,format:t,dims:o,bytes:i},l){const s=m(n,_);if(_==="uniform")return{group:e,binding:n,entry:s,resource:{buffer:this.uniform(i,l)}};if(_==="texture"){const[c,u,f]=o,p=this.device.createTexture({size:{width:c,height:u,depthOrArrayLayers:f},dimension:"3d",format:t,usage:GPUTextureUsage.TEXTURE_BINDING|GPUTextureUsage.COPY_DST}),g=i.length/(u*f),d={width:c,height:u,depthOrArrayLayers:f};return this.device.queue.writeTexture({texture:p},i,{bytesPerRow:g,rowsPerImage:u},d),l.push(p),{group:e,binding:n,entry:s,resource:p.createView()}}const r=this.device.createBuffer({size:Math.max(Math.ceil(i.length/16)*16,16),usage:GPUBufferUsage.STORAGE|GPUBufferUsage.COPY_DST});return this.device.queue.writeBuffer(r,0,i),l.push(r),{group:e,binding:n,entry:s,resource:{buffer:r}}}async compile(e,n,{representation:_,constants:t}){this.compiling.add(e);const o=this.engine.bindings(n),i=this.engine.view(n,B,1,!1,[0,1]),l=[];for(const{group:c,binding:u,kind:f}of[...o,...i])(l[c]??=[]).push(m(u,f));(l[1]??=[]).push(m(1,"storage"),m(2,"written"));const s=l.map(c=>this.device.createBindGroupLayout({entries:c})),r=this.device.createShaderModule({code:this.engine.source(_)});try{const c=await this.device.createComputePipelineAsync({layout:this.device.createPipelineLayout({bindGroupLayouts:s}),compute:{module:r,entryPoint:"color_rows",constants:Object.fromEntries(t)}});this.kernels.set(e,{pipeline:c,layouts:s})}catch(c){this.lost??=c instanceof Error?c.message:String(c)}}sized(e){const n=this.targets.find(r=>r.side===e);if(n)return this.targets.push(...this.targets.splice(this.targets.indexOf(n),1)),n;if(this.targets.length===ne){const{colors:r,pixels:c,copy:u}=this.targets.shift();[r,c,u].forEach(f=>f.destroy())}const{STORAGE:_,COPY_DST:t,COPY_SRC:o,MAP_READ:i}=GPUBufferUsage,l=(r,c)=>this.device.createBuffer({size:r*e*e,usage:c}),s={side:e,colors:l(U,_),pixels:l(4,_|o),copy:l(4,i|t)};return this.targets.push(s),s}colors(e,n,_,{side:t,colors:o},i,[l,s]){const r=[],c=this.engine.view(e,_,t,i,[l,s]),u=[...n.bound,...c.map(v=>this.upload(v,r))],f=U*t,p={buffer:o,offset:l*f,size:s*f};u.push({group:1,binding:1,entry:m(1,"storage"),resource:{buffer:this.nothing}}),u.push({group:1,binding:2,entry:m(2,"written"),resource:p});const g=this.device.createCommandEncoder(),d=g.beginComputePass();d.setPipeline(n.pipeline),n.layouts.forEach((v,y)=>{const N=u.filter(S=>S.group===y).map(({binding:S,resource:O})=>({binding:S,resource:O}));d.setBindGroup(y,this.device.createBindGroup({layout:v,entries:N}))}),d.dispatchWorkgroups(Math.ceil(t/8),Math.ceil(s/8)),d.end(),this.device.queue.submit([g.finish()]),r.forEach(v=>v.destroy())}async show({side:e,colors:n,pixels:_,copy:t}){const o=this.present.getBindGroupLayout(0),i=[n,_].map((f,p)=>({binding:p,resource:{buffer:f}})),l=this.device.createCommandEncoder(),s=l.beginComputePass();s.setPipeline(this.present),s.setBindGroup(0,this.device.createBindGroup({layout:o,entries:i}));const r=Math.ceil(e*e/64),c=Math.min(r,4096);if(s.dispatchWorkgroups(c,Math.ceil(r/c)),s.end(),l.copyBufferToBuffer(_,0,t,0,4*e*e),this.device.queue.submit([l.finish()]),await t.mapAsync(GPUMapMode.READ),this.lost!==null)throw new Error(this.lost);const u=new Uint8ClampedArray(t.getMappedRange().slice(0));return t.unmap(),createImageBitmap(new ImageData(u,e,e))}}const h=(a,e=[])=>postMessage(a,{transfer:e}),A=a=>a instanceof Error?a.message:String(a),_e=()=>new Promise(a=>{const{port1:e,port2:n}=new MessageChannel;e.onmessage=()=>{e.close(),a()},n.postMessage(null)});class te{constructor(e,n){this.engine=e,this.gpu=n,this.bands=new K(e)}held=new Map;opening=new Set;bands;next=null;current=null;device(){return this.gpu?{kind:"gpu",api:this.gpu.api,name:this.gpu.name}:{kind:"cpu",why:"neither WebGPU nor WebGL2 has a GPU here"}}async open(e,n){const _=performance.now();this.opening.add(e);try{const{handle:t,description:o,decoders:i}=await this.decoded(n);if(!this.opening.delete(e))throw this.forget(t),new Error("the step is no longer wanted");this.close(e),this.held.set(e,{handle:t,description:o,changed:null}),h({kind:"opened",key:e,decodeMs:performance.now()-_,decoders:i,description:o})}catch(t){this.opening.delete(e),h({kind:"refused",key:e,reason:A(t)})}}async decoded(e){const n=this.engine.bandSizes(e),_=await this.bands.decode(e,n).catch(()=>null);return _?{...this.engine.join(e,_.bands),decoders:_.workers}:{...this.engine.open(e),decoders:1}}close(e){this.opening.delete(e);const n=this.held.get(e);n&&(this.held.delete(e),this.forget(n.handle),n.changed&&this.forget(n.changed.handle))}forget(e){this.gpu?.forget(e),this.engine.close(e)}slice({id:e,key:n,axis:_,at:t}){const o=this.held.get(n);try{if(!o)throw new Error("the step is no longer held");const i=this.engine.slice(o.handle,_,t);h({kind:"sliced",id:e,slice:i},[i.units.buffer])}catch(i){h({kind:"failed",id:e,reason:A(i)})}}cancel(e){if(this.next?.id===e)this.next=null;else if(this.current?.id===e)this.current=null;else return;h({kind:"dropped",id:e})}async draw(e){if(this.next&&h({kind:"dropped",id:this.next.id}),this.next=e,!this.busy){for(this.busy=!0;this.next;){const n=this.next;[this.current,this.next]=[n,null];try{await this.paint(n)}catch(_){this.gpu&&this.gpu.lost!==null?(this.withoutGpu(),this.next?h({kind:"dropped",id:n.id}):this.next=n):h({kind:"failed",id:n.id,reason:A(_)})}}this.busy=!1}}busy=!1;withoutGpu(){h({kind:"device",device:{kind:"cpu",why:`the GPU failed: ${this.gpu?.lost}`}}),this.gpu=null}shown(e,n){if(n===null||e.description.representation==="vdi")return e;if(e.changed?.appearance===n)return e.changed;const{handle:_,description:t}=this.engine.withAppearance(e.handle,n);return e.changed&&this.forget(e.changed.handle),e.changed={appearance:n,handle:_,description:t},e.changed}async paint(e){const{id:n,key:_,pose:t,side:o,still:i,appearance:l}=e,s=this.held.get(_);if(!s)return h({kind:"failed",id:n,reason:"the step is no longer held"});const r=performance.now(),{handle:c,description:u}=this.shown(s,l),f=()=>this.current===e&&this.next===null&&this.held.get(_)===s,p=()=>h({kind:"device",device:this.device()});this.gpu&&this.gpu.lost!==null&&this.withoutGpu();const g=this.gpu!==null&&u.visible&&this.gpu.ready(c,u,p),d=u.visible?this.gpu&&g?await this.gpu.draw(c,t,o,i,f):await this.onProcessor(c,e,f):ie(u,o);if(this.current!==e)return d?.close();this.current=null;const[v,y]=[performance.now()-r,g?"gpu":"cpu"];d?h({kind:"drawn",id:n,bitmap:d,drawMs:v,by:y},[d]):h({kind:"dropped",id:n})}async onProcessor(e,{pose:n,side:_,still:t},o){for(this.engine.begin(e,n,_,_,t);;){const i=this.engine.advance();if(i)return createImageBitmap(new ImageData(i,_,_));if(await _e(),!o())return null}}}function ie({background:[a,e,n]},_){const t=new OffscreenCanvas(_,_),o=t.getContext("2d");return o.fillStyle=`rgb(${[a,e,n].map(i=>Math.round(255*i)).join(" ")})`,o.fillRect(0,0,_,_),t.transferToImageBitmap()}async function oe(a){const e=self.name;return e==="cpu"?null:(e==="webgl"?null:await D.open(a,e==="webgpu"))??(e==="webgpu"?null:T.open(a,e==="webgl"))}const W=[];let b=null;function P(a){b?a.kind==="open"?b.open(a.key,new Uint8Array(a.bytes)):a.kind==="close"?b.close(a.key):a.kind==="cancel"?b.cancel(a.id):a.kind==="slice"?b.slice(a):b.draw(a):W.push(a)}async function le(){onmessage=({data:e})=>P(e);const a=await w.load("engine.wasm");b=new te(a,await oe(a)),h({kind:"ready",device:b.device()}),W.splice(0).forEach(P)}self.name===M?H():await le();
