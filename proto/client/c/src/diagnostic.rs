//! Diagnostics: numbers told with a step.

use crate::{Connection, FAILED, connection, fail, guarded, invalid, text};
use std::ffi::c_char;

/// See `lamina.h`.
///
/// # Safety
/// `client` comes from [`lamina_connect_sized`](crate::lamina_connect_sized), is not closed, and no other thread uses it; `name` is null or
/// ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_diagnostic(client: *mut Connection, name: *const c_char, value: f64) -> i32 {
    let tell = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        if name.is_null() {
            return Err(invalid("diagnostic", "its name is NULL"));
        }
        // SAFETY: as above.
        let name = unsafe { text("diagnostic", name, "") }?;
        connection.client.diagnostic(name, value).map(|()| 0)
    };
    guarded(tell).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}
