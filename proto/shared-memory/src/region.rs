//! A memory region of two processes: a memfd of fixed size, mapped by both. One page of header, then the data.
#![allow(unsafe_code, reason = "memory that another process maps, too")]

use crate::slot_state::SlotState;
use memmap2::{MmapOptions, MmapRaw};
use nix::fcntl::{FallocateFlags, FcntlArg, SealFlag, fallocate, fcntl};
use nix::sys::memfd::{MFdFlags, memfd_create};
use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::atomic::AtomicU32;

/// Where the data begins.
const HEADER_BYTES: usize = 4096;

/// A region that this process maps.
#[derive(Debug)]
pub(crate) struct Region {
    map: MmapRaw,
}

fn seals() -> SealFlag {
    SealFlag::F_SEAL_SHRINK | SealFlag::F_SEAL_GROW | SealFlag::F_SEAL_SEAL
}

impl Region {
    /// A new one for `bytes` of data, leased to its maker, and its descriptor. All its memory is there at once: no page is
    /// missing when it is written to.
    ///
    /// # Errors
    /// If the system gives no memory.
    pub(crate) fn create(bytes: usize) -> io::Result<(Self, OwnedFd)> {
        let fd = memfd_create(c"lamina", MFdFlags::MFD_CLOEXEC | MFdFlags::MFD_ALLOW_SEALING)?;
        let all = bytes.checked_add(HEADER_BYTES).and_then(|all| i64::try_from(all).ok());
        fallocate(&fd, FallocateFlags::empty(), 0, all.ok_or(io::ErrorKind::InvalidInput)?)?;
        fcntl(&fd, FcntlArg::F_ADD_SEALS(seals()))?;
        let region = Self::map(&fd)?;
        region.state().begin();
        Ok((region, fd))
    }

    /// The region behind a descriptor from another process, for at most `most_bytes` of data.
    ///
    /// # Errors
    /// If it is larger, is no memfd, or could still be made smaller: then reading it would end this process.
    pub(crate) fn open(fd: OwnedFd, most_bytes: u64) -> io::Result<Self> {
        let sealed = SealFlag::from_bits_retain(fcntl(&fd, FcntlArg::F_GET_SEALS)?);
        let fd = File::from(fd);
        let bytes = fd.metadata()?.len();
        let fits = bytes >= HEADER_BYTES as u64 && bytes - HEADER_BYTES as u64 <= most_bytes;
        if !sealed.contains(seals()) || !fits {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{bytes} bytes, seals {sealed:?}")));
        }
        Self::map(&fd)
    }

    fn map(fd: &impl AsRawFd) -> io::Result<Self> {
        Ok(Self { map: MmapOptions::new().populate().map_raw(fd)? })
    }

    /// Bytes of data.
    pub(crate) fn bytes(&self) -> usize {
        self.map.len() - HEADER_BYTES
    }

    /// Whose it is.
    pub(crate) fn state(&self) -> SlotState<'_, AtomicU32> {
        // SAFETY: the map begins on a page, has a header, and lives as long as `self`; both processes use the word atomically.
        SlotState(unsafe { AtomicU32::from_ptr(self.map.as_mut_ptr().cast()) })
    }

    /// The first `len` bytes of data, which the caller has kept.
    pub(crate) fn data(&self, len: usize) -> &[u8] {
        let len = len.min(self.bytes());
        // SAFETY: inside of the map, whose size is sealed. The sender writes to leased regions only; a process that breaks this is
        // of the same user, and its bytes are numbers without any invariant.
        unsafe { std::slice::from_raw_parts(self.map.as_mut_ptr().add(HEADER_BYTES), len) }
    }

    /// The first `len` bytes of data, to write to.
    ///
    /// # Safety
    /// The caller holds the only lease of this region, and no other slice of it in this process.
    #[allow(clippy::mut_from_ref, reason = "the lease is what makes it exclusive")]
    pub(crate) unsafe fn data_mut(&self, len: usize) -> &mut [u8] {
        let len = len.min(self.bytes());
        // SAFETY: inside of the map; exclusive by the function's own condition.
        unsafe { std::slice::from_raw_parts_mut(self.map.as_mut_ptr().add(HEADER_BYTES), len) }
    }
}
