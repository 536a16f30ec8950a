//! The simulation's client behind a C interface; `lamina.h` says what each function does.

mod buffer;
mod diagnostic;
mod options;
mod steering;

use half::f16;
use lamina_client::{Brick, Buffer, Client, ClientError, Receipt, Steering, VoxelSlice, check_type, dense, span};
use lamina_model::{Invalid, VoxelType};
use options::{Options, run_options};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// `lamina_brick` of the header.
#[repr(C)]
pub struct CBrick {
    start: [u64; 3],
    dims: [u64; 3],
    strides: [u64; 3],
    voxels: *const c_void,
    colors: *const c_void,
    voxel_type: i32,
    color_type: i32,
    more: *const CArray,
}

/// `lamina_array` of the header.
#[repr(C)]
pub struct CArray {
    voxels: *const c_void,
    voxel_type: i32,
}

impl CBrick {
    /// The arrays of its further fields; none where they are not stated.
    ///
    /// # Safety
    /// `count` of them are there, or the pointer is null.
    unsafe fn more(&self, count: usize) -> &[CArray] {
        if self.more.is_null() {
            return &[];
        }
        // SAFETY: by the function's own condition.
        unsafe { std::slice::from_raw_parts(self.more, count) }
    }
}

/// `lamina_summary` of the header.
#[repr(C)]
pub struct Summary {
    pushed: u64,
    dropped: u64,
    lost: u64,
    run_dropped_steps: i64,
}

/// `lamina_client` of the header.
pub struct Connection {
    client: Client,
    /// The process that opened it: a fork's child has its memory, but not its thread.
    process: u32,
    /// Pushes that never reached the client.
    unfit: u64,
    /// Given out and not pushed yet.
    buffers: Vec<Buffer>,
    /// Asked for and not given out yet.
    requests: VecDeque<Steering>,
}

const DROPPED: i32 = 1;
const FAILED: i32 = -5;

thread_local! {
    static ERROR: RefCell<CString> = RefCell::default();
}

/// Keeps the words of an error for [`lamina_error`]; its code.
fn fail(error: &ClientError) -> i32 {
    remember(&error.to_string());
    match error {
        ClientError::Invalid(_) => -1,
        ClientError::Refused(_) => -2,
        ClientError::Unreachable { .. } => -3,
        ClientError::Deadline(_) => -4,
        ClientError::Runtime(_) => FAILED,
    }
}

fn remember(words: &str) {
    let words = CString::new(words.replace('\0', " ")).unwrap_or_default();
    // A thread that is ending has no place for it any more.
    let _ = ERROR.try_with(|error| *error.borrow_mut() = words);
}

/// What `work` gives; `None` if it panicked, for no panic may reach the simulation.
fn guarded<T>(work: impl FnOnce() -> T) -> Option<T> {
    let done = catch_unwind(AssertUnwindSafe(work)).ok();
    if done.is_none() {
        remember("a fault in the client; its message is on standard error");
    }
    done
}

fn invalid(thing: &'static str, reason: impl Into<String>) -> ClientError {
    Invalid::new(thing, reason).into()
}

/// The text at `text`, which is `otherwise` where that is null.
///
/// # Safety
/// It is null or ends with a zero.
unsafe fn text<'a>(thing: &'static str, text: *const c_char, otherwise: &'a str) -> Result<&'a str, ClientError> {
    if text.is_null() {
        return Ok(otherwise);
    }
    // SAFETY: by the function's own condition.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| invalid(thing, "is not UTF-8"))
}

fn voxel_type(thing: &'static str, code: i32) -> Result<VoxelType, ClientError> {
    use VoxelType::{F16, F32, F64, I16, U8, U16};
    let known = usize::try_from(code).ok().and_then(|n| [U8, U16, I16, F16, F32, F64].get(n.wrapping_sub(1)).copied());
    known.ok_or_else(|| invalid(thing, format!("{code} is none of LAMINA_U8 (1) to LAMINA_F64 (6)")))
}

/// Numbers that C calls unsigned; what was negative in the simulation is refused as such.
fn sizes(thing: &'static str, numbers: [u64; 3]) -> Result<[usize; 3], ClientError> {
    let signed = numbers.map(|n| n as i64);
    if signed.iter().any(|&n| n < 0) {
        return Err(invalid(thing, format!("{signed:?}: negative numbers, or some beyond counting")));
    }
    if numbers.iter().any(|&n| usize::try_from(n).is_err()) {
        return Err(invalid(thing, format!("{numbers:?} is beyond counting here")));
    }
    Ok(numbers.map(|n| n as usize))
}

