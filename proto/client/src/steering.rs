//! Steering: requests from people who watch the run, kept until the simulation asks for them.

use crate::RunOptions;
use crate::driver::Driver;
use lamina_model::{Steering, SteeringRequest};
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, ingest_client::IngestClient};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;
use tokio::task::AbortHandle;
use tonic::{Code, Status};

/// Pause before a stream that was lost is opened again.
const RETRY: Duration = Duration::from_secs(1);

/// Requests that the simulation has not asked for yet.
#[derive(Debug)]
pub(crate) struct SteeringInbox {
    sender: Sender<Steering>,
    waiting: Receiver<Steering>,
    /// The run it listens for, and the task that does.
    following: Option<(String, AbortHandle)>,
}

impl SteeringInbox {
    /// Nothing is listened to yet.
    pub(crate) fn new() -> Self {
        let (sender, waiting) = channel();
        Self { sender, waiting, following: None }
    }

    /// What came since this was asked last.
    pub(crate) fn take(&self) -> Vec<Steering> {
        self.waiting.try_iter().collect()
    }

    /// Listens for `run_id` on the driver's thread, in place of what listened for another run.
    pub(crate) fn follow(
        &mut self,
        driver: &Driver,
        run_id: &str,
        options: &RunOptions,
        credentials: Option<&Credentials>,
    ) {
        if self.following.as_ref().is_some_and(|(followed, _)| followed == run_id) {
            return;
        }
        if let Some((_, before)) = self.following.take() {
            before.abort();
        }
        let task = follow(options.clone(), credentials.cloned(), run_id.to_owned(), self.sender.clone());
        self.following = driver.spawn(task).map(|task| (run_id.to_owned(), task));
    }
}

/// Listens until the process ends. A pause ends with the connection through which it came: nobody could end it otherwise.
async fn follow(options: RunOptions, credentials: Option<Credentials>, run_id: String, inbox: Sender<Steering>) {
    let mut paused = false;
    loop {
        let Err(lost) = listen(&options, credentials.as_ref(), &run_id, &inbox, &mut paused).await;
        if std::mem::take(&mut paused) {
            let asked_by = "the client: the generator-node was lost".to_owned();
            let _ = inbox.send(Steering { request: SteeringRequest::Resume, asked_by });
        }
        match lost.code() {
            Code::Unimplemented => return tracing::warn!("this generator-node is older and cannot steer"),
            Code::InvalidArgument => return tracing::warn!("nobody can steer: {}", lost.message()),
            _ => tracing::debug!("steering: {}", lost.message()),
        }
        tokio::time::sleep(RETRY).await;
    }
}

async fn listen(
    options: &RunOptions,
    credentials: Option<&Credentials>,
    run_id: &str,
    inbox: &Sender<Steering>,
    paused: &mut bool,
) -> Result<std::convert::Infallible, Status> {
    let channel = connect(&options.generator, Role::Generator, credentials).await.map_err(Status::unavailable)?;
    let numbers = options.steering.iter().flatten().cloned().map(Into::into).collect();
    let subscription = v1::SteeringSubscription { run_id: run_id.to_owned(), numbers };
    let mut requests = IngestClient::new(channel).steering(subscription).await?.into_inner();
    while let Some(request) = requests.message().await? {
        match Steering::try_from(request) {
            Ok(steering) => {
                match steering.request {
                    SteeringRequest::Pause => *paused = true,
                    SteeringRequest::Resume | SteeringRequest::Stop => *paused = false,
                    SteeringRequest::Set { .. } => {}
                }
                let _ = inbox.send(steering);
            }
            Err(error) => tracing::warn!("a request of a newer node: {error}"),
        }
    }
    Err(Status::unavailable("the stream of requests ended"))
}
