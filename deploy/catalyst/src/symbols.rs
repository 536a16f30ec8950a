//! Functions and constants of the libraries that the process has loaded, by name.

use std::ffi::{CStr, CString, c_int, c_void};

/// Beginnings of names of libraries that are searched also where they were loaded for one module alone, as Python loads them.
const SEARCHED: [&[u8]; 3] = [b"libmpi", b"libconduit", b"libcatalyst"];

/// Where `name` lies, if a loaded library has it.
pub(crate) fn address(name: &str) -> Option<*mut c_void> {
    let name = CString::new(name).ok()?;
    // SAFETY: a lookup among the libraries that are loaded for all.
    let found = unsafe { libc::dlsym(libc::RTLD_DEFAULT, name.as_ptr()) };
    if !found.is_null() {
        return Some(found);
    }
    let mut search = SymbolSearch { name: &name, found: None };
    // SAFETY: the callback is called with `search` while this runs.
    unsafe { libc::dl_iterate_phdr(Some(visit), (&raw mut search).cast()) };
    search.found
}

/// The name that is looked for, and where it lies.
struct SymbolSearch<'a> {
    name: &'a CStr,
    found: Option<*mut c_void>,
}

/// Looks into one library that is loaded; 1 ends the search.
unsafe extern "C" fn visit(library: *mut libc::dl_phdr_info, _size: usize, search: *mut c_void) -> c_int {
    // SAFETY: `address` passes a SymbolSearch.
    let search = unsafe { &mut *search.cast::<SymbolSearch<'_>>() };
    // SAFETY: the loader passes a library whose path ends with a zero, or none.
    let path = unsafe { (*library).dlpi_name };
    if path.is_null() {
        return 0;
    }
    // SAFETY: as above.
    let file = unsafe { CStr::from_ptr(path) }.to_bytes();
    let file = file.rsplit(|byte| *byte == b'/').next().unwrap_or_default();
    if !SEARCHED.iter().any(|begin| file.starts_with(begin)) {
        return 0;
    }
    // SAFETY: nothing is loaded; the handle counts as one more use, which keeps what is found in place.
    let handle = unsafe { libc::dlopen(path, libc::RTLD_LAZY | libc::RTLD_NOLOAD) };
    if handle.is_null() {
        return 0;
    }
    // SAFETY: the handle is of a library that is loaded.
    let found = unsafe { libc::dlsym(handle, search.name.as_ptr()) };
    search.found = (!found.is_null()).then_some(found);
    c_int::from(search.found.is_some())
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
