//! The thread that owns the MPI library: sends and receives whole messages, and sleeps while there are none.
//!
//! A message is its length (u64, little-endian), then its bytes in pieces of at most [`PIECE`]. A receive of the next length is
//! posted for every other process at all times, so that no message ever waits for this process to ask.
#![allow(unsafe_code, reason = "buffers are the library's while an operation runs")]

use crate::MpiError;
use crate::library::{Mpi, Request};
use crate::mesh::Message;
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Bytes of one operation.
const PIECE: usize = 1 << 28;

/// The largest message: more means that the two ends no longer agree on what comes next.
const LARGEST: u64 = 1 << 40;

/// Pauses while nothing happens: they grow from the first to the last.
const PAUSES: [Duration; 2] = [Duration::from_micros(20), Duration::from_millis(1)];

/// Opens the library on a thread of its own; gives rank and size of the world, and the thread.
pub(crate) fn start(
    outgoing: Receiver<Message>,
    inbox: Sender<Message>,
    launched: Option<u32>,
) -> Result<((u32, u32), JoinHandle<()>), MpiError> {
    let (opened, outcome) = channel();
    let run = move || {
        let mpi = match Mpi::open() {
            Ok(mpi) => mpi,
            Err(error) => return drop(opened.send(Err(error))),
        };
        let (_, seen) = mpi.world;
        if let Some(launched) = launched.filter(|&n| n != seen) {
            let library = mpi.name().to_owned();
            return drop(opened.send(Err(MpiError::OtherLauncher { library, seen, launched })));
        }
        tracing::info!(library = mpi.name(), rank = mpi.world.0, size = seen, "MPI");
        if opened.send(Ok(mpi.world)).is_err() {
            return;
        }
        if let Err(error) = (Engine { mpi: &mpi, inbox, sends: VecDeque::new() }).run(&outgoing) {
            tracing::error!(%error, "MPI ends");
        }
    };
    let thread = std::thread::Builder::new().name("mpi".to_owned()).spawn(run);
    let thread = thread.map_err(|e| MpiError::Missing(e.to_string()))?;
    Ok((outcome.recv().unwrap_or(Err(MpiError::Ended))?, thread))
}

/// Bytes under way to another process.
struct Send {
    request: Request,
    /// Read by the library until the request is done.
    _bytes: Vec<u8>,
}

/// What is expected of a process next.
struct Source {
    rank: u32,
    request: Request,
    /// Written by the library until the request is done.
    length: Box<[u8; 8]>,
    message: Vec<u8>,
    /// Bytes of `message` that have come; `None` while the length is awaited.
    have: Option<usize>,
}

struct Engine<'a> {
    mpi: &'a Mpi,
    inbox: Sender<Message>,
    sends: VecDeque<Send>,
}

impl Engine<'_> {
    /// Until all senders are gone and all is sent, or the library fails.
    fn run(&mut self, outgoing: &Receiver<Message>) -> Result<(), MpiError> {
        let (me, size) = self.mpi.world;
        let mut sources = Vec::new();
        for rank in (0..size).filter(|&rank| rank != me) {
            let mut length = Box::new([0; 8]);
            // SAFETY: the box is kept in `Source` and looked at once the request is done.
            let request = unsafe { self.mpi.receive(rank, &mut length[..]) }?;
            sources.push(Source { rank, request, length, message: Vec::new(), have: None });
        }
        let mut pause = PAUSES[0];
        loop {
            let mut moved = false;
            for source in &mut sources {
                while self.mpi.is_done(&mut source.request)? {
                    moved = true;
                    self.advance(source)?;
                }
            }
            self.settle_sends()?;
            pause = if moved { PAUSES[0] } else { (2 * pause).min(PAUSES[1]) };
            match outgoing.recv_timeout(pause) {
                Ok((to, bytes)) => {
                    self.send(to, bytes)?;
                    pause = PAUSES[0];
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        while !self.sends.is_empty() {
            self.settle_sends()?;
            std::thread::sleep(PAUSES[0]);
        }
        for source in &mut sources {
            self.mpi.cancel(&mut source.request);
            while !self.mpi.is_done(&mut source.request)? {
                std::thread::sleep(PAUSES[0]);
            }
        }
        self.mpi.finalize();
        Ok(())
    }

    fn settle_sends(&mut self) -> Result<(), MpiError> {
        let mut n = 0;
        while n < self.sends.len() {
            if self.mpi.is_done(&mut self.sends[n].request)? {
                self.sends.remove(n);
            } else {
                n += 1;
            }
        }
        Ok(())
    }

    fn send(&mut self, to: u32, bytes: Vec<u8>) -> Result<(), MpiError> {
        let length = (bytes.len() as u64).to_le_bytes().to_vec();
        // SAFETY: a vector's bytes stay where they are when it moves, and it is kept until the request is done.
        let request = unsafe { self.mpi.send(to, &length) }?;
        self.sends.push_back(Send { request, _bytes: length });
        let mut rest = bytes;
        while rest.len() > PIECE {
            let tail = rest.split_off(PIECE);
            // SAFETY: as above.
            let request = unsafe { self.mpi.send(to, &rest) }?;
            self.sends.push_back(Send { request, _bytes: std::mem::replace(&mut rest, tail) });
        }
        if !rest.is_empty() {
            // SAFETY: as above.
            let request = unsafe { self.mpi.send(to, &rest) }?;
            self.sends.push_back(Send { request, _bytes: rest });
        }
        Ok(())
    }

    /// Takes what has come from a process, and asks for what comes next.
    fn advance(&self, source: &mut Source) -> Result<(), MpiError> {
        match source.have {
            None => {
                let length = u64::from_le_bytes(*source.length);
                if length > LARGEST {
                    return Err(MpiError::Ended);
                }
                source.message = vec![0; length as usize];
                source.have = Some(0);
            }
            Some(have) => source.have = Some(source.message.len().min(have + PIECE)),
        }
        let have = source.have.unwrap_or(0);
        if have < source.message.len() {
            let piece = have..source.message.len().min(have + PIECE);
            // SAFETY: the vector is not touched until the request is done.
            source.request = unsafe { self.mpi.receive(source.rank, &mut source.message[piece]) }?;
            return Ok(());
        }
        let _ = self.inbox.send((source.rank, std::mem::take(&mut source.message)));
        source.have = None;
        // SAFETY: the box is kept in `Source` and looked at once the request is done.
        source.request = unsafe { self.mpi.receive(source.rank, &mut source.length[..]) }?;
        Ok(())
    }
}
