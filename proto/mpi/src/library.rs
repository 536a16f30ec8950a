//! The MPI library: found at run time, of one of three binary interfaces.
#![allow(unsafe_code, reason = "calls into a C library")]

use crate::MpiError;
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW};
use std::ffi::{c_int, c_void};

type Init = unsafe extern "C" fn(*mut c_int, *mut c_void, c_int, *mut c_int) -> c_int;
type CommNumber = unsafe extern "C" fn(usize, *mut c_int) -> c_int;
type SetErrhandler = unsafe extern "C" fn(usize, usize) -> c_int;
type Isend = unsafe extern "C" fn(*const c_void, c_int, usize, c_int, c_int, usize, *mut usize) -> c_int;
type Irecv = unsafe extern "C" fn(*mut c_void, c_int, usize, c_int, c_int, usize, *mut usize) -> c_int;
type Test = unsafe extern "C" fn(*mut usize, *mut c_int, *mut c_void) -> c_int;
type Cancel = unsafe extern "C" fn(*mut usize) -> c_int;
type Finalize = unsafe extern "C" fn() -> c_int;

/// Handles and constants. Handles are pointers or `int`; both fit a register, and are passed as one.
struct Interface {
    comm_world: usize,
    byte: usize,
    errors_return: usize,
    thread_funneled: c_int,
}

/// By the standard (MPI 5.0, chapter 20).
const STANDARD: Interface = Interface { comm_world: 0x101, byte: 0x247, errors_return: 0x143, thread_funneled: 1024 };

/// By MPICH's `mpi.h` and those of its ABI initiative.
const MPICH: Interface =
    Interface { comm_world: 0x4400_0000, byte: 0x4c00_010d, errors_return: 0x5400_0001, thread_funneled: 1 };

/// The one tag that is used.
const TAG: c_int = 7101;

/// An opened and initialized library, used by one thread.
pub(crate) struct Mpi {
    name: String,
    interface: Interface,
    isend: Isend,
    irecv: Irecv,
    test: Test,
    cancel: Cancel,
    finalize: Finalize,
    /// Rank and size of the world.
    pub(crate) world: (u32, u32),
    /// Never closed: the functions above are in it.
    _library: &'static Library,
}

/// An operation that runs; its buffer must stay where it is until it is done.
pub(crate) struct Request(usize);

/// Files to try, the launcher's own kind first.
fn candidates() -> Vec<String> {
    if let Ok(named) = std::env::var("LAMINA_MPI_LIBRARY") {
        return vec![named];
    }
    let open_mpi_first = std::env::var_os("OMPI_COMM_WORLD_RANK").is_some();
    let order = if open_mpi_first {
        ["libmpi.so.40", "libmpi_abi.so.1", "libmpi.so.12"]
    } else {
        ["libmpi_abi.so.1", "libmpi.so.12", "libmpi.so.40"]
    };
    order.map(str::to_owned).to_vec()
}

impl Mpi {
    /// Opens the library and joins the world.
    ///
    /// # Errors
    /// If there is none, or it fails.
    pub(crate) fn open() -> Result<Self, MpiError> {
        let mut reasons = Vec::new();
        for name in candidates() {
            // SAFETY: an MPI library runs its initializers, as when a program is linked to it. Open MPI's plug-ins need it global.
            match unsafe { Library::open(Some(&name), RTLD_NOW | RTLD_GLOBAL) } {
                Ok(library) => return Self::start(name, Box::leak(Box::new(library))),
                Err(reason) => reasons.push(reason.to_string()),
            }
        }
        Err(MpiError::Missing(reasons.join("; ")))
    }

