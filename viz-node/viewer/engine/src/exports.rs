//! The interface of plain numbers. WebAssembly has one thread: one session serves all calls.
//!
//! A call returns a handle or 0 where all is well and -1 where it is not; what it answers, a [`Message`] or in the latter case a
//! sentence, lies at `lamina_answer`, `lamina_answer_length` bytes, until the next call.
#![expect(unsafe_code, reason = "exported symbols, and memory that the page fills")]

use crate::camera::Pose;
use crate::message::Message;
use crate::session::{self, Session};
use lamina_model::Invalid;
use lamina_raycast::kernel::VolumeKernel;
use lamina_vdi_render::Detail;
use lamina_vdi_render::kernel::VdiKernel;
use std::cell::RefCell;
use std::fmt::Display;

thread_local! {
    static SESSION: RefCell<Session> = RefCell::default();
    static ANSWER: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

fn answer<E: Display>(done: impl FnOnce(&mut Session) -> Result<(usize, Message), E>) -> i32 {
    let (code, bytes) = match SESSION.with_borrow_mut(done) {
        Ok((handle, Message(bytes))) => (handle as i32, bytes),
        Err(error) => (-1, error.to_string().into_bytes()),
    };
    ANSWER.set(bytes);
    code
}

fn said<E: Display>(done: impl FnOnce(&mut Session) -> Result<Message, E>) -> i32 {
    answer(|session| done(session).map(|message| (0, message)))
}

/// Room for `length` bytes that the page fills and hands to a call, which takes it.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_room(length: usize) -> *mut u8 {
    Box::into_raw(vec![0_u8; length].into_boxed_slice()).cast()
}

/// The room again.
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
unsafe fn take(start: *mut u8, length: usize) -> Box<[u8]> {
    // SAFETY: by the contract above.
    unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(start, length)) }
}

/// The bytes of the last answer.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_answer() -> *const u8 {
    ANSWER.with_borrow(|answer| answer.as_ptr())
}

/// Their number.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_answer_length() -> usize {
    ANSWER.with_borrow(Vec::len)
}

/// Decodes a step: [`Session::open`].
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_open(start: *mut u8, length: usize, max_decoded_bytes: f64) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    answer(|session| session.open(&bytes, max_decoded_bytes as u64))
}

/// The bytes of each of its bands whose geometry and colors can be decoded apart, as JSON.
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_band_sizes(start: *mut u8, length: usize, max_decoded_bytes: f64) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    said(|_| Ok::<_, Invalid>(session::band_sizes(&bytes, max_decoded_bytes as u64)))
}

/// [`Session::begin_geometry`] of a step.
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_begin_geometry(
    start: *mut u8,
    length: usize,
    band: usize,
    max_decoded_bytes: f64,
) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    said(|session| session.begin_geometry(&bytes, band, max_decoded_bytes as u64))
}

/// [`Session::geometry`].
#[unsafe(no_mangle)]
pub extern "C" fn lamina_geometry() -> i32 {
    said(Session::geometry)
}

/// [`Session::begin_colors`] of a step.
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_begin_colors(
    start: *mut u8,
    length: usize,
    band: usize,
    max_decoded_bytes: f64,
) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    said(|session| session.begin_colors(&bytes, band, max_decoded_bytes as u64))
}

/// [`Session::color`] of a slice.
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_color(start: *mut u8, length: usize) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    said(|session| session.color(&bytes))
}

/// [`Session::end_colors`].
#[unsafe(no_mangle)]
pub extern "C" fn lamina_end_colors() -> i32 {
    said(|session| Ok::<_, Invalid>(session.end_colors()))
}

/// The step of `length` bytes whose bands follow them in the room, `whole` bytes in all: [`Session::join`].
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `whole`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_join(start: *mut u8, length: usize, whole: usize, max_decoded_bytes: f64) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, whole) };
    let (step, bands) = bytes.split_at(length.min(whole));
    answer(|session| session.join(step, bands, max_decoded_bytes as u64))
}

/// The step with another appearance, JSON: [`Session::with_appearance`].
///
/// # Safety
/// `start` must be what [`lamina_room`] gave for `length`, and not taken before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_with_appearance(handle: usize, start: *mut u8, length: usize) -> i32 {
    // SAFETY: passed on.
    let bytes = unsafe { take(start, length) };
    let appearance = serde_json::from_slice(&bytes).map_err(|e| Invalid::new("appearance", e.to_string()));
    answer(|session| session.with_appearance(handle, &appearance?))
}

/// Forgets a step.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_close(handle: usize) {
    SESSION.with_borrow_mut(|session| session.close(handle));
}

/// [`Session::bindings`].
#[unsafe(no_mangle)]
pub extern "C" fn lamina_bindings(handle: usize) -> i32 {
    said(|session| session.bindings(handle))
}

fn pose(azimuth: f64, elevation: f64, zoom: f64, right: f64, up: f64, ahead: f64, roll: f64) -> Pose {
    Pose { azimuth, elevation, zoom, shift: [right, up, ahead], roll }
}

/// Nearest rays for `still` 0.
fn detail(still: u32) -> Detail {
    if still == 0 { Detail::Nearest } else { Detail::Cubic }
}

/// [`Session::view`]; nearest rays for `still` 0.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_view(
    handle: usize,
    azimuth: f64,
    elevation: f64,
    zoom: f64,
    right: f64,
    up: f64,
    ahead: f64,
    roll: f64,
    width: u32,
    height: u32,
    still: u32,
    first: u32,
    rows: u32,
) -> i32 {
    let pose = pose(azimuth, elevation, zoom, right, up, ahead, roll);
    said(|session| session.view(handle, &pose, [width, height], detail(still), [first, rows]))
}

/// [`Session::slice`].
#[unsafe(no_mangle)]
pub extern "C" fn lamina_slice(handle: usize, axis: u32, at: f64) -> i32 {
    said(|session| session.slice(handle, axis as usize, at))
}

/// [`Session::begin`]; nearest rays for `still` 0.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_begin(
    handle: usize,
    azimuth: f64,
    elevation: f64,
    zoom: f64,
    right: f64,
    up: f64,
    ahead: f64,
    roll: f64,
    width: u32,
    height: u32,
    still: u32,
) -> i32 {
    let pose = pose(azimuth, elevation, zoom, right, up, ahead, roll);
    said(|session| session.begin(handle, &pose, [width, height], detail(still)))
}

/// [`Session::advance`].
#[unsafe(no_mangle)]
pub extern "C" fn lamina_advance() -> i32 {
    said(Session::advance)
}

/// The WGSL that draws VDIs (0) or volumes (1).
#[unsafe(no_mangle)]
pub extern "C" fn lamina_source(volume: u32) -> i32 {
    let source = if volume == 0 { VdiKernel::SOURCE } else { VolumeKernel::SOURCE };
    said(|_| Ok::<_, Invalid>(Message::json(&source)))
}
