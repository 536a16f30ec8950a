//! Functions and constants of the libraries that the process has loaded, by name.

use std::ffi::{CString, c_void};

/// Where `name` lies, if a loaded library has it.
pub(crate) fn address(name: &str) -> Option<*mut c_void> {
    let name = CString::new(name).ok()?;
    // SAFETY: a lookup among the libraries that are loaded.
    let found = unsafe { libc::dlsym(libc::RTLD_DEFAULT, name.as_ptr()) };
    (!found.is_null()).then_some(found)
}

/// The function `name`.
///
/// # Safety
/// `F` is its type.
pub(crate) unsafe fn function<F: Copy>(name: &str) -> Option<F> {
    let found = address(name)?;
    // SAFETY: a function's address, of the type that the caller answers for.
    Some(unsafe { std::mem::transmute_copy(&found) })
}
