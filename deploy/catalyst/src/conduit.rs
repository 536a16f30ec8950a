//! Conduit nodes, through the C functions that the process has: libcatalyst's `catalyst_conduit_*`, else Conduit's own `conduit_*`.
//!
//! Conduit throws where a path is missing or a type is another; here every path is asked for first, and numbers are read by their type.

use crate::symbols::function;
use lamina_model::VoxelType;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::sync::OnceLock;

/// `conduit_node` of C.
#[repr(C)]
pub(crate) struct ConduitNode([u8; 0]);

/// The functions in use.
pub(crate) struct Conduit {
    has_path: unsafe extern "C" fn(*const ConduitNode, *const c_char) -> c_int,
    fetch_existing: unsafe extern "C" fn(*const ConduitNode, *const c_char) -> *mut ConduitNode,
    number_of_children: unsafe extern "C" fn(*const ConduitNode) -> i64,
    child: unsafe extern "C" fn(*const ConduitNode, i64) -> *mut ConduitNode,
    name: unsafe extern "C" fn(*const ConduitNode) -> *mut c_char,
    dtype: unsafe extern "C" fn(*const ConduitNode) -> *const c_void,
    element_ptr: unsafe extern "C" fn(*const ConduitNode, i64) -> *const c_void,
    as_char8_str: unsafe extern "C" fn(*const ConduitNode) -> *const c_char,
    set_path_char8_str: unsafe extern "C" fn(*const ConduitNode, *const c_char, *const c_char),
    set_path_float64: unsafe extern "C" fn(*const ConduitNode, *const c_char, f64),
    id: unsafe extern "C" fn(*const c_void) -> i64,
    number_of_elements: unsafe extern "C" fn(*const c_void) -> i64,
    stride: unsafe extern "C" fn(*const c_void) -> i64,
}

/// Types of elements, by Conduit's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Element {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
}

impl Element {
    fn of_id(id: i64) -> Option<Self> {
        use Element::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        let known = [I8, I16, I32, I64, U8, U16, U32, U64, F32, F64];
        usize::try_from(id - 3).ok().and_then(|n| known.get(n).copied())
    }

    /// The type of voxels that are such elements; none, where a run cannot have it.
    pub(crate) fn voxel_type(self) -> Option<VoxelType> {
        match self {
            Self::U8 => Some(VoxelType::U8),
            Self::U16 => Some(VoxelType::U16),
            Self::I16 => Some(VoxelType::I16),
            Self::F32 => Some(VoxelType::F32),
            Self::F64 => Some(VoxelType::F64),
            Self::I8 | Self::I32 | Self::I64 | Self::U32 | Self::U64 => None,
        }
    }

    /// Of one element.
    pub(crate) fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

const CHAR8_STR: i64 = 13;

/// A sum that tells other words in another order apart.
pub(crate) fn hashed(sum: u64, word: u64) -> u64 {
    (sum.rotate_left(5) ^ word).wrapping_mul(0x517c_c1b7_2722_0a95)
}

/// Numbers in the simulation's memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeArray {
    pub(crate) element: Element,
    pub(crate) first: *const u8,
    pub(crate) len: usize,
    /// From one element to the next.
    pub(crate) stride_bytes: usize,
}

impl NodeArray {
    /// Element `n`; none beyond the last.
    pub(crate) fn get(&self, n: usize) -> Option<f64> {
        if n >= self.len {
            return None;
        }
        // SAFETY: Conduit says that `len` elements lie there, `stride_bytes` apart; they need not be aligned.
        unsafe {
            let place = self.first.add(n * self.stride_bytes);
            Some(match self.element {
                Element::I8 => f64::from(place.cast::<i8>().read()),
                Element::I16 => f64::from(place.cast::<i16>().read_unaligned()),
                Element::I32 => f64::from(place.cast::<i32>().read_unaligned()),
                Element::I64 => place.cast::<i64>().read_unaligned() as f64,
                Element::U8 => f64::from(place.read()),
                Element::U16 => f64::from(place.cast::<u16>().read_unaligned()),
                Element::U32 => f64::from(place.cast::<u32>().read_unaligned()),
                Element::U64 => place.cast::<u64>().read_unaligned() as f64,
                Element::F32 => f64::from(place.cast::<f32>().read_unaligned()),
                Element::F64 => place.cast::<f64>().read_unaligned(),
            })
        }
    }

