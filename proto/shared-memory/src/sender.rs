//! The sender: slots to write into, made as they are needed.
#![allow(unsafe_code, reason = "a lease is exclusive by construction")]

use crate::region::Region;
use crate::{SLOTS, descriptor};
use std::io::{self, Read};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The longest a receiver may take to map a slot.
const PATIENCE: Duration = Duration::from_secs(2);

/// A sender's slots at one receiver. A connection that is lost ends it; leases outlive it.
#[derive(Debug)]
pub struct Ring {
    socket: UnixStream,
    id: u64,
    slots: Vec<Arc<Region>>,
}

/// Memory of a slot, this process's alone until it is handed over.
#[derive(Debug)]
pub struct Lease {
    region: Arc<Region>,
    bytes: usize,
    ring: u64,
    slot: u32,
    handed_over: AtomicBool,
}

impl Ring {
    /// Connects to the receiver behind the abstract socket `name`.
    ///
    /// # Errors
    /// If there is none on this host, or it belongs to another user.
    pub fn connect(name: &str) -> io::Result<Self> {
        let mut socket = UnixStream::connect_addr(&SocketAddr::from_abstract_name(name)?)?;
        descriptor::check_peer(&socket)?;
        socket.set_read_timeout(Some(PATIENCE))?;
        socket.set_write_timeout(Some(PATIENCE))?;
        let mut id = [0; 8];
        socket.read_exact(&mut id)?;
        Ok(Self { socket, id: u64::from_le_bytes(id), slots: Vec::new() })
    }

    /// Memory for `bytes`; what it holds is of no meaning. `None` while the receiver keeps all slots.
    ///
    /// # Errors
    /// If the system gives no more memory, or the receiver does not take it.
    pub fn lease(&mut self, bytes: usize) -> io::Result<Option<Lease>> {
        let fitting = self.slots.iter().position(|region| region.bytes() >= bytes && region.state().lease());
        let slot = match fitting {
            Some(slot) => slot,
            None if self.slots.len() < SLOTS => self.add(bytes, self.slots.len())?,
            None => match self.slots.iter().position(|region| region.state().lease()) {
                // Too small: another takes its place.
                Some(slot) => self.add(bytes, slot)?,
                None => return Ok(None),
            },
        };
        let (region, handed_over) = (self.slots[slot].clone(), AtomicBool::new(false));
        Ok(Some(Lease { region, bytes, ring: self.id, slot: slot as u32, handed_over }))
    }

    /// Makes slot `slot` anew.
    fn add(&mut self, bytes: usize, slot: usize) -> io::Result<usize> {
        let (region, memory) = Region::create(bytes)?;
        descriptor::send(&self.socket, slot as u32, &memory)?;
        let mut mapped = [0];
        self.socket.read_exact(&mut mapped)?;
        match self.slots.get_mut(slot) {
            Some(place) => *place = Arc::new(region),
            None => self.slots.push(Arc::new(region)),
        }
        Ok(slot)
    }
}

impl Lease {
    /// The ring's id at its receiver.
    pub fn ring(&self) -> u64 {
        self.ring
    }

    /// The slot's number in its ring.
    pub fn slot(&self) -> u32 {
        self.slot
    }

    /// The memory.
    pub fn bytes(&self) -> &[u8] {
        self.region.data(self.bytes)
    }

    /// The memory, to write to; none once it was handed over.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        let bytes = if *self.handed_over.get_mut() { 0 } else { self.bytes };
        // SAFETY: this is the region's only lease, borrowed mutably for as long as the slice.
        unsafe { self.region.data_mut(bytes) }
    }

    /// True if `ring` is where the slot is.
    pub fn is_of(&self, ring: &Ring) -> bool {
        ring.slots.iter().any(|region| Arc::ptr_eq(region, &self.region))
    }

    /// Leaves the memory to the receiver, which is to be told next.
    pub fn hand_over(&self) {
        self.handed_over.store(true, Ordering::Relaxed);
        self.region.state().hand_over();
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        if !*self.handed_over.get_mut() {
            self.region.state().free();
        }
    }
}
