//! The receiver: rings of the processes that connect, and the bytes they hand over.

use crate::region::Region;
use crate::{SLOTS, descriptor};
use parking_lot::Mutex;
use std::collections::HashMap;
use std::io;
use std::ops::Deref;
use std::os::fd::AsRawFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::io::{AsyncWriteExt, Interest};
use tokio::net::UnixStream;

/// Rings at once.
const MOST_RINGS: usize = 4096;

/// Pause after a failed accept, such as for want of descriptors.
const PAUSE: Duration = Duration::from_millis(100);

#[derive(Debug, Default)]
struct KeptRing {
    slots: [Option<Arc<Region>>; SLOTS],
    /// How many of its slots are kept here.
    kept: Arc<AtomicUsize>,
}

/// All rings of a receiver.
#[derive(Debug, Default)]
pub struct Rings {
    rings: Mutex<HashMap<u64, KeptRing>>,
    next: AtomicU64,
}

/// Bytes that a sender handed over; it gets their memory back when this is dropped.
#[derive(Debug)]
pub struct SharedBytes {
    region: Arc<Region>,
    len: usize,
    kept: Arc<AtomicUsize>,
}

impl SharedBytes {
    /// How many slots of this ring are kept, this one among them.
    pub fn kept_slots(&self) -> usize {
        self.kept.load(Ordering::Relaxed)
    }
}

impl Deref for SharedBytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        self.region.data(self.len)
    }
}

impl Drop for SharedBytes {
    fn drop(&mut self) {
        self.kept.fetch_sub(1, Ordering::Relaxed);
        self.region.state().free();
    }
}

impl Rings {
    /// The first `len` bytes of slot `slot` of ring `ring`; `None` if that one is not there, is shorter, or was not handed over since it was taken.
    pub fn take(&self, ring: u64, slot: u32, len: usize) -> Option<SharedBytes> {
        let rings = self.rings.lock();
        let ring = rings.get(&ring)?;
        let region = ring.slots.get(slot as usize)?.as_ref()?;
        if region.bytes() < len || !region.state().keep() {
            return None;
        }
        ring.kept.fetch_add(1, Ordering::Relaxed);
        Some(SharedBytes { region: region.clone(), len, kept: ring.kept.clone() })
    }

    fn add(&self) -> Option<u64> {
        let mut rings = self.rings.lock();
        if rings.len() >= MOST_RINGS {
            return None;
        }
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        rings.insert(id, KeptRing::default());
        Some(id)
    }

    fn set(&self, ring: u64, slot: u32, region: Region) -> io::Result<()> {
        let mut rings = self.rings.lock();
        let place = rings.get_mut(&ring).and_then(|ring| ring.slots.get_mut(slot as usize));
        *place.ok_or(io::ErrorKind::InvalidInput)? = Some(Arc::new(region));
        Ok(())
    }
}

/// A listening abstract socket.
#[derive(Debug)]
pub struct Receiver {
    name: String,
    listener: UnixListener,
    most_bytes: u64,
}

impl Receiver {
    /// Listens under a new name; takes slots of at most `most_bytes`.
    ///
    /// # Errors
    /// If the system gives no socket.
    pub fn bind(most_bytes: u64) -> io::Result<Self> {
        let nanos = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos());
        let name = format!("lamina-{}-{nanos}", std::process::id());
        let listener = UnixListener::bind_addr(&SocketAddr::from_abstract_name(&name)?)?;
        listener.set_nonblocking(true)?;
        Ok(Self { name, listener, most_bytes })
    }

    /// Where senders connect.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Takes slots into `rings` for ever.
    ///
    /// # Errors
    /// If the socket cannot be listened to.
    pub async fn serve(self, rings: Arc<Rings>) -> io::Result<()> {
        let listener = tokio::net::UnixListener::from_std(self.listener)?;
        loop {
            match listener.accept().await {
                Ok((socket, _)) => {
                    let (rings, most_bytes) = (rings.clone(), self.most_bytes);
                    tokio::spawn(async move {
                        let Some(ring) = rings.add() else { return };
                        if let Err(error) = follow(socket, &rings, ring, most_bytes).await {
                            tracing::warn!(%error, "shared memory of a simulation");
                        }
                        // What is kept stays mapped.
                        rings.rings.lock().remove(&ring);
                    });
                }
                Err(error) => {
                    tracing::warn!(%error, "shared memory: no connection");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }
}

/// Takes the slots of one sender until it leaves.
async fn follow(mut socket: UnixStream, rings: &Rings, ring: u64, most_bytes: u64) -> io::Result<()> {
    descriptor::check_peer(&socket)?;
    socket.write_all(&ring.to_le_bytes()).await?;
    loop {
        let fd = socket.as_raw_fd();
        let next = socket.async_io(Interest::READABLE, || descriptor::receive(fd)).await;
        let Some((slot, memory)) = next? else { return Ok(()) };
        // Mapping all pages takes its time.
        let opened = tokio::task::spawn_blocking(move || Region::open(memory, most_bytes)).await;
        rings.set(ring, slot, opened.map_err(io::Error::other)??)?;
        socket.write_all(&[1]).await?;
    }
}
