//! The client's connection: made, lost and tried again.

use crate::session::Session;
use crate::{Client, ClientError, FullPolicy};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;
use tonic::{Code, Status};

const LONGEST_BACKOFF: Duration = Duration::from_secs(5);
/// How long a call waits for a node that is tried again: one that is there answers within it.
const AT_ONCE: Duration = Duration::from_millis(10);

impl Client {
    /// Returns at once where there is a session, or where none can be had before the next try.
    pub(crate) fn ensure_session(&mut self, started: Instant) -> Result<(), ClientError> {
        if self.session.is_some() {
            return Ok(());
        }
        if let Some(connecting) = &mut self.connecting {
            let opened = match connecting.try_recv() {
                Ok(opened) => opened,
                Err(oneshot::error::TryRecvError::Empty) => return Err(self.unreachable()),
                Err(oneshot::error::TryRecvError::Closed) => Err(Status::unavailable("the try was given up")),
            };
            self.connecting = None;
            return self.opened(opened);
        }
        if Instant::now() < self.retry_at {
            return Err(self.unreachable());
        }
        if self.options.full_policy == FullPolicy::Block {
            return self.open_session(started);
        }
        let mut opened = self.driver.begin(self.options.deadline, self.opening());
        let at_once = self.driver.within(AT_ONCE.min(self.options.deadline), async {
            (&mut opened).await.unwrap_or_else(|_| Err(Status::unavailable("closed")))
        });
        match at_once {
            Err(late) if late.code() == Code::DeadlineExceeded => {
                self.connecting = Some(opened);
                self.unreachable = "it has not answered yet".to_owned();
                Err(self.unreachable())
            }
            opened => self.opened(opened),
        }
    }

    /// Connects and attaches, whoever waits for it.
    fn opening(&self) -> impl Future<Output = Result<(Session, String), Status>> + Send + use<> {
        Session::open(self.options.clone(), self.credentials.clone(), self.run_id.clone())
    }

    /// Waits for the session, within the deadline of a call that began at `started`.
    pub(crate) fn open_session(&mut self, started: Instant) -> Result<(), ClientError> {
        let opened = self.driver.away(self.remaining(started), self.opening());
        self.opened(opened)
    }

    /// Takes what a try came to.
    fn opened(&mut self, opened: Result<(Session, String), Status>) -> Result<(), ClientError> {
        match opened {
            Ok((session, run_id)) => {
                (self.session, self.run_id) = (Some(session), run_id);
                if self.options.steering.is_some() {
                    self.steering.follow(&self.driver, &self.run_id, &self.options, self.credentials.as_ref());
                }
                Ok(())
            }
            Err(status) => Err(self.failed(&status)),
        }
    }

    /// What a failed call means, and whether the connection is to be made anew.
    pub(crate) fn failed(&mut self, status: &Status) -> ClientError {
        match status.code() {
            Code::InvalidArgument
            | Code::AlreadyExists
            | Code::FailedPrecondition
            | Code::NotFound
            | Code::PermissionDenied
            | Code::ResourceExhausted => ClientError::Refused(status.message().to_owned()),
            code => {
                self.session = None;
                self.retry_at = Instant::now() + self.backoff;
                self.backoff = (2 * self.backoff).min(LONGEST_BACKOFF);
                if code == Code::DeadlineExceeded {
                    self.unreachable = "it did not answer in time".to_owned();
                    return ClientError::Deadline(self.longest_push());
                }
                status.message().clone_into(&mut self.unreachable);
                self.unreachable()
            }
        }
    }

    fn unreachable(&self) -> ClientError {
        ClientError::Unreachable { address: self.options.generator.clone(), reason: self.unreachable.clone() }
    }
}
