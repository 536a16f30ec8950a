//! Stands in where there is no memfd: no ring can be made.

use std::io;
use std::ops::Deref;
use std::sync::Arc;

fn unsupported() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "shared memory needs Linux")
}

/// A ring that cannot exist.
#[derive(Debug)]
pub enum Ring {}

/// A lease that cannot exist.
#[derive(Debug)]
pub enum Lease {}

/// Bytes that cannot exist.
#[derive(Debug)]
pub enum SharedBytes {}

/// A receiver that cannot exist.
#[derive(Debug)]
pub enum Receiver {}

/// No ring.
#[derive(Debug, Default)]
pub struct Rings;

impl Ring {
    /// Nothing to connect to.
    ///
    /// # Errors
    /// Always.
    pub fn connect(_: &str) -> io::Result<Self> {
        Err(unsupported())
    }

    /// No memory.
    ///
    /// # Errors
    /// Never.
    pub fn lease(&mut self, _: usize) -> io::Result<Option<Lease>> {
        match *self {}
    }
}

impl Lease {
    /// None.
    pub fn ring(&self) -> u64 {
        match *self {}
    }

    /// None.
    pub fn slot(&self) -> u32 {
        match *self {}
    }

    /// None.
    pub fn bytes(&self) -> &[u8] {
        match *self {}
    }

    /// None.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        match *self {}
    }

    /// None.
    pub fn is_of(&self, _: &Ring) -> bool {
        match *self {}
    }

    /// None.
    pub fn hand_over(&self) {
        match *self {}
    }
}

impl SharedBytes {
    /// None.
    pub fn kept_slots(&self) -> usize {
        match *self {}
    }
}

impl Deref for SharedBytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match *self {}
    }
}

impl Rings {
    /// None.
    pub fn take(&self, _: u64, _: u32, _: usize) -> Option<SharedBytes> {
        None
    }
}

impl Receiver {
    /// No socket.
    ///
    /// # Errors
    /// Always.
    pub fn bind(_: u64) -> io::Result<Self> {
        Err(unsupported())
    }

    /// None.
    pub fn name(&self) -> &str {
        match *self {}
    }

    /// Never.
    ///
    /// # Errors
    /// Never.
    pub async fn serve(self, _: Arc<Rings>) -> io::Result<()> {
        match self {}
    }
}