/// `count` voxels from `first` on.
///
/// # Safety
/// That many of the type are there, and nothing writes to them while the slice lives.
unsafe fn slice<'a>(
    thing: &'static str,
    first: *const c_void,
    count: usize,
    voxel_type: VoxelType,
) -> Result<VoxelSlice<'a>, ClientError> {
    let bytes = voxel_type.size_bytes();
    if first.is_null() || !(first as usize).is_multiple_of(bytes) {
        let laid_out = if thing != "brick.voxels" { ", or not laid out as the voxels are" } else { "" };
        let null = || format!("is NULL{laid_out}");
        return Err(invalid(thing, if first.is_null() { null() } else { "is not aligned to its type".to_owned() }));
    }
    if count.checked_mul(bytes).is_none_or(|all| isize::try_from(all).is_err()) {
        return Err(invalid(thing, format!("{count} voxels are more than memory holds")));
    }
    macro_rules! typed {
        ($t:ty) => {{
            // SAFETY: not null, aligned and small enough, as checked; there by the function's own condition.
            let voxels = unsafe { std::slice::from_raw_parts(first.cast::<$t>(), count) };
            voxels.into()
        }};
    }
    Ok(match voxel_type {
        VoxelType::U8 => typed!(u8),
        VoxelType::U16 => typed!(u16),
        VoxelType::I16 => typed!(i16),
        VoxelType::F16 => typed!(f16),
        VoxelType::F32 => typed!(f32),
        VoxelType::F64 => typed!(f64),
    })
}

/// See `lamina.h`.
///
/// # Safety
/// `run` is null or as the header says and has `size` bytes, `client` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_connect_sized(run: *const Options, size: usize, client: *mut *mut Connection) -> i32 {
    let connect = || {
        // SAFETY: null or writable, by the function's own condition.
        let place = unsafe { client.as_mut() }.ok_or_else(|| invalid("client", "is NULL"))?;
        *place = std::ptr::null_mut();
        // SAFETY: null or that many bytes, by the function's own condition, which holds for the texts too.
        let options = unsafe { run_options(&Options::read(run, size)?) }?;
        let client = Client::connect(options)?;
        let connection = Connection {
            client,
            process: std::process::id(),
            unfit: 0,
            buffers: Vec::new(),
            requests: VecDeque::new(),
        };
        *place = Box::into_raw(Box::new(connection));
        Ok(0)
    };
    guarded(connect).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}

/// See `lamina.h`.
///
/// # Safety
/// `client` comes from [`lamina_connect_sized`], is not closed, and no other thread uses it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_wants(client: *mut Connection, step: u64) -> i32 {
    let wants = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        checked_step(step).inspect_err(|_| connection.unfit += 1)?;
        connection.client.wants(step).map(i32::from)
    };
    guarded(wants).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}

/// See `lamina.h`.
///
/// # Safety
/// `client` comes from [`lamina_connect_sized`], is not closed, and no other thread uses it; `brick` is as the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_push(client: *mut Connection, step: u64, time: f64, brick: *const CBrick) -> i32 {
    let push = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        // SAFETY: by the function's own condition.
        let mut more = Vec::new();
        // SAFETY: by the function's own condition.
        let read = unsafe { connection.read(step, brick, &mut more) };
        let read = read.inspect_err(|_| connection.unfit += 1)?;
        // SAFETY: as above.
        let pushed = match unsafe { connection.take_buffer(brick) } {
            Some(buffer) => connection.client.push_buffer(step, time, buffer),
            None => connection.client.push(step, time, &read),
        };
        pushed.map(code_of)
    };
    guarded(push).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}

/// See `lamina.h`.
///
/// # Safety
/// As of [`lamina_push`]; `count` bricks are at `bricks`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_push_bricks(
    client: *mut Connection,
    step: u64,
    time: f64,
    bricks: *const CBrick,
    count: usize,
) -> i32 {
    let push = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        if bricks.is_null() && count > 0 {
            return Err(invalid("bricks", "is NULL"));
        }
        // SAFETY: that many are there, by the function's own condition.
        let mut more = vec![Vec::new(); count];
        let each = more.iter_mut().enumerate();
        // SAFETY: that many are there, by the function's own condition.
        let read = each.map(|(n, more)| unsafe { connection.read(step, bricks.wrapping_add(n), more) }).collect();
        let read: Vec<Brick> = Result::inspect_err(read, |_| connection.unfit += count as u64)?;
        connection.client.push_bricks(step, time, &read).map(code_of)
    };
    guarded(push).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}

