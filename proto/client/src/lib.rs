//! What a simulation links to hand its time steps to a generator-node.
//!
//! ```no_run
//! use lamina_client::{Brick, Client, RunOptions};
//! # let (grid, density, steps) = (lamina_model::Grid::new([8; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap(), vec![0.0_f32; 512], 0..3);
//! let options = RunOptions::new("http://127.0.0.1:7101", "blast", "density", grid, lamina_model::VoxelType::F32);
//! let mut client = Client::connect(options)?;
//! for step in steps {
//!     if let Err(lost) = client.push(step, step as f64 * 0.1, &Brick::new([0; 3], [8; 3], &density)) {
//!         eprintln!("step {step} not shown: {lost}");
//!     }
//! }
//! client.close();
//! # Ok::<(), lamina_client::ClientError>(())
//! ```
//!
//! Every call has a deadline. A generator-node that is dead is noticed at once, one that is stuck when a push takes far longer than
//! those before, at the deadline at the latest. It is then tried again in the background, at intervals that grow to 5 s, and steps are
//! counted as lost without waiting. A run whose policy is to block waits for the deadline each time. Connect after forking: the
//! thread that drives a connection is in the process that made it.

mod brick;
mod buffer;
mod driver;
mod error;
mod options;
mod pace;
mod patience;
mod reconnect;
mod session;
mod steering;

pub use brick::{Brick, VoxelSlice, check_type, dense, span};
pub use buffer::{Buffer, VoxelScalar};
pub use error::ClientError;
pub use lamina_model::{FullPolicy, SteerableNumber, Steering, SteeringRequest};
pub use lamina_rpc::launcher::launched_rank;
pub use options::{Receipt, RunOptions};

use driver::Driver;
use lamina_model::{Diagnostics, Invalid};
use lamina_rpc::connect::{NodeAddress, endpoint};
use lamina_rpc::credentials::{Credentials, CredentialsError, Role};
use lamina_shared_memory::Lease;
use pace::Pace;
use patience::Patience;
use session::{Session, StepPart};
use std::time::{Duration, Instant};
use steering::SteeringInbox;
use tokio::sync::oneshot;
use tonic::{Code, Status};

/// Numbers of a finished run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Summary {
    /// Bricks handed over.
    pub pushed: u64,
    /// Bricks that the node did not take, because it had dropped their steps by policy or goes without them.
    pub dropped: u64,
    /// Bricks that could not be handed over.
    pub lost: u64,
    /// Steps of the whole run that were dropped so far, also after all their bricks were in, or left incomplete; known if the node
    /// answered the close.
    pub run_dropped_steps: Option<u64>,
}

/// A simulation's connection to its generator-node.
#[derive(Debug)]
pub struct Client {
    options: RunOptions,
    credentials: Option<Credentials>,
    driver: Driver,
    session: Option<Session>,
    /// A try in the background.
    connecting: Option<oneshot::Receiver<Result<(Session, String), Status>>>,
    run_id: String,
    summary: Summary,
    retry_at: Instant,
    backoff: Duration,
    /// Why it could not be reached when that was last tried.
    unreachable: String,
    pace: Pace,
    patience: Patience,
    steering: SteeringInbox,
    /// Of the step that is pushed next.
    diagnostics: Diagnostics,
}

const FIRST_BACKOFF: Duration = Duration::from_millis(200);

impl Client {
    /// Opens the run. A node that is not there yet is no error: it is tried again with the next pushes.
    ///
    /// # Errors
    /// If the options cannot be right, or the node refuses them.
    pub fn connect(options: RunOptions) -> Result<Self, ClientError> {
        if let Some(coordinates) = &options.coordinates
            && coordinates.grid()? != options.grid
        {
            return Err(Invalid::new("grid", "is not that of the coordinates: Coordinates::grid").into());
        }
        let address = NodeAddress::read("generator", &options.generator)?;
        let unusable = |e: CredentialsError| Invalid::new("credentials", e.to_string());
        let folder = options.credentials.clone().or_else(Credentials::folder_of_environment);
        // Without TLS nobody asks for them.
        let folder = folder.filter(|_| address.secure);
        let credentials = folder.map(Credentials::open).transpose().map_err(unusable)?;
        // What is wrong with them is found now, not at the first step.
        endpoint(&options.generator, Role::Generator, credentials.as_ref())?;
        let driver = Driver::start().map_err(ClientError::Runtime)?;
        let mut client = Self {
            options,
            credentials,
            driver,
            session: None,
            connecting: None,
            run_id: String::new(),
            summary: Summary::default(),
            retry_at: Instant::now(),
            backoff: FIRST_BACKOFF,
            unreachable: String::new(),
            pace: Pace::default(),
            patience: Patience::default(),
            steering: SteeringInbox::new(),
            diagnostics: Diagnostics::default(),
        };
        match client.open_session(Instant::now()) {
            Err(error @ (ClientError::Unreachable { .. } | ClientError::Deadline(_))) => tracing::warn!("{error}"),
            other => other?,
        }
        Ok(client)
    }

