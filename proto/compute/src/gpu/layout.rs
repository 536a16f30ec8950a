//! Memory layout of WGSL structs, with which tests compare the `#[repr(C)]` structs of the host.

use wgpu::naga::{Module, TypeInner, front::wgsl};

/// A struct's size in bytes and its members' names and offsets, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StructLayout {
    /// Array stride in bytes.
    pub size: usize,
    /// Names, and offsets in bytes.
    pub members: Vec<(String, usize)>,
}

/// Parses WGSL.
///
/// # Errors
/// The message of the parser.
pub fn parse(source: &str) -> Result<Module, String> {
    wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))
}

/// The layout of `module`'s struct `name`.
pub fn struct_layout(module: &Module, name: &str) -> Option<StructLayout> {
    module.types.iter().filter(|(_, ty)| ty.name.as_deref() == Some(name)).find_map(|(_, ty)| {
        let TypeInner::Struct { members, span } = &ty.inner else { return None };
        let member = |m: &wgpu::naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
        Some(StructLayout { size: *span as usize, members: members.iter().map(member).collect() })
    })
}

/// The name and [`StructLayout`](crate::gpu::layout::StructLayout) of a Rust struct with the given members, for comparison with
/// the WGSL struct of that name.
#[macro_export]
macro_rules! layout_of {
    ($name:ident { $($member:ident),* $(,)? }) => {
        (stringify!($name), $crate::gpu::layout::StructLayout {
            size: size_of::<$name>(),
            members: vec![$((stringify!($member).to_owned(), ::std::mem::offset_of!($name, $member))),*],
        })
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vector_of_three_leaves_room_for_a_scalar() {
        let module = parse("struct S { a: vec3f, b: u32, c: vec2f } @group(0) @binding(0) var<uniform> s: S;");
        let layout = struct_layout(&module.expect("valid WGSL"), "S").expect("a struct S");
        let members = [("a", 0), ("b", 12), ("c", 16)].map(|(n, o)| (n.to_owned(), o));
        assert_eq!(layout, StructLayout { size: 32, members: members.to_vec() });
    }
}
