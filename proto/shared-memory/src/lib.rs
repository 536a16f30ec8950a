//! Bytes from one process to another of the same host and user, without a copy in between.
//!
//! A sender writes into a slot of its [`Ring`], a sealed memfd that both processes map, and names the slot to the receiver by
//! other means (here: a gRPC message). The receiver reads where the sender wrote, and gives the slot back when it drops its
//! [`SharedBytes`]. Slots are made as they are needed, at most [`SLOTS`] a ring, and go to the receiver as descriptors over an
//! abstract Unix socket. Memory and socket have no name in any file system: they end with the processes, however those end.
//!
//! Both ends check that the other belongs to the same user (or is root): what one process writes while the other reads is
//! wrong data, which is no more than the same user's processes can do to each other anyway.
//!
//! On other systems than Linux, and on big-endian machines, no ring can be made, and senders use their other way.

#[cfg(all(target_os = "linux", target_endian = "little"))]
mod descriptor;
#[cfg(all(target_os = "linux", target_endian = "little"))]
mod receiver;
#[cfg(all(target_os = "linux", target_endian = "little"))]
mod region;
#[cfg(all(target_os = "linux", target_endian = "little"))]
mod sender;
#[cfg(all(target_os = "linux", target_endian = "little"))]
mod slot_state;
#[cfg(all(target_os = "linux", target_endian = "little"))]
pub use {
    receiver::{Receiver, Rings, SharedBytes},
    sender::{Lease, Ring},
};

#[cfg(not(all(target_os = "linux", target_endian = "little")))]
mod absent;
#[cfg(not(all(target_os = "linux", target_endian = "little")))]
pub use absent::{Lease, Receiver, Ring, Rings, SharedBytes};

/// Slots of a ring: three that the receiver may keep, one for the next hand-over, one to compute into meanwhile.
pub const SLOTS: usize = 5;

/// Slots of a ring that a receiver may keep; what comes while it does is to be copied, so that the sender finds a free one.
pub const KEPT_SLOTS: usize = 3;