    /// A number that is another one where an element is, beginning from `sum`.
    pub(crate) fn fingerprint(&self, sum: u64) -> u64 {
        let sum = hashed(sum, self.len as u64);
        (0..self.len).filter_map(|n| self.get(n)).fold(sum, |sum, value| hashed(sum, value.to_bits()))
    }

    /// The numbers of a slice that outlives it.
    #[cfg(test)]
    pub(crate) fn of_slice(values: &[f64]) -> Self {
        Self { element: Element::F64, first: values.as_ptr().cast(), len: values.len(), stride_bytes: 8 }
    }

    /// It, if this process can read it: memory of a device it cannot. An error names `what` it is.
    pub(crate) fn on_host(self, what: &str) -> Result<Self, String> {
        let error = || format!("{what} in memory of a device; copy to the host before the step is handed over");
        self.is_readable().then_some(self).ok_or_else(error)
    }

    fn is_readable(&self) -> bool {
        let last = self.len.saturating_sub(1) * self.stride_bytes + self.element.size_bytes() - 1;
        [0, last].into_iter().all(|offset| {
            let mut byte = 0_u8;
            let to = libc::iovec { iov_base: (&raw mut byte).cast(), iov_len: 1 };
            let from = libc::iovec { iov_base: self.first.wrapping_add(offset).cast_mut().cast(), iov_len: 1 };
            // SAFETY: the kernel copies a byte, or says that it cannot.
            let read = unsafe { libc::process_vm_readv(libc::getpid(), &raw const to, 1, &raw const from, 1, 0) };
            // Where the call itself is forbidden nothing is known.
            // SAFETY: errno is this thread's own.
            read == 1 || unsafe { *libc::__errno_location() } != libc::EFAULT
        })
    }
}

impl Conduit {
    /// Those of this process.
    pub(crate) fn of_process() -> Result<&'static Self, String> {
        static FOUND: OnceLock<Option<Conduit>> = OnceLock::new();
        let found = FOUND.get_or_init(|| ["catalyst_conduit_", "conduit_"].into_iter().find_map(Self::with_prefix));
        found.as_ref().ok_or_else(|| {
            "this process has no Conduit: neither catalyst_conduit_node_has_path nor conduit_node_has_path is found; link it, or libcatalyst, \
             as a shared library"
                .to_owned()
        })
    }

    fn with_prefix(prefix: &str) -> Option<Self> {
        let named = |name: &str| format!("{prefix}{name}");
        // SAFETY: the types are those of conduit_node.h and conduit_datatype.h, with 64-bit indices.
        unsafe {
            Some(Self {
                has_path: function(&named("node_has_path"))?,
                fetch_existing: function(&named("node_fetch_existing"))?,
                number_of_children: function(&named("node_number_of_children"))?,
                child: function(&named("node_child"))?,
                name: function(&named("node_name"))?,
                dtype: function(&named("node_dtype"))?,
                element_ptr: function(&named("node_element_ptr"))?,
                as_char8_str: function(&named("node_as_char8_str"))?,
                set_path_char8_str: function(&named("node_set_path_char8_str"))?,
                set_path_float64: function(&named("node_set_path_float64"))?,
                id: function(&named("datatype_id"))?,
                number_of_elements: function(&named("datatype_number_of_elements"))?,
                stride: function(&named("datatype_stride"))?,
            })
        }
    }

    /// The node that the simulation handed over.
    pub(crate) fn node(&'static self, node: *const ConduitNode) -> Node {
        Node { conduit: self, node }
    }
}

