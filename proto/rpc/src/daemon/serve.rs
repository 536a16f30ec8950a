//! Listening, serving until a signal, and stopping cleanly.

use super::{Access, Connections, NodeError};
use std::{future::Future, net::SocketAddr, pin::Pin, time::Duration};
use tokio::net::TcpListener;
use tonic::transport::server::Router;

/// Listens on `address`; port 0 takes a free one.
///
/// # Errors
/// If the address is in use or not this machine's.
pub async fn listen(address: SocketAddr) -> Result<TcpListener, NodeError> {
    TcpListener::bind(address).await.map_err(|reason| NodeError::Listen { address, reason })
}

/// Most streams of a connection at a time; a peer that asks for more waits.
pub const MOST_STREAMS: u32 = 256;

/// How long connections may finish what they are doing after a stop was asked for.
const GRACE: Duration = Duration::from_secs(1);

/// What a node stops on. A boxed future, so that a node's machinery is compiled once, in its own crate.
pub type Shutdown = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Serves `router` on `listener` to whom `access` lets in until `shutdown` completes, then for at most a second more.
///
/// # Errors
/// If the transport fails.
pub async fn serve(router: Router, listener: TcpListener, access: Access, shutdown: Shutdown) -> Result<(), NodeError> {
    let address = listener.local_addr();
    let failed = |reason| NodeError::Listen { address: address.unwrap_or(([0; 4], 0).into()), reason };
    let connections = Connections::accept(listener, access).map_err(failed)?;
    let incoming = tokio_stream::StreamExt::map(connections, Ok::<_, std::io::Error>);
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let server = router.serve_with_incoming_shutdown(incoming, async {
        let _ = stopped.await;
    });
    tokio::pin!(server);
    tokio::select! {
        result = &mut server => return Ok(result?),
        () = shutdown => drop(stop),
    }
    match tokio::time::timeout(GRACE, server).await {
        Ok(result) => Ok(result?),
        // Streams that never end by themselves are cut here.
        Err(_) => Ok(()),
    }
}

/// Completes on SIGTERM or Ctrl-C.
pub async fn stop_signal() {
    let interrupt = tokio::signal::ctrl_c();
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        match signal(SignalKind::terminate()) {
            Ok(mut terminate) => tokio::select! { _ = interrupt => {}, _ = terminate.recv() => {} },
            Err(_) => drop(interrupt.await),
        }
    }
    #[cfg(not(unix))]
    drop(interrupt.await);
}
