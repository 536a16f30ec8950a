//! A mesh: every process can send to every other, and receives from all in one queue.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Why there is no mesh, or no message.
#[derive(Debug, thiserror::Error)]
pub enum MpiError {
    /// No library can be opened.
    #[error(
        "no MPI library: {0}; install MPI 5 (libmpi_abi.so.1), MPICH or Open MPI, or name its library in LAMINA_MPI_LIBRARY"
    )]
    Missing(String),
    /// The library was opened, and failed.
    #[error("{call} of {library}: error {code}")]
    Failed {
        /// The library's file.
        library: String,
        /// The function.
        call: &'static str,
        /// What it returned.
        code: i32,
    },
    /// The launcher and the library do not belong together.
    #[error(
        "{library} sees {seen} of the {launched} processes that the launcher started; name the launcher's own library in LAMINA_MPI_LIBRARY"
    )]
    OtherLauncher {
        /// The library's file.
        library: String,
        /// Size of its world.
        seen: u32,
        /// What the launcher's environment says.
        launched: u32,
    },
    /// No message came in time.
    #[error("no message within {0:?}")]
    Timeout(Duration),
    /// The mesh is gone.
    #[error("the MPI world has ended")]
    Ended,
}

/// Sends to the processes of a mesh. Clones send in turn.
#[derive(Debug, Clone)]
pub struct Outbox {
    rank: u32,
    outgoing: Vec<Sender<Message>>,
    /// The others are threads of this process.
    threads: bool,
}

/// Receives from all processes of a mesh.
#[derive(Debug)]
pub struct Inbox {
    messages: Receiver<Message>,
    /// Owns the MPI library.
    engine: Option<JoinHandle<()>>,
}

/// Sender or receiver, and bytes.
pub(crate) type Message = (u32, Vec<u8>);

/// Joins the MPI world that a launcher (`mpirun`, `srun`) started this process in; one process where there is none. `launched` is the
/// number of processes by the launcher's environment, if it says.
///
/// # Errors
/// If there is no MPI library, or it is not the launcher's.
#[cfg(unix)]
pub fn join(launched: Option<u32>) -> Result<(Outbox, Inbox), MpiError> {
    let (sender, sent) = channel();
    let (received, messages) = channel();
    let ((rank, size), engine) = crate::engine::start(sent, received.clone(), launched)?;
    // What is for this process itself does not pass through MPI.
    let outgoing = (0..size).map(|to| if to == rank { received.clone() } else { sender.clone() }).collect();
    Ok((Outbox { rank, outgoing, threads: false }, Inbox { messages, engine: Some(engine) }))
}

/// Joins nothing: MPI is opened on Unix only.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub fn join(_: Option<u32>) -> Result<(Outbox, Inbox), MpiError> {
    Err(MpiError::Missing("this system has none that can be opened".to_owned()))
}

/// A mesh of `size` threads of this process, for tests.
pub fn in_process(size: u32) -> Vec<(Outbox, Inbox)> {
    let ends: Vec<(Sender<Message>, Receiver<Message>)> = (0..size).map(|_| channel()).collect();
    let outgoing: Vec<Sender<Message>> = ends.iter().map(|(sender, _)| sender.clone()).collect();
    let end = |(rank, (_, messages)): (u32, _)| {
        (Outbox { rank, outgoing: outgoing.clone(), threads: true }, Inbox { messages, engine: None })
    };
    (0..size).zip(ends).map(end).collect()
}

impl Outbox {
    /// This process, from 0.
    pub fn rank(&self) -> u32 {
        self.rank
    }

    /// Processes.
    pub fn size(&self) -> u32 {
        self.outgoing.len() as u32
    }

    /// Sends `bytes` to process `to`, without waiting. Messages between two processes arrive in their order.
    ///
    /// # Errors
    /// If there is no such process, or the world has ended.
    pub fn send(&self, to: u32, bytes: Vec<u8>) -> Result<(), MpiError> {
        // Among threads the receiver is told who sent; over MPI the engine is told whom to send to.
        let named = if self.threads || to == self.rank { self.rank } else { to };
        let outgoing = self.outgoing.get(to as usize).ok_or(MpiError::Ended)?;
        outgoing.send((named, bytes)).map_err(|_| MpiError::Ended)
    }
}

impl Inbox {
    /// The next message and who sent it.
    ///
    /// # Errors
    /// If none comes within `patience`, or the world has ended.
    pub fn receive(&self, patience: Duration) -> Result<(u32, Vec<u8>), MpiError> {
        self.messages.recv_timeout(patience).map_err(|error| match error {
            RecvTimeoutError::Timeout => MpiError::Timeout(patience),
            RecvTimeoutError::Disconnected => MpiError::Ended,
        })
    }

    /// Leaves the world once all outboxes of this process are dropped and their messages sent. All processes are to leave: this
    /// waits for them.
    pub fn leave(self) {
        if let Some(engine) = self.engine {
            let _ = engine.join();
        }
    }
}
