//! Descriptors over a Unix socket: a slot's number, and with it the memory (SCM_RIGHTS).

use nix::cmsg_space;
use nix::sys::socket::{
    ControlMessage, ControlMessageOwned, MsgFlags, UnixAddr, getsockopt, recvmsg, sendmsg, sockopt::PeerCredentials,
};
use std::io::{self, IoSlice, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd, RawFd};

/// Bytes of a message.
const MESSAGE_BYTES: usize = 4;

/// Refuses a peer of another user.
///
/// # Errors
/// If it is one.
pub(crate) fn check_peer(socket: &impl AsFd) -> io::Result<()> {
    let peer = getsockopt(socket, PeerCredentials)?.uid();
    if peer == nix::unistd::geteuid().as_raw() || peer == 0 {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::PermissionDenied, format!("the other process belongs to user {peer}")))
}

/// Sends the memory of slot `slot`.
pub(crate) fn send(socket: &impl AsRawFd, slot: u32, memory: &OwnedFd) -> io::Result<()> {
    let (number, rights) = (slot.to_le_bytes(), [memory.as_raw_fd()]);
    let control = [ControlMessage::ScmRights(&rights)];
    let sent =
        sendmsg::<UnixAddr>(socket.as_raw_fd(), &[IoSlice::new(&number)], &control, MsgFlags::MSG_NOSIGNAL, None)?;
    if sent == MESSAGE_BYTES { Ok(()) } else { Err(io::ErrorKind::WriteZero.into()) }
}

/// The next slot and its memory; `None` at the end.
///
/// # Errors
/// `WouldBlock` if none is there yet; others if what comes is no such message.
#[allow(unsafe_code, reason = "descriptors that arrive are owned by nobody yet")]
pub(crate) fn receive(socket: RawFd) -> io::Result<Option<(u32, OwnedFd)>> {
    let (mut number, mut control) = ([0; MESSAGE_BYTES], cmsg_space!([RawFd; 1]));
    let mut parts = [IoSliceMut::new(&mut number)];
    let message = recvmsg::<UnixAddr>(socket, &mut parts, Some(&mut control), MsgFlags::MSG_CMSG_CLOEXEC)?;
    let bytes = message.bytes;
    let mut memory = Vec::new();
    for part in message.cmsgs()? {
        if let ControlMessageOwned::ScmRights(descriptors) = part {
            // SAFETY: the kernel has just opened them for this process, and nobody else knows of them.
            memory.extend(descriptors.into_iter().map(|fd| unsafe { OwnedFd::from_raw_fd(fd) }));
        }
    }
    match (bytes, memory.pop(), memory.is_empty()) {
        (0, None, _) => Ok(None),
        (MESSAGE_BYTES, Some(fd), true) => Ok(Some((u32::from_le_bytes(number), fd))),
        _ => Err(io::Error::new(io::ErrorKind::InvalidData, "not a slot's number and memory")),
    }
}