/// A node of the tree, for the length of a call.
#[derive(Clone, Copy)]
pub(crate) struct Node {
    conduit: &'static Conduit,
    node: *const ConduitNode,
}

impl Node {
    /// What lies at `path`, if there is anything.
    pub(crate) fn at(&self, path: &str) -> Option<Self> {
        let name = CString::new(path).ok()?;
        if self.node.is_null() {
            return None;
        }
        // SAFETY: the node is the simulation's, and lives as long as the call; the path is there when it is fetched.
        let node = unsafe {
            ((self.conduit.has_path)(self.node, name.as_ptr()) != 0)
                .then(|| (self.conduit.fetch_existing)(self.node, name.as_ptr()))?
        };
        Some(Self { node, ..*self })
    }

    /// Its children with their names.
    pub(crate) fn children(&self) -> Vec<(String, Self)> {
        if self.node.is_null() {
            return Vec::new();
        }
        // SAFETY: as in `at`; indices are below the number; a name is allocated by C for the caller.
        unsafe {
            let number = (self.conduit.number_of_children)(self.node);
            (0..number)
                .map(|n| {
                    let child = (self.conduit.child)(self.node, n);
                    let name = (self.conduit.name)(child);
                    let text = if name.is_null() {
                        String::new()
                    } else {
                        CStr::from_ptr(name).to_string_lossy().into_owned()
                    };
                    libc::free(name.cast());
                    (text, Self { node: child, ..*self })
                })
                .collect()
        }
    }

    /// The text it holds.
    pub(crate) fn text(&self) -> Option<String> {
        if self.node.is_null() {
            return None;
        }
        // SAFETY: as in `at`; its type is asked for first.
        unsafe {
            if (self.conduit.id)((self.conduit.dtype)(self.node)) != CHAR8_STR {
                return None;
            }
            Some(CStr::from_ptr((self.conduit.as_char8_str)(self.node)).to_string_lossy().into_owned())
        }
    }

    /// The numbers it holds.
    pub(crate) fn array(&self) -> Option<NodeArray> {
        if self.node.is_null() {
            return None;
        }
        // SAFETY: as in `at`.
        let (id, len, stride) = unsafe {
            let dtype = (self.conduit.dtype)(self.node);
            ((self.conduit.id)(dtype), (self.conduit.number_of_elements)(dtype), (self.conduit.stride)(dtype))
        };
        let element = Element::of_id(id)?;
        let len = usize::try_from(len).ok().filter(|len| *len > 0)?;
        let stride_bytes = usize::try_from(stride).ok()?;
        // SAFETY: as in `at`; there is a first element.
        let first = unsafe { (self.conduit.element_ptr)(self.node, 0) }.cast::<u8>();
        (!first.is_null()).then_some(NodeArray { element, first, len, stride_bytes })
    }

    /// The number at `path`.
    pub(crate) fn number(&self, path: &str) -> Option<f64> {
        self.at(path)?.array()?.get(0)
    }

    /// The text at `path`.
    pub(crate) fn text_at(&self, path: &str) -> Option<String> {
        self.at(path)?.text()
    }

    /// Writes `text` to `path`.
    pub(crate) fn set_text(&self, path: &str, text: &str) {
        if let (Ok(path), Ok(text), false) = (CString::new(path), CString::new(text), self.node.is_null()) {
            // SAFETY: the simulation hands the node over to be filled; both texts are copied.
            unsafe { (self.conduit.set_path_char8_str)(self.node, path.as_ptr(), text.as_ptr()) };
        }
    }

    /// Writes `value` to `path`.
    pub(crate) fn set_number(&self, path: &str, value: f64) {
        if let (Ok(path), false) = (CString::new(path), self.node.is_null()) {
            // SAFETY: as in `set_text`.
            unsafe { (self.conduit.set_path_float64)(self.node, path.as_ptr(), value) };
        }
    }
}
