//! Answers to the page: JSON, then the bytes that it describes.

use lamina_compute::kernel::{Binding, Resource};
use serde::Serialize;

/// Where bytes begin: a multiple of this.
const ALIGNMENT: usize = 16;

/// What a part of the bytes is bound as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A uniform buffer.
    Uniform,
    /// A storage buffer that is read.
    Storage,
    /// A three-dimensional texture.
    Texture,
}

/// One resource of a kernel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Entry {
    /// Number of the bind group.
    pub group: u32,
    /// Number in the group.
    pub binding: u32,
    /// What it is.
    pub kind: Kind,
    /// Format of a texture's texels, as WebGPU names it.
    pub format: Option<&'static str>,
    /// Texels of a texture along x, y and z.
    pub dims: Option<[u32; 3]>,
    /// First byte among the bytes.
    pub offset: usize,
    /// Number of bytes.
    pub length: usize,
}

/// Bytes of one answer: the length of the JSON (32 bits, little-endian), the JSON, zeros up to a multiple of 16, then the bytes that
/// the JSON counts from there.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Message(pub Vec<u8>);

impl Message {
    /// `value` as JSON, and nothing else.
    pub(crate) fn json(value: &impl Serialize) -> Self {
        Self::with_bytes(value, &[])
    }

    /// `value` as JSON, then `parts`, each at a multiple of 16.
    pub(crate) fn with_bytes(value: &impl Serialize, parts: &[&[u8]]) -> Self {
        let json = serde_json::to_vec(value).expect("plain data has a JSON form");
        let mut bytes = (json.len() as u32).to_le_bytes().to_vec();
        bytes.extend(json);
        for part in parts {
            bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), 0);
            bytes.extend_from_slice(part);
        }
        Self(bytes)
    }

    /// A list of [`Entry`], and their bytes.
    pub(crate) fn bindings(bindings: &[Binding<'_>]) -> Self {
        let (mut entries, mut parts, mut offset) = (Vec::new(), Vec::new(), 0_usize);
        for Binding { group, binding, resource } in bindings {
            let (kind, format, dims, bytes) = match resource {
                Resource::Uniform(bytes) => (Kind::Uniform, None, None, bytes),
                Resource::Storage(bytes) => (Kind::Storage, None, None, bytes),
                Resource::Texture { dims, format, bytes } => (Kind::Texture, Some(format.name()), Some(*dims), bytes),
            };
            offset = offset.next_multiple_of(ALIGNMENT);
            let (group, binding, length) = (*group, *binding, bytes.len());
            entries.push(Entry { group, binding, kind, format, dims, offset, length });
            parts.push(&bytes[..]);
            offset += length;
        }
        Self::with_bytes(&entries, &parts)
    }
}
