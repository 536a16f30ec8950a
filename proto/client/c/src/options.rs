//! A run's options as the simulation states them.

use crate::steering::{self, CNumber};
use crate::{invalid, sizes, text, voxel_type};
use glam::DVec3;
use lamina_client::{ClientError, FullPolicy, RunOptions, launched_rank};
use lamina_model::{Coordinates, Grid, VoxelType};
use std::ffi::c_char;
use std::time::Duration;

/// Further fields that a node takes.
const MOST_FIELDS: usize = 64;

/// `lamina_options` of the header.
#[repr(C)]
pub struct Options {
    generator: *const c_char,
    name: *const c_char,
    field: *const c_char,
    dims: [u64; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
    voxel_type: i32,
    color_type: i32,
    color_field: *const c_char,
    rank: u32,
    ranks: u32,
    full_policy: i32,
    deadline_secs: f64,
    credentials: *const c_char,
    steering: i32,
    number_count: u32,
    numbers: *const CNumber,
    more_fields: *const CField,
    more_field_count: u32,
    shown: *const c_char,
    coordinates: [*const f64; 3],
}

impl Options {
    /// The options at `from`, of a program that may have been compiled for another version of this library: what it does not know
    /// yet has its default.
    ///
    /// # Errors
    /// There are none, or it states what this library does not know yet.
    ///
    /// # Safety
    /// `from` is null, or `size` bytes there may be read, of which each pointer is null or as the header says.
    pub(crate) unsafe fn read(from: *const Self, size: usize) -> Result<Self, ClientError> {
        if from.is_null() {
            return Err(invalid("run", "is NULL"));
        }
        // SAFETY: not null, so that many by the function's own condition.
        let bytes = unsafe { std::slice::from_raw_parts(from.cast::<u8>(), size) };
        let known = size.min(size_of::<Self>());
        if bytes[known..].iter().any(|&byte| byte != 0) {
            return Err(invalid("run", "states what this library does not know: lamina.h is newer than liblamina_c"));
        }
        let mut options = std::mem::MaybeUninit::<Self>::zeroed();
        // SAFETY: no more than both have; bytes that are zero are right for numbers and, as null, for pointers.
        unsafe {
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), options.as_mut_ptr().cast(), known);
            Ok(options.assume_init())
        }
    }
}

/// `lamina_field` of the header.
#[repr(C)]
pub struct CField {
    name: *const c_char,
    voxel_type: i32,
}

/// The run, with what is needed stated and defaults for the rest.
///
/// # Safety
/// Its pointers are null or texts that end with a zero; coordinates that are not null are as many as `dims` says.
pub(crate) unsafe fn run_options(run: &Options) -> Result<RunOptions, ClientError> {
    let needed = |thing, text: &str| match text {
        "" => Err(invalid(thing, "is not stated")),
        text => Ok(text.to_owned()),
    };
    // SAFETY: by the function's own condition, here and below.
    let read = |thing, pointer, otherwise| unsafe { text(thing, pointer, otherwise) };
    let spacing = if run.spacing == [0.0; 3] { [1.0; 3] } else { run.spacing };
    let mut grid = Grid::new(sizes("dims", run.dims)?, DVec3::from(spacing), DVec3::from(run.origin))?;
    let mut coordinates = None;
    if run.coordinates.iter().any(|axis| !axis.is_null()) {
        let mut axes = grid.coordinates();
        for (axis, positions) in axes.iter_mut().zip(run.coordinates).filter(|(_, positions)| !positions.is_null()) {
            let points = axis.len();
            // SAFETY: by the function's own condition.
            axis.copy_from_slice(unsafe { std::slice::from_raw_parts(positions, points) });
        }
        let given = Coordinates::new(axes)?;
        grid = given.grid()?;
        coordinates = Some(given);
    }
    let color_field = match needed("color_field", read("color_field", run.color_field, "")?) {
        Ok(name) => Some((name, voxel_type("color_type", run.color_type)?)),
        Err(_) => None,
    };
    // SAFETY: by the function's own condition.
    let more_fields = unsafe { more_fields(run) }?;
    let shown = Some(read("shown", run.shown, "")?).filter(|shown| !shown.is_empty()).map(str::to_owned);
    let full_policy = match run.full_policy {
        0 => FullPolicy::DropOldest,
        1 => FullPolicy::DropNewest,
        2 => FullPolicy::Block,
        other => {
            return Err(invalid(
                "full_policy",
                format!("{other} is none of LAMINA_DROP_OLDEST (0) to LAMINA_BLOCK (2)"),
            ));
        }
    };
    let deadline = match run.deadline_secs {
        0.0 => None,
        secs => Some(Duration::try_from_secs_f64(secs).map_err(|e| invalid("deadline_secs", format!("{secs}: {e}")))?),
    };
    for (thing, number) in [("rank", run.rank), ("ranks", run.ranks)] {
        if number > i32::MAX as u32 {
            return Err(invalid(thing, format!("{}: negative", number as i32)));
        }
    }
    let (name, field) = (needed("name", read("name", run.name, "")?)?, needed("field", read("field", run.field, "")?)?);
    let generator = read("generator", run.generator, "http://127.0.0.1:7101")?;
    let options = RunOptions::new(generator, &name, &field, grid, voxel_type("type", run.voxel_type)?);
    let deadline = deadline.unwrap_or(options.deadline);
    let (rank, ranks) = match (run.rank, run.ranks) {
        (0, 0) => launched_rank().unwrap_or((0, 1)),
        (rank, ranks) => (rank, ranks.max(1)),
    };
    let credentials =
        Some(read("credentials", run.credentials, "")?).filter(|folder| !folder.is_empty()).map(Into::into);
    // SAFETY: by the function's own condition.
    let numbers = unsafe { steering::numbers(run.numbers, run.number_count) }?;
    let steering = (run.steering != 0).then_some(numbers);
    Ok(RunOptions {
        color_field,
        coordinates,
        more_fields,
        shown,
        rank,
        ranks,
        full_policy,
        deadline,
        credentials,
        steering,
        ..options
    })
}

/// The further fields.
///
/// # Safety
/// As many are there as the run says, and their names are null or texts that end with a zero.
unsafe fn more_fields(run: &Options) -> Result<Vec<(String, VoxelType)>, ClientError> {
    let count = run.more_field_count as usize;
    if count == 0 {
        return Ok(Vec::new());
    }
    if run.more_fields.is_null() || count > MOST_FIELDS {
        return Err(invalid("more_fields", format!("is NULL, or {count} are more than {MOST_FIELDS}")));
    }
    // SAFETY: not null, and that many by the function's own condition.
    let fields = unsafe { std::slice::from_raw_parts(run.more_fields, count) };
    let read = |field: &CField| {
        // SAFETY: by the function's own condition.
        match unsafe { text("more_fields.name", field.name, "") }? {
            "" => Err(invalid("more_fields.name", "is not stated")),
            name => Ok((name.to_owned(), voxel_type("more_fields.type", field.voxel_type)?)),
        }
    };
    fields.iter().map(read).collect()
}
