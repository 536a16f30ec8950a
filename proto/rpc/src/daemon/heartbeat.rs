//! Streams of one answer whose asker hears every second that it is still being worked on.

use std::{future::Future, time::Duration};
use tokio::sync::mpsc;
use tonic::Status;

/// How often a question that is not answered yet hears so.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// The output of `work`; until then `at_work` is sent every second, where there is room for it. `None` if the receiver hung up, which
/// drops `work`.
pub async fn with_heartbeat<T, M: Clone>(
    work: impl Future<Output = T>,
    at_work: M,
    answers: &mpsc::Sender<Result<M, Status>>,
) -> Option<T> {
    tokio::pin!(work);
    let mut heartbeat = tokio::time::interval_at(tokio::time::Instant::now() + HEARTBEAT, HEARTBEAT);
    loop {
        tokio::select! {
            done = &mut work => return Some(done),
            () = answers.closed() => return None,
            _ = heartbeat.tick() => drop(answers.try_send(Ok(at_work.clone()))),
        }
    }
}
