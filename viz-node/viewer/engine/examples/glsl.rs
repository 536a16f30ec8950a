//! Translates the WGSL kernels to fragment shaders in GLSL ES 3.00, for browsers that have WebGL2 but no WebGPU: `glsl FOLDER` writes
//! `vdi.frag` and `volume.frag`. `viewer/build engine` calls it.
//!
//! WebGL2 has no storage buffers: each is read as a texture of [`WIDTH`] columns whose texels are 16 bytes of the buffer. Override
//! constants become global variables with a default on a line of their own; the page puts constants in their place.

use lamina_raycast::kernel::VolumeKernel;
use lamina_vdi_render::kernel::VdiKernel;
use naga::back::glsl::{Options, PipelineOptions, Version, Writer, WriterFlags};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use std::error::Error;
use std::path::Path;

/// Texels a row of the textures that hold buffers, as a power of two; `BUFFER_COLUMNS` in `webgl.ts`.
const WIDTH: u32 = 11;

/// The first pixel of a picture is its upper left one, WebGL's the lower left one.
const ENTRY: &str = "
@fragment
fn color_fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
    return vec4f(color_at(u32(at.x), view.height - 1u - u32(at.y)), 1.0);
}
";

/// An element of the storage buffer `name`, of type `element`, as a function of its index.
fn accessor(name: &str, element: &str) -> Result<String, String> {
    let read = match element {
        "u32" => "texel(n >> 2u)[n & 3u]".to_owned(),
        "f32" => "bitcast<f32>(texel(n >> 2u)[n & 3u])".to_owned(),
        "vec2u" => "pair(texel(n >> 1u), n)".to_owned(),
        "vec4f" => "bitcast<vec4f>(texel(n))".to_owned(),
        "DepthSteps" => "depth_steps(texel(n))".to_owned(),
        other => return Err(format!("the buffer {name} has elements of type {other}, which no texel is read as")),
    };
    let (read, mask) = (read.replace("texel", &format!("{name}_texel")), (1 << WIDTH) - 1);
    Ok(format!(
        "fn {name}_texel(n: u32) -> vec4u {{ return textureLoad({name}, vec2u(n & {mask}u, n >> {WIDTH}u), 0); }}
fn {name}_at(n: u32) -> {element} {{ return {read}; }}
"
    ))
}

const PAIR: &str = "
fn pair(texel: vec4u, n: u32) -> vec2u {
    if (n & 1u) == 0u {
        return texel.xy;
    }
    return texel.zw;
}
";

const DEPTH_STEPS: &str = "
fn depth_steps(texel: vec4u) -> DepthSteps {
    let numbers = bitcast<vec4f>(texel);
    return DepthSteps(numbers.x, numbers.y, numbers.z, texel.w);
}
";

/// The source with `name[index]` as `name_at(index)`.
fn called(source: &str, name: &str) -> String {
    let (mut out, mut rest, opening) = (String::new(), source, format!("{name}["));
    while let Some(at) = rest.find(&opening) {
        let inside = &rest[at + opening.len()..];
        out.push_str(&rest[..at]);
        if out.ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '.') {
            out.push_str(&opening);
            rest = inside;
            continue;
        }
        let mut depth = 1;
        let end = inside.find(|c| {
            depth += i32::from(c == '[') - i32::from(c == ']');
            depth == 0
        });
        let end = end.unwrap_or_else(|| panic!("{name}: a bracket is not closed"));
        // The index may read the same buffer.
        out.push_str(&format!("{name}_at({})", called(&inside[..end], name)));
        rest = &inside[end + 1..];
    }
    out + rest
}

/// WGSL that reads textures in place of storage buffers, and has a fragment's entry point.
fn without_buffers(source: &str) -> Result<String, String> {
    let (mut lines, mut buffers) = (Vec::new(), Vec::new());
    for line in source.lines() {
        if let Some((before, after)) = line.split_once("var<storage, read> ") {
            let (name, kind) = after.split_once(": array<").ok_or("a storage buffer that is no array")?;
            let element = kind.trim_end_matches(">;");
            lines.push(format!("{before}var {name}: texture_2d<u32>;"));
            buffers.push((name, element));
        } else if let Some(constant) = line.strip_prefix("override ") {
            lines.push(format!("var<private> {constant}"));
        } else {
            lines.push(line.to_owned());
        }
    }
    let mut wgsl = lines.join("\n");
    for (name, element) in &buffers {
        wgsl = called(&wgsl, name) + &accessor(name, element)?;
    }
    let elements = |kind| buffers.iter().any(|(_, element)| *element == kind);
    let helpers = [(elements("vec2u"), PAIR), (elements("DepthSteps"), DEPTH_STEPS)];
    helpers.iter().filter(|(needed, _)| *needed).for_each(|(_, helper)| wgsl.push_str(helper));
    Ok(wgsl + ENTRY)
}

fn translated(source: &str) -> Result<String, Box<dyn Error>> {
    let wgsl = without_buffers(source)?;
    let module = naga::front::wgsl::parse_str(&wgsl).map_err(|e| e.emit_to_string(&wgsl))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::SHADER_FLOAT16_IN_FLOAT32).validate(&module)?;
    let options = Options {
        version: Version::Embedded { version: 300, is_webgl: true },
        writer_flags: WriterFlags::empty(),
        ..Options::default()
    };
    let entry = PipelineOptions {
        shader_stage: naga::ShaderStage::Fragment,
        entry_point: "color_fragment".to_owned(),
        multiview: None,
    };
    // WebGL itself keeps indices within textures.
    let policies = BoundsCheckPolicies { index: BoundsCheckPolicy::Restrict, ..BoundsCheckPolicies::default() };
    let mut glsl = String::new();
    Writer::new(&mut glsl, &module, &info, &options, &entry, policies)?.write()?;
    Ok(glsl)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("glsl FOLDER")?;
    for (name, source) in [("vdi", VdiKernel::SOURCE), ("volume", VolumeKernel::SOURCE)] {
        std::fs::write(Path::new(&folder).join(format!("{name}.frag")), translated(source)?)?;
    }
    Ok(())
}
