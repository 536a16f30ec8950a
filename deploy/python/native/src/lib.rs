//! What `lamina.read` of the Python package calls: a file opened, described as JSON, copied into arrays and drawn.
//!
//! A function returns 0, or -1 with a sentence at [`lamina_read_error`]; -2, if that will be the same when the file is finished.

mod opened;

use lamina_volume_io::ReadError;
use opened::{OpenedFile, Request};
use std::cell::RefCell;
use std::error::Error;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static ERROR: RefCell<CString> = RefCell::default();
}

/// 0 where `work` succeeds; else -1 or -2, and its error is kept. No panic crosses to Python.
fn guarded(work: impl FnOnce() -> Result<(), Box<dyn Error>>) -> i32 {
    let (code, error) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return 0,
        Ok(Err(error)) if error.downcast_ref().is_some_and(ReadError::is_lasting) => (-2, error.to_string()),
        Ok(Err(error)) => (-1, error.to_string()),
        Err(_) => (-1, "a fault in the reader; its message is on standard error".to_owned()),
    };
    ERROR.set(CString::new(error.replace('\0', " ")).unwrap_or_default());
    code
}

/// The sentence of this thread's last error, until its next one.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_read_error() -> *const c_char {
    ERROR.with_borrow(|error| error.as_ptr())
}

/// Opens what `request`, JSON of [`Request`], names.
///
/// # Safety
/// `request` ends with a zero; `opened` may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_open(request: *const c_char, opened: *mut *mut OpenedFile) -> i32 {
    guarded(|| {
        // SAFETY: by the function's own condition.
        let request = unsafe { CStr::from_ptr(request) };
        let request: Request = serde_json::from_slice(request.to_bytes())?;
        let file = Box::new(OpenedFile::open(&request)?);
        // SAFETY: by the function's own condition.
        unsafe { *opened = Box::into_raw(file) };
        Ok(())
    })
}

/// What is known of it, JSON, until it is closed.
///
/// # Safety
/// `opened` came from [`lamina_read_open`] and is not closed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_description(opened: *const OpenedFile) -> *const c_char {
    // SAFETY: by the function's own condition.
    unsafe { &*opened }.description().as_ptr()
}

/// Copies array `name`, which the description lists, into `size` bytes at `to`.
///
/// # Safety
/// `opened` as above; `name` ends with a zero; `size` bytes at `to` may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_array(
    opened: *const OpenedFile,
    name: *const c_char,
    to: *mut u8,
    size: usize,
) -> i32 {
    guarded(|| {
        // SAFETY: by the function's own condition.
        let (opened, name) = unsafe { (&*opened, CStr::from_ptr(name)) };
        // SAFETY: by the function's own condition; an empty slice needs no memory, but an address.
        let to = if size == 0 { &mut [][..] } else { unsafe { std::slice::from_raw_parts_mut(to, size) } };
        opened.copy(name.to_str()?, to)
    })
}

/// Draws the camera that `camera`, JSON, states, as `height` rows of `width` pixels of three floats at `to`: linear RGB in 0..1 as in
/// [`lamina_model::Image`].
///
/// # Safety
/// `opened` as above; `camera` ends with a zero; 12 x `width` x `height` bytes at `to` may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_picture(
    opened: *mut OpenedFile,
    camera: *const c_char,
    width: u32,
    height: u32,
    to: *mut f32,
) -> i32 {
    guarded(|| {
        // SAFETY: by the function's own condition.
        let (opened, camera) = unsafe { (&mut *opened, CStr::from_ptr(camera)) };
        let image = opened.draw(&serde_json::from_slice(camera.to_bytes())?, width, height)?;
        let values = image.pixels().as_flattened();
        // SAFETY: by the function's own condition: the image has width x height pixels.
        unsafe { std::ptr::copy_nonoverlapping(values.as_ptr(), to, values.len()) };
        Ok(())
    })
}

/// The same of depths instead of colors, a float a pixel: as [`lamina_vdi_render::Drawable::half_depths`].
///
/// # Safety
/// `opened` as above; `camera` ends with a zero; 4 x `width` x `height` bytes at `to` may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_depths(
    opened: *mut OpenedFile,
    camera: *const c_char,
    width: u32,
    height: u32,
    to: *mut f32,
) -> i32 {
    guarded(|| {
        // SAFETY: by the function's own condition.
        let (opened, camera) = unsafe { (&mut *opened, CStr::from_ptr(camera)) };
        let depths = opened.half_depths(&serde_json::from_slice(camera.to_bytes())?, width, height)?;
        // SAFETY: by the function's own condition: there are width x height depths.
        unsafe { std::ptr::copy_nonoverlapping(depths.as_ptr(), to, depths.len()) };
        Ok(())
    })
}

/// The camera turned about its target, JSON from JSON; valid until the thread's next error or orbit.
///
/// # Safety
/// `camera` ends with a zero; `turned` may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_orbit(
    camera: *const c_char,
    azimuth_deg: f64,
    elevation_deg: f64,
    zoom: f64,
    turned: *mut *const c_char,
) -> i32 {
    thread_local! {
        static TURNED: RefCell<CString> = RefCell::default();
    }
    guarded(|| {
        // SAFETY: by the function's own condition.
        let camera: lamina_model::Camera = serde_json::from_slice(unsafe { CStr::from_ptr(camera) }.to_bytes())?;
        let camera = camera.orbit(azimuth_deg, elevation_deg, zoom)?;
        TURNED.set(CString::new(serde_json::to_vec(&camera)?)?);
        // SAFETY: by the function's own condition.
        unsafe { *turned = TURNED.with_borrow(|text| text.as_ptr()) };
        Ok(())
    })
}

/// Frees it.
///
/// # Safety
/// `opened` came from [`lamina_read_open`], and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_read_close(opened: *mut OpenedFile) {
    // SAFETY: by the function's own condition.
    drop(unsafe { Box::from_raw(opened) });
}
