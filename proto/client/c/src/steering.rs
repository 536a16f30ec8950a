//! Steering: the numbers of the options, and requests handed out one by one.

use crate::{Connection, FAILED, connection, fail, guarded, invalid, text};
use lamina_client::{ClientError, SteerableNumber, SteeringRequest};
use std::ffi::c_char;

/// `lamina_number` of the header.
#[repr(C)]
pub struct CNumber {
    name: *const c_char,
    value: f64,
    least: f64,
    most: f64,
}

/// `lamina_request` of the header.
#[repr(C)]
pub struct Request {
    what: i32,
    number: i32,
    value: f64,
    asked_by: [u8; ASKED_BY],
}

/// Bytes for who asked, with the zero at the end.
const ASKED_BY: usize = 64;

const NOTHING: i32 = 0;
const PAUSE: i32 = 1;
const RESUME: i32 = 2;
const STOP: i32 = 3;
const SET: i32 = 4;

/// The numbers that the options state.
///
/// # Safety
/// `count` of them are at `numbers`, their names null or texts that end with a zero.
pub(crate) unsafe fn numbers(numbers: *const CNumber, count: u32) -> Result<Vec<SteerableNumber>, ClientError> {
    if numbers.is_null() && count > 0 {
        return Err(invalid("numbers", "is NULL"));
    }
    let read = |n: usize| {
        // SAFETY: one of those that are there, by the function's own condition.
        let number = unsafe { &*numbers.add(n) };
        // SAFETY: as above.
        let name = unsafe { text("numbers.name", number.name, "") }?.to_owned();
        let number = SteerableNumber { name, value: number.value, least: number.least, most: number.most };
        number.check().map_err(ClientError::from)
    };
    (0..count as usize).map(read).collect()
}

/// See `lamina.h`.
///
/// # Safety
/// `client` comes from [`lamina_connect_sized`](crate::lamina_connect_sized), is not closed, and no other thread uses it; `request` is null or
/// writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_steering(client: *mut Connection, request: *mut Request) -> i32 {
    let next = || {
        // SAFETY: by the function's own condition.
        let connection = unsafe { connection(client) }?;
        // SAFETY: null or writable, by the function's own condition.
        let place = unsafe { request.as_mut() }.ok_or_else(|| invalid("request", "is NULL"))?;
        *place = Request { what: NOTHING, number: -1, value: 0.0, asked_by: [0; ASKED_BY] };
        connection.requests.extend(connection.client.steering());
        let Some(steering) = connection.requests.pop_front() else { return Ok(NOTHING) };
        place.what = match steering.request {
            SteeringRequest::Pause => PAUSE,
            SteeringRequest::Resume => RESUME,
            SteeringRequest::Stop => STOP,
            SteeringRequest::Set { name, value } => {
                let numbers = connection.client.options().steering.iter().flatten();
                let at = numbers.into_iter().position(|number| number.name == name);
                place.number = at.map_or(-1, |at| at as i32);
                place.value = value;
                SET
            }
        };
        let words = steering.asked_by.floor_char_boundary(ASKED_BY - 1);
        place.asked_by[..words].copy_from_slice(&steering.asked_by.as_bytes()[..words]);
        Ok(place.what)
    };
    guarded(next).map_or(FAILED, |code| code.unwrap_or_else(|error| fail(&error)))
}