    fn start(name: String, library: &'static Library) -> Result<Self, MpiError> {
        /// The function `$name` as `$type`.
        macro_rules! function {
            ($name:literal, $type:ty) => {{
                // SAFETY: MPI's standard gives the function's signature; handles are passed in a register each.
                let found = unsafe { library.get::<$type>(concat!($name, "\0").as_bytes()) };
                *found.map_err(|e| MpiError::Missing(format!("{name}: {e}")))?
            }};
        }
        // SAFETY: addresses alone are taken, of data that the library has or has not.
        let address =
            |symbol: &str| unsafe { library.get::<*const c_void>(symbol.as_bytes()) }.map(|s| s.into_raw() as usize);
        let interface = match ["ompi_mpi_comm_world", "ompi_mpi_byte", "ompi_mpi_errors_return"].map(address) {
            _ if name.contains("mpi_abi") => STANDARD,
            [Ok(comm_world), Ok(byte), Ok(errors_return)] => {
                Interface { comm_world, byte, errors_return, thread_funneled: 1 }
            }
            _ => MPICH,
        };
        let mut mpi = Self {
            isend: function!("MPI_Isend", Isend),
            irecv: function!("MPI_Irecv", Irecv),
            test: function!("MPI_Test", Test),
            cancel: function!("MPI_Cancel", Cancel),
            finalize: function!("MPI_Finalize", Finalize),
            world: (0, 1),
            interface,
            name: name.clone(),
            _library: library,
        };
        let (init, rank, size, handler) = (
            function!("MPI_Init_thread", Init),
            function!("MPI_Comm_rank", CommNumber),
            function!("MPI_Comm_size", CommNumber),
            function!("MPI_Comm_set_errhandler", SetErrhandler),
        );
        let (mut provided, mut numbers) = (0, [0; 2]);
        let world = mpi.interface.comm_world;
        // SAFETY: null arguments are allowed; the others are places of this function.
        let code = unsafe {
            init(std::ptr::null_mut(), std::ptr::null_mut(), mpi.interface.thread_funneled, &raw mut provided)
        };
        mpi.check("MPI_Init_thread", code)?;
        // SAFETY: MPI is initialized, and the handles are its own.
        mpi.check("MPI_Comm_set_errhandler", unsafe { handler(world, mpi.interface.errors_return) })?;
        // SAFETY: as above.
        mpi.check("MPI_Comm_rank", unsafe { rank(world, &raw mut numbers[0]) })?;
        // SAFETY: as above.
        mpi.check("MPI_Comm_size", unsafe { size(world, &raw mut numbers[1]) })?;
        mpi.world = (numbers[0] as u32, numbers[1] as u32);
        Ok(mpi)
    }

    fn check(&self, call: &'static str, code: c_int) -> Result<(), MpiError> {
        if code == 0 { Ok(()) } else { Err(MpiError::Failed { library: self.name.clone(), call, code }) }
    }

    /// The library's file.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Begins to send `bytes` to process `to`.
    ///
    /// # Safety
    /// `bytes` stays where it is until the request is done.
    pub(crate) unsafe fn send(&self, to: u32, bytes: &[u8]) -> Result<Request, MpiError> {
        let (mut request, count) = (0, bytes.len() as c_int);
        let Interface { comm_world, byte, .. } = self.interface;
        // SAFETY: the bytes stay, by the function's own condition.
        let code =
            unsafe { (self.isend)(bytes.as_ptr().cast(), count, byte, to as c_int, TAG, comm_world, &raw mut request) };
        self.check("MPI_Isend", code).map(|()| Request(request))
    }

    /// Begins to receive `bytes` from process `from`.
    ///
    /// # Safety
    /// `bytes` stays where it is, and nobody looks at it, until the request is done.
    pub(crate) unsafe fn receive(&self, from: u32, bytes: &mut [u8]) -> Result<Request, MpiError> {
        let (mut request, count) = (0, bytes.len() as c_int);
        let Interface { comm_world, byte, .. } = self.interface;
        // SAFETY: the bytes stay and are not looked at, by the function's own condition.
        let code = unsafe {
            (self.irecv)(bytes.as_mut_ptr().cast(), count, byte, from as c_int, TAG, comm_world, &raw mut request)
        };
        self.check("MPI_Irecv", code).map(|()| Request(request))
    }

    /// True if the operation is done.
    pub(crate) fn is_done(&self, request: &mut Request) -> Result<bool, MpiError> {
        // Larger than any library's MPI_Status.
        let (mut done, mut status) = (0, [0_u64; 16]);
        // SAFETY: the request is one that is not done yet; the status has room.
        let code = unsafe { (self.test)(&raw mut request.0, &raw mut done, status.as_mut_ptr().cast()) };
        self.check("MPI_Test", code).map(|()| done != 0)
    }

    /// Takes back a receive for which nothing has come; it is done soon.
    pub(crate) fn cancel(&self, request: &mut Request) {
        // SAFETY: the request is one that is not done yet.
        unsafe { (self.cancel)(&raw mut request.0) };
    }

    /// Leaves the world, once all have said that they do.
    pub(crate) fn finalize(&self) {
        // SAFETY: nothing is in flight, and no call comes after it.
        unsafe { (self.finalize)() };
    }
}