    /// Hands in this rank's brick of `step` at simulation time `time`. Steps ascend.
    ///
    /// # Errors
    /// If the brick does not fit the run, or the node refuses it or is not reachable. The step then counts as lost; the
    /// simulation may go on.
    pub fn push(&mut self, step: u64, time: f64, brick: &Brick) -> Result<Receipt, ClientError> {
        self.push_all(step, time, std::slice::from_ref(brick), None)
    }

    /// Whether to compute and push `step`: to be asked where its values cost something to have, once a step; what the simulation does
    /// between this and the push counts as a cost of watching. False if the node goes without the step, because a contract limits that
    /// cost (`overhead <= 5%`): it is counted as one brick dropped, and is not to be pushed. Ranks need not get the same answer: where
    /// all have a part in computing the values, let them wait for each other first, then ask, then agree. At once, or, where the run's
    /// policy is to block, within the deadline.
    ///
    /// # Errors
    /// If the node cannot be reached now, or refuses the run. The step then counts as lost and is not to be pushed; the simulation may go
    /// on.
    pub fn wants(&mut self, step: u64) -> Result<bool, ClientError> {
        if self.pace.passes_over(step) {
            self.diagnostics = Diagnostics::default();
            self.summary.dropped += 1;
            return Ok(false);
        }
        let now = Instant::now();
        self.ensure_session(now).inspect_err(|_| self.summary.lost += 1)?;
        self.pace.expect(step, now);
        Ok(true)
    }

    /// Tells a number of the step that is pushed next, such as a residual or an energy: it is shown and recorded beside the field, and
    /// triggers and alerts can depend on it. Any rank may tell any; of ranks that tell the same one, either counts.
    ///
    /// # Errors
    /// If the name is not 1 to 60 letters, digits and `_`, a letter first, or the step has 64 already.
    pub fn diagnostic(&mut self, name: &str, value: f64) -> Result<(), ClientError> {
        Ok(self.diagnostics.set(name, value)?)
    }

    /// Memory for this rank's brick of `dims` sample points from `start` on, to compute into: on the node's own host it is read
    /// where it is. Each buffer is for one [`Self::push_buffer`].
    ///
    /// # Errors
    /// If no such brick can be of the run.
    pub fn buffer(&mut self, start: [usize; 3], dims: [usize; 3]) -> Result<Buffer, ClientError> {
        let bytes = Buffer::size(dims, &self.options)?;
        let lease = self.session.as_mut().and_then(|session| session.lease(bytes));
        Ok(Buffer::new(start, dims, &self.options, lease)?)
    }

    /// The same as [`Self::push`] of what was computed into `buffer`.
    ///
    /// # Errors
    /// The same.
    pub fn push_buffer(&mut self, step: u64, time: f64, buffer: Buffer) -> Result<Receipt, ClientError> {
        let (fields, colored) = (buffer.fields(), usize::from(self.options.color_field.is_some()));
        let brick = Brick::new(buffer.start(), buffer.dims(), fields[0]).with_more_fields(&fields[1 + colored..]);
        let brick = if colored > 0 { brick.with_colors(fields[1]) } else { brick };
        self.push_all(step, time, &[brick], buffer.lease())
    }

    /// The same of several bricks of this rank, or of none: all are one step's, and the others' bricks are waited for as always.
    ///
    /// # Errors
    /// The same, for all of them: no step is shown in part.
    pub fn push_bricks(&mut self, step: u64, time: f64, bricks: &[Brick]) -> Result<Receipt, ClientError> {
        self.push_all(step, time, bricks, None)
    }

