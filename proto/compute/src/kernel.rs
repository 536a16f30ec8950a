//! What a kernel in WGSL reads, as bytes: for a device of any kind, in this process or in a browser.

use std::borrow::Cow;

/// Storage of a three-dimensional texture's elements, all read as unsigned integers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TexelFormat {
    /// One byte.
    R8Uint,
    /// Two bytes.
    R16Uint,
    /// Four bytes.
    R32Uint,
}

impl TexelFormat {
    /// The name that WebGPU gives it.
    pub fn name(self) -> &'static str {
        match self {
            Self::R8Uint => "r8uint",
            Self::R16Uint => "r16uint",
            Self::R32Uint => "r32uint",
        }
    }
}

/// One resource of a kernel, little-endian.
#[derive(Debug, Clone)]
pub enum Resource<'a> {
    /// A uniform buffer.
    Uniform(Cow<'a, [u8]>),
    /// A storage buffer that is read.
    Storage(Cow<'a, [u8]>),
    /// A three-dimensional texture.
    Texture {
        /// Texels along x, y and z.
        dims: [u32; 3],
        /// Storage of a texel.
        format: TexelFormat,
        /// All texels, x fastest.
        bytes: Cow<'a, [u8]>,
    },
}

/// A resource at its place in the kernel's bind groups.
#[derive(Debug, Clone)]
pub struct Binding<'a> {
    /// Number of the bind group.
    pub group: u32,
    /// Number in the group.
    pub binding: u32,
    /// What is bound.
    pub resource: Resource<'a>,
}

impl<'a> Binding<'a> {
    /// A uniform buffer of one struct.
    pub fn uniform(group: u32, binding: u32, content: &impl bytemuck::NoUninit) -> Self {
        let bytes = bytemuck::bytes_of(content).to_vec();
        Self { group, binding, resource: Resource::Uniform(bytes.into()) }
    }

    /// A three-dimensional texture.
    pub fn texture(
        group: u32,
        binding: u32,
        dims: [u32; 3],
        format: TexelFormat,
        bytes: impl Into<Cow<'a, [u8]>>,
    ) -> Self {
        Self { group, binding, resource: Resource::Texture { dims, format, bytes: bytes.into() } }
    }

    /// A storage buffer.
    pub fn storage(group: u32, binding: u32, bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        Self { group, binding, resource: Resource::Storage(bytes.into()) }
    }
}
