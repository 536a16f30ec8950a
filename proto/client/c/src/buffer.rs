//! Buffers to compute into: given out by address, and known again by it when they are pushed.

use crate::{CBrick, Connection, FAILED, connection, fail, guarded, invalid, sizes};
use lamina_client::{Buffer, dense};
use std::ffi::c_void;

/// Buffers that may be out at once: a simulation that asks for more has forgotten to push.
const MOST_BUFFERS: usize = 16;

/// See `lamina.h`.
///
/// # Safety
/// `client` comes from [`lamina_connect_sized`], is not closed, and no other thread uses it; the others are null or as the header says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_buffer(
    client: *mut Connection,
    dims: *const [u64; 3],
    voxels: *mut *mut c_void,
    colors: *mut *mut c_void,
    more: *mut *mut c_void,
) -> i32 {
    let give = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        // SAFETY: null or readable, by the function's own condition.
        let dims = unsafe { dims.as_ref() }.ok_or_else(|| invalid("dims", "is NULL"))?;
        // SAFETY: null or writable, by the function's own condition.
        let place = unsafe { voxels.as_mut() }.ok_or_else(|| invalid("voxels", "is NULL"))?;
        *place = std::ptr::null_mut();
        if connection.buffers.len() >= MOST_BUFFERS {
            return Err(invalid("buffer", format!("{MOST_BUFFERS} of them are not pushed yet")));
        }
        let mut buffer = connection.client.buffer([0; 3], sizes("dims", *dims)?)?;
        let mut fields = buffer.addresses().into_iter();
        *place = fields.next().map_or(std::ptr::null_mut(), <*mut u8>::cast);
        let second = if connection.client.options().color_field.is_some() { fields.next() } else { None };
        // SAFETY: null or writable, by the function's own condition.
        if let Some(place) = unsafe { colors.as_mut() } {
            *place = second.map_or(std::ptr::null_mut(), <*mut u8>::cast);
        }
        if !more.is_null() {
            for (n, address) in fields.enumerate() {
                // SAFETY: there is room for as many as the run has further fields, by the function's own condition.
                unsafe { more.add(n).write(address.cast()) };
            }
        }
        connection.buffers.push(buffer);
        Ok(0)
    };
    guarded(give).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}

impl Connection {
    /// The buffer that the brick at `brick` is, if it is one as it was given out.
    ///
    /// # Safety
    /// It is null or as the header says.
    pub(crate) unsafe fn take_buffer(&mut self, brick: *const CBrick) -> Option<Buffer> {
        // SAFETY: null or valid, by the function's own condition.
        let given = unsafe { brick.as_ref() }?;
        let (dims, start) = (sizes("", given.dims).ok()?, sizes("", given.start).ok()?);
        let strides = sizes("", given.strides).ok()?;
        let whole = strides == [0; 3] || strides == dense(dims);
        let run = self.client.options();
        let colors = run.color_field.as_ref().map(|_| given.colors);
        // SAFETY: there are as many as the run has further fields, by the function's own condition.
        let more = unsafe { given.more(run.more_fields.len()) }.iter().map(|array| array.voxels);
        let fields: Vec<*const u8> =
            std::iter::once(given.voxels).chain(colors).chain(more).map(<*const _>::cast).collect();
        let is_it = |buffer: &Buffer| buffer.dims() == dims && buffer.is_at(&fields);
        let n = self.buffers.iter().position(is_it).filter(|_| whole)?;
        Some(self.buffers.swap_remove(n).at(start))
    }
}