/// A step that C calls unsigned; one that was negative in the simulation is refused as such.
fn checked_step(step: u64) -> Result<(), ClientError> {
    if step > i64::MAX as u64 { Err(invalid("step", format!("{} is negative", step as i64))) } else { Ok(()) }
}

fn code_of(receipt: Receipt) -> i32 {
    match receipt {
        Receipt::Admitted(_) => 0,
        Receipt::Dropped => DROPPED,
    }
}

/// The connection behind a pointer from the simulation.
///
/// # Safety
/// It is null, or comes from [`lamina_connect_sized`], is not closed, and no other thread uses it.
unsafe fn connection<'a>(client: *mut Connection) -> Result<&'a mut Connection, ClientError> {
    // SAFETY: null or valid and used by nobody else, by the function's own condition.
    let connection = unsafe { client.as_mut() }.ok_or_else(|| invalid("client", "is NULL"))?;
    if connection.process == std::process::id() {
        return Ok(connection);
    }
    Err(invalid("client", "belongs to the process that this one was forked from; connect after forking"))
}

impl Connection {
    /// The brick at `brick`, of a step that there is.
    ///
    /// # Safety
    /// It is null or as the header says, and what it refers to outlives the result.
    unsafe fn read<'a>(
        &self,
        step: u64,
        brick: *const CBrick,
        more: &'a mut Vec<VoxelSlice<'a>>,
    ) -> Result<Brick<'a>, ClientError> {
        checked_step(step)?;
        // SAFETY: null or valid, by the function's own condition.
        let given = unsafe { brick.as_ref() }.ok_or_else(|| invalid("brick", "is NULL"))?;
        let (start, dims) = (sizes("brick.start", given.start)?, sizes("brick.dims", given.dims)?);
        let strides = match sizes("brick.strides", given.strides)? {
            [0, 0, 0] => dense(dims),
            stated => stated,
        };
        let span = span(dims, strides)?;
        // Before anything is taken for what it is not.
        let check = |thing, stated, name: &str, of_run| {
            let given = if stated == 0 { of_run } else { voxel_type(thing, stated)? };
            check_type(name, given, of_run).map(|()| given).map_err(ClientError::from)
        };
        let run = self.client.options();
        let of_voxels = check("brick.type", given.voxel_type, &run.field, run.voxel_type)?;
        // SAFETY: the brick's voxels reach so far, by the function's own condition.
        let voxels = unsafe { slice("brick.voxels", given.voxels, span, of_voxels) }?;
        let mut brick = Brick::new(start, dims, voxels).with_strides(strides);
        if !given.colors.is_null() || given.color_type != 0 {
            let second = run.color_field.as_ref();
            let (name, of_run) = second.ok_or_else(|| invalid("brick.colors", "the run names no color_field"))?;
            let of_colors = check("brick.color_type", given.color_type, name, *of_run)?;
            // SAFETY: as for the voxels.
            brick = brick.with_colors(unsafe { slice("brick.colors", given.colors, span, of_colors) }?);
        }
        // SAFETY: as many as the run has are there, by the function's own condition.
        let arrays = unsafe { given.more(run.more_fields.len()) };
        for (array, (name, of_run)) in arrays.iter().zip(&run.more_fields) {
            let of_array = check("brick.more.type", array.voxel_type, name, *of_run)?;
            // SAFETY: as for the voxels.
            more.push(unsafe { slice("brick.more.voxels", array.voxels, span, of_array) }?);
        }
        Ok(brick.with_more_fields(more))
    }
}

/// See `lamina.h`.
///
/// # Safety
/// `client` is null or comes from [`lamina_connect_sized`], and nobody uses it any more; `summary` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_close(client: *mut Connection, summary: *mut Summary) {
    if client.is_null() {
        return;
    }
    // SAFETY: made by `Box::into_raw` there, and given back once, by the function's own condition.
    let connection = unsafe { Box::from_raw(client) };
    let (before, unfit) = (connection.client.summary(), connection.unfit);
    let closed = if connection.process == std::process::id() {
        guarded(|| connection.client.close()).unwrap_or(before)
    } else {
        // Its thread is in the other process, which closes it.
        std::mem::forget(connection);
        before
    };
    // SAFETY: null or writable, by the function's own condition.
    if let Some(place) = unsafe { summary.as_mut() } {
        *place = Summary {
            pushed: closed.pushed,
            dropped: closed.dropped,
            lost: closed.lost + unfit,
            run_dropped_steps: closed.run_dropped_steps.map_or(-1, |n| n.min(i64::MAX as u64) as i64),
        };
    }
}

/// See `lamina.h`.
#[unsafe(no_mangle)]
pub extern "C" fn lamina_error() -> *const c_char {
    ERROR.try_with(|error| error.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