    fn push_all(
        &mut self,
        step: u64,
        time: f64,
        bricks: &[Brick],
        lease: Option<&Lease>,
    ) -> Result<Receipt, ClientError> {
        // What was told of a step that nobody takes is not another one's.
        let diagnostics = std::mem::take(&mut self.diagnostics);
        let count = bricks.len().max(1) as u64;
        let checked = bricks.iter().try_for_each(|brick| brick.check(&self.options));
        checked.inspect_err(|_| self.summary.lost += count)?;
        if self.pace.passes_over(step) {
            self.summary.dropped += count;
            return Ok(Receipt::Dropped);
        }
        let (started, none) = (Instant::now(), Brick::new([0; 3], [0; 3], &[0_u8; 0][..]));
        let mut parts = if bricks.is_empty() { std::slice::from_ref(&none) } else { bricks }.iter().enumerate();
        let receipt = loop {
            let Some((index, brick)) = parts.next() else { break Ok(Receipt::Admitted(false)) };
            let (index, bricks) = (index as u32, bricks.len() as u32);
            let part = StepPart { step, time, index, bricks, diagnostics: &diagnostics };
            match self.push_within_deadline(started, part, brick, lease) {
                Ok(Receipt::Admitted(complete)) => {
                    self.summary.pushed += 1;
                    if parts.len() == 0 {
                        break Ok(Receipt::Admitted(complete));
                    }
                }
                other => break other,
            }
        };
        self.pace.pushed(Instant::now());
        let left = parts.len() as u64 + 1;
        match &receipt {
            Ok(Receipt::Admitted(_)) => {}
            Ok(Receipt::Dropped) => self.summary.dropped += left,
            Err(_) => self.summary.lost += left,
        }
        receipt
    }

    fn push_within_deadline(
        &mut self,
        started: Instant,
        part: StepPart<'_>,
        brick: &Brick,
        lease: Option<&Lease>,
    ) -> Result<Receipt, ClientError> {
        self.ensure_session(started)?;
        match self.try_push(started, part, brick, lease) {
            // The node was restarted: it no longer knows the run. Open it again under its old id, once.
            Err(status) if status.code() == Code::NotFound => {
                self.session = None;
                self.open_session(started)?;
                self.try_push(started, part, brick, lease).map_err(|status| self.failed(&status))
            }
            other => other.map_err(|status| self.failed(&status)),
        }
    }

    /// How long a push may take: the deadline, or less where those before took far less.
    fn longest_push(&self) -> Duration {
        let deadline = self.options.deadline;
        let usual = self.patience.limit().filter(|_| self.options.full_policy != FullPolicy::Block);
        usual.map_or(deadline, |limit| limit.min(deadline))
    }

    /// What is left of the deadline of a call that began at `started`.
    fn remaining(&self, started: Instant) -> Duration {
        self.options.deadline.saturating_sub(started.elapsed())
    }

    fn try_push(
        &mut self,
        started: Instant,
        part: StepPart<'_>,
        brick: &Brick,
        lease: Option<&Lease>,
    ) -> Result<Receipt, Status> {
        let (timing, remaining) = (self.pace.begin(started), self.remaining(started));
        let (begun, remaining) = (Instant::now(), remaining.min(self.longest_push()));
        let Some(session) = &mut self.session else { return Err(Status::unavailable("not connected")) };
        let push = session.push(&self.run_id, self.options.rank, part, timing, brick, lease);
        let (receipt, cadence) = self.driver.within(remaining, push)?;
        self.pace.set_cadence(cadence);
        self.patience.answered(begun.elapsed());
        self.backoff = FIRST_BACKOFF;
        Ok(receipt)
    }

    /// Ends this rank's part of the run; the numbers of what became of its bricks.
    pub fn close(mut self) -> Summary {
        if let Some(session) = self.session.take() {
            let close = session.close(&self.run_id, self.options.rank);
            match self.driver.within(self.options.deadline, close) {
                Ok(dropped_steps) => self.summary.run_dropped_steps = Some(dropped_steps),
                _ => tracing::warn!("the generator-node did not hear of the run's end"),
            }
        }
        self.summary
    }

    /// What people who watch have asked for since this was called last, oldest first; at once, and empty where
    /// [`RunOptions::steering`] is `None`. Call it between steps; what of it is done is the simulation's choice. A pause whose
    /// node is lost is ended by a [`SteeringRequest::Resume`].
    pub fn steering(&mut self) -> Vec<Steering> {
        self.steering.take()
    }

    /// What became of the bricks so far.
    pub fn summary(&self) -> Summary {
        self.summary
    }

    /// What it was opened with.
    pub fn options(&self) -> &RunOptions {
        &self.options
    }

    /// True if bricks go to the node through memory that both map.
    pub fn shares_memory(&self) -> bool {
        self.session.as_ref().is_some_and(Session::shares_memory)
    }

    /// The run's id, once the node gave one.
    pub fn run_id(&self) -> Option<&str> {
        (!self.run_id.is_empty()).then_some(&self.run_id)
    }
}
