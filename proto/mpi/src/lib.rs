//! Messages of any size between the processes of an MPI world.
//!
//! The MPI library is opened at run time, so that one binary serves all of them and needs none where there is no group: the
//! standard ABI of MPI 5 (`libmpi_abi.so.1`; MPICH 5, Open MPI 6), the common ABI of MPICH, Intel MPI, MVAPICH and Cray MPICH
//! (`libmpi.so.12`), and Open MPI 4 and 5 (`libmpi.so.40`). `LAMINA_MPI_LIBRARY` names another. A dozen functions are used, all of them
//! point to point: no call is collective but the first and the last.

#[cfg(unix)]
mod engine;
#[cfg(unix)]
mod library;
mod mesh;

pub use mesh::{Inbox, MpiError, Outbox, in_process, join};
