//! Connections as a node accepts them: how many, from whom, secured or not.

use super::access::{Access, Identity, Peer, user_of};
use super::address_share::{AddressShare, AddressShares};
use super::refusals::Refusals;
use super::server_tls::stated_role;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::Sleep;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

/// The most connections of a node at a time; others wait in the system's queue.
const MOST: usize = 4096;
/// How long a peer may take for the handshake of TLS, and after it to say which HTTP it speaks.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// Bytes that tell: the preface of HTTP/2 and its least frame; no request of HTTP/1 that names a host is shorter.
const BEGINNING: usize = 24;

/// Connections that are ready, one after the other.
#[derive(Debug)]
pub(super) struct Connections {
    ready: mpsc::Receiver<Connection>,
}

/// A connection.
#[derive(Debug)]
pub(super) struct Connection {
    stream: Stream,
    peer: Peer,
    /// When reading fails, and how many bytes have to come before; `None` once they have.
    beginning: Option<(Pin<Box<Sleep>>, usize)>,
    share: Arc<AddressShare>,
    _permits: [OwnedSemaphorePermit; 2],
}

#[derive(Debug)]
enum Stream {
    Plain(TcpStream),
    Secure(Box<TlsStream<TcpStream>>),
}

impl Connections {
    /// Those that come to `listener`, of whom `access` lets in; of an address that has as many as one may have, no more.
    pub(super) fn accept(listener: TcpListener, access: Access, refusals: Arc<Refusals>) -> Self {
        let (sender, ready) = mpsc::channel(64);
        tokio::spawn(async move {
            let (permits, shares) = (Arc::new(Semaphore::new(MOST)), AddressShares::default());
            while let Ok(permit) = permits.clone().acquire_owned().await {
                let accepted = tokio::select! {
                    accepted = listener.accept() => accepted,
                    () = sender.closed() => return,
                };
                let Ok((stream, peer)) = accepted else {
                    // Out of descriptors, as a rule: some will be closed.
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    continue;
                };
                let share = shares.of(peer.ip());
                let Some(of_address) = share.connection(peer.ip()) else {
                    refusals.crowded.fetch_add(1, Ordering::Relaxed);
                    continue;
                };
                let permits = [permit, of_address];
                let (access, sender) = (access.clone(), sender.clone());
                tokio::spawn(async move {
                    let _ = stream.set_nodelay(true);
                    match enter(stream, peer, &access).await {
                        Ok((stream, peer)) => {
                            let beginning = Some((Box::pin(tokio::time::sleep(HANDSHAKE)), BEGINNING));
                            let connection = Connection { stream, peer, beginning, share, _permits: permits };
                            let _ = sender.send(connection).await;
                        }
                        Err(reason) => tracing::info!(%peer, %reason, "connection refused"),
                    }
                });
            }
        });
        Self { ready }
    }

    /// The next one; waits for ever once the listener has failed.
    pub(super) async fn next(&mut self) -> Connection {
        match self.ready.recv().await {
            Some(connection) => connection,
            None => std::future::pending().await,
        }
    }
}

/// Threads that look up whose connections are.
static LOOKUPS: Semaphore = Semaphore::const_new(4);

/// Finds out who is there.
async fn enter(stream: TcpStream, address: SocketAddr, access: &Access) -> io::Result<(Stream, Peer)> {
    let peer = |identity| Peer { address, identity };
    match access {
        Access::Anybody => Ok((Stream::Plain(stream), peer(Identity::Trusted))),
        Access::SameUser => {
            let local = stream.local_addr()?;
            // However many come at once: each reads the table on a thread.
            let _turn = LOOKUPS.acquire().await.map_err(io::Error::other)?;
            let identity = tokio::task::spawn_blocking(move || local_identity(address, local)).await?;
            Ok((Stream::Plain(stream), peer(identity)))
        }
        Access::Certificates(tls) => {
            let handshake = TlsAcceptor::from(tls.config()).accept(stream);
            let stream = tokio::time::timeout(HANDSHAKE, handshake).await??;
            let role = stated_role(stream.get_ref().1.peer_certificates());
            let identity = role.map_or(Identity::Unknown, Identity::Certified);
            Ok((Stream::Secure(Box::new(stream)), peer(identity)))
        }
    }
}

/// Whether the process at `peer` is of this process's user, or of root. Where the system does not tell, whoever is on this host is
/// let in.
#[cfg(target_os = "linux")]
fn local_identity(peer: SocketAddr, local: SocketAddr) -> Identity {
    use std::os::unix::fs::MetadataExt as _;
    let own = std::fs::metadata("/proc/self").map(|process| process.uid()).ok();
    match user_of(peer, local) {
        Some(user) if user == 0 || Some(user) == own => Identity::Trusted,
        Some(user) => Identity::OtherUser(user),
        None => Identity::Unknown,
    }
}

#[cfg(not(target_os = "linux"))]
fn local_identity(_: SocketAddr, _: SocketAddr) -> Identity {
    Identity::Trusted
}

impl Connection {
    /// The other end.
    pub(super) fn peer(&self) -> Peer {
        self.peer
    }

    /// What its address may take.
    pub(super) fn share(&self) -> Arc<AddressShare> {
        self.share.clone()
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = match &mut self.stream {
            Stream::Plain(stream) => Pin::new(stream).poll_read(cx, buffer),
            Stream::Secure(stream) => Pin::new(stream).poll_read(cx, buffer),
        };
        let Some((deadline, missing)) = &mut self.beginning else { return read };
        *missing = missing.saturating_sub(buffer.filled().len() - before);
        if *missing == 0 {
            self.beginning = None;
        } else if read.is_pending() && deadline.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "no request came")));
        }
        read
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        match &mut self.stream {
            Stream::Plain(stream) => Pin::new(stream).poll_write(cx, bytes),
            Stream::Secure(stream) => Pin::new(stream).poll_write(cx, bytes),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.stream {
            Stream::Plain(stream) => Pin::new(stream).poll_flush(cx),
            Stream::Secure(stream) => Pin::new(stream).poll_flush(cx),
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match &mut self.stream {
            Stream::Plain(stream) => Pin::new(stream).poll_shutdown(cx),
            Stream::Secure(stream) => Pin::new(stream).poll_shutdown(cx),
        }
    }
}
