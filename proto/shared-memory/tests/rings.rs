//! Two ends in one process: bytes arrive where they were written, slots are bounded and come back, and neither end trusts the other.
#![cfg(all(target_os = "linux", target_endian = "little"))]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_shared_memory::{KEPT_SLOTS, Lease, Receiver, Ring, Rings, SLOTS};
use nix::sys::memfd::{MFdFlags, memfd_create};
use nix::sys::socket::{ControlMessage, MsgFlags, UnixAddr, sendmsg};
use std::io::{IoSlice, Read};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixStream};
use std::sync::Arc;

const MOST_BYTES: u64 = 1 << 20;

/// A receiver that runs in the background, and the name of its socket.
fn receiver() -> (Arc<Rings>, String) {
    let receiver = Receiver::bind(MOST_BYTES).unwrap();
    let (rings, name) = (Arc::new(Rings::default()), receiver.name().to_owned());
    let served = rings.clone();
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(receiver.serve(served))
    });
    (rings, name)
}

fn filled(ring: &mut Ring, bytes: usize, value: u8) -> Lease {
    let mut lease = ring.lease(bytes).unwrap().unwrap();
    lease.bytes_mut().fill(value);
    lease
}

#[test]
fn bytes_are_read_where_they_were_written_and_the_slot_comes_back() {
    let (rings, name) = receiver();
    let mut ring = Ring::connect(&name).unwrap();
    for value in 1..=20 {
        let lease = filled(&mut ring, 10_000, value);
        assert!(lease.is_of(&ring));
        // Not handed over yet.
        assert!(rings.take(lease.ring(), lease.slot(), 10_000).is_none());
        lease.hand_over();
        let taken = rings.take(lease.ring(), lease.slot(), 10_000).unwrap();
        assert_eq!((lease.slot(), taken.kept_slots()), (0, 1), "one slot serves them all");
        assert!(rings.take(lease.ring(), 0, 10_000).is_none(), "what is kept is not handed over a second time");
        assert!(taken.len() == 10_000 && taken.iter().all(|&b| b == value));
    }
}

#[test]
fn a_ring_is_bounded_and_grows_with_what_is_asked() {
    let (rings, name) = receiver();
    let mut ring = Ring::connect(&name).unwrap();
    let mut kept = Vec::new();
    for slot in 0..SLOTS as u32 {
        let lease = filled(&mut ring, 100, slot as u8);
        lease.hand_over();
        kept.push(rings.take(lease.ring(), lease.slot(), 100).unwrap());
    }
    assert!(kept.last().unwrap().kept_slots() == SLOTS && SLOTS > KEPT_SLOTS);
    assert!(ring.lease(100).unwrap().is_none());
    // The second one comes back, and is made larger in its place.
    drop(kept.remove(1));
    let lease = filled(&mut ring, 5000, 9);
    assert_eq!(lease.slot(), 1);
    lease.hand_over();
    assert!(rings.take(lease.ring(), 1, 5000).unwrap().iter().all(|&b| b == 9));
    assert!(kept.iter().zip([0, 2, 3, 4]).all(|(bytes, value)| bytes.iter().all(|&b| b == value)));
    // What was never handed over is free again.
    drop(ring.lease(100).unwrap().unwrap());
    assert_eq!(ring.lease(100).unwrap().unwrap().slot(), 1);
}

#[test]
fn what_is_kept_outlives_the_sender_and_nothing_else_does() {
    let (rings, name) = receiver();
    let mut ring = Ring::connect(&name).unwrap();
    let lease = filled(&mut ring, 100, 7);
    lease.hand_over();
    let (id, slot) = (lease.ring(), lease.slot());
    let kept = rings.take(id, slot, 100).unwrap();
    drop((ring, lease));
    while rings.take(id, slot, 100).is_some() {
        std::thread::yield_now();
    }
    assert!(kept.iter().all(|&b| b == 7));
}

#[test]
fn memory_that_is_too_large_absent_or_unsealed_is_refused() {
    let (rings, name) = receiver();
    let mut ring = Ring::connect(&name).unwrap();
    assert!(ring.lease(MOST_BYTES as usize + 1).is_err(), "the receiver hangs up");
    assert!(rings.take(0, 0, 1).is_none() && rings.take(99, 0, 1).is_none() && rings.take(0, 99, 1).is_none());
    // A memfd that its sender could make smaller while it is read.
    let mut socket = UnixStream::connect_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
    socket.read_exact(&mut [0; 8]).unwrap();
    let memory: OwnedFd = memfd_create(c"unsealed", MFdFlags::MFD_ALLOW_SEALING).unwrap();
    let rights = [memory.as_raw_fd()];
    let control = [ControlMessage::ScmRights(&rights)];
    sendmsg::<UnixAddr>(socket.as_raw_fd(), &[IoSlice::new(&[0; 4])], &control, MsgFlags::empty(), None).unwrap();
    assert_eq!(socket.read(&mut [0; 8]).unwrap(), 0, "it hangs up");
    // A lease asked of no receiver at all.
    assert!(Ring::connect("lamina-nobody").is_err());
}
